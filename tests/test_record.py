"""Records survive a round trip; whatever else a file holds is answered with one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from runs import record
from runs.record import Record, RecordError


def example(**changes: Any) -> Record:
    given_ = {"study": "s", "method": "STree", "env": "attn_tree/E-v0", "variant": "v", "seed": 1}
    return Record(**{**given_, "bank_seed": 2, "config": "abc", "env_steps": 100, **changes})


def test_round_trip(tmp_path: Path) -> None:
    run = example(
        return_mean=np.float64(0.5),
        tree_leaves=np.int64(4),
        curve=[{"steps": 1.0, "correct_policy_rate": 0.25}],
        operations={"questions": 1.5},
        versions={"numpy": "2"},
    )
    record.write(run, tmp_path / "a" / "result.json")
    assert record.read(tmp_path / "a" / "result.json") == run
    (tmp_path / "s.jsonl").write_text(record.to_line(run) + "\n\n" + record.to_line(run) + "\n")
    assert record.read_lines(tmp_path / "s.jsonl") == [run, run]
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["result.json"]


def test_not_a_number_becomes_null() -> None:
    again = record.from_json(record.to_line(example(return_mean=float("nan"), sri=float("inf"))), "x")
    assert again.return_mean is None and again.sri is None


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "JSON"),
        ('{"study": "s"', "JSON"),
        ("[1]", "object"),
        ("[" * 100_000, "JSON"),
        ('{"seed": ' + "9" * 5000 + "}", "JSON"),
        (b"\xff\xfe\x00", "JSON"),
        ("{}", "'study' is missing"),
        ({"seed": "1"}, "'seed' must be int"),
        ({"seed": True}, "'seed' must be int"),
        ({"method": "x" * 1000}, "'method' must be str"),
        ({"return_mean": "1"}, "'return_mean' must be float"),
        ({"curve": {"a": 1}}, "'curve' must be"),
        ({"curve": [{"steps": None}]}, "'curve' must be"),
    ],
)
def test_malformed_gives_one_line(text: Any, word: str, tmp_path: Path) -> None:
    if isinstance(text, dict):
        text = json.dumps({**json.loads(record.to_line(example())), **text})
    path = tmp_path / "result.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RecordError) as caught:
        record.read(path)
    assert word in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_infinity_and_missing_and_oversized_files(tmp_path: Path) -> None:
    line = record.to_line(example(return_mean=0.5))
    with pytest.raises(RecordError, match="Infinity"):
        record.from_json(line.replace("0.5", "Infinity"), "x")
    with pytest.raises(RecordError, match="cannot be read"):
        record.read(tmp_path / "none.json")
    (tmp_path / "big").write_bytes(b" " * (record.LARGEST_FILE + 1))
    with pytest.raises(RecordError, match="larger"):
        record.read(tmp_path / "big")


LINE = record.to_line(example(return_mean=0.5, curve=[{"steps": 1.0}])).encode()


@given(st.integers(0, len(LINE) - 1), st.binary(max_size=4), st.integers(0, 4))
@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])
def test_damaged_bytes_never_crash(at: int, put: bytes, cut: int) -> None:
    try:
        assert isinstance(record.from_json(LINE[:at] + put + LINE[at + cut :], "x"), Record)
    except RecordError as error:
        assert "\n" not in str(error)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    record.write(example(), path)
    with pytest.raises(TypeError):
        record.write(example(operations={"x": object()}), path)
    assert record.read(path) == example() and len(list(tmp_path.iterdir())) == 1
