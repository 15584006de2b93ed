"""Damaged and hostile files, drawn by Hypothesis: bytes, JSON, and the archives of models.

What is hostile tries to be executed (pickles, names of code), to be written elsewhere (paths that
lead out of a folder), or to take all memory (sizes that a header only claims).
"""

from __future__ import annotations

import copy
import io
import json
import pickle
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

#: Values where another was expected.
HOSTILE: Sequence[Any] = (
    None,
    True,
    "",
    [],
    {},
    -1,
    0,
    2**31,
    2**63,
    -(10**30),
    10**400,
    0.5,
    1e308,
    float("nan"),
    float("inf"),
    "x" * 5000,
    "\ud800",
    "../../../../etc/passwd",
    "os:system",
    "__import__('os').system('true')",
    "<script>alert(1)</script>",
    {"__reduce__": ["os.system", "true"]},
    {"__class__": "subprocess.Popen"},
    [[[[[[[[[[]]]]]]]]]],
    ["x"] * 300,
)
Damage = Callable[[Any], Any]


class Exploit:
    """Unpickled, it calls `os.system`; whoever watches that call sees whether a pickle was opened."""

    def __reduce__(self) -> tuple[Any, ...]:
        import os

        return os.system, ("true",)


def fuzz(
    rng: np.random.Generator, inputs: st.SearchStrategy[Any], check: Callable[[Any], None], count: int
) -> None:
    """Check `count` inputs; the first that fails is shrunk to a small one and raised."""
    tried = 0

    @seed(int(rng.integers(2**32)))
    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink],
    )
    @given(inputs)
    def run(value: Any) -> None:
        nonlocal tried
        tried += 1
        check(value)

    run()
    assert tried >= count, f"only {tried} of {count} inputs were tried"


def damaged_bytes(whole: bytes) -> st.SearchStrategy[bytes]:
    """The bytes cut short, with bits flipped, with a part overwritten, taken out or doubled, or others."""
    place = st.integers(0, max(len(whole) - 1, 0))
    cut = place.map(lambda at: whole[:at])
    flips = st.lists(st.tuples(place, st.integers(0, 7)), min_size=1, max_size=8).map(
        lambda bits: _flipped(whole, bits)
    )
    spliced = st.tuples(place, st.integers(0, 64), st.binary(max_size=64)).map(
        lambda part: whole[: part[0]] + part[2] + whole[part[0] + part[1] :]
    )
    doubled = st.tuples(place, place).map(lambda ends: whole[: max(ends)] + whole[min(ends) :])
    return st.one_of(cut, flips, spliced, doubled, st.binary(max_size=200))


def _flipped(whole: bytes, bits: Sequence[tuple[int, int]]) -> bytes:
    changed = bytearray(whole)
    for at, bit in bits:
        changed[at] ^= 1 << bit
    return bytes(changed)


def damaged_values(whole: Any) -> st.SearchStrategy[Any]:
    """A JSON value with one to three of its parts hostile, gone, or under another name."""
    places = list(_places(whole))
    change = st.tuples(
        st.sampled_from(places), st.sampled_from(["put", "drop", "rename"]), st.sampled_from(HOSTILE)
    )
    return st.lists(change, min_size=1, max_size=3).map(lambda changes: _changed(whole, changes))


def damaged_json(whole: Any) -> st.SearchStrategy[bytes]:
    """The text of a JSON value, damaged as text or as a value."""
    return st.one_of(damaged_bytes(_text(whole)), damaged_values(whole).map(_text))


def _text(value: Any) -> bytes:
    return json.dumps(value).encode()


def _places(value: Any, path: tuple[Any, ...] = ()) -> Any:
    yield path
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in list(parts)[:40]:
        yield from _places(part, (*path, key))


def _changed(whole: Any, changes: Sequence[tuple[tuple[Any, ...], str, Any]]) -> Any:
    value = copy.deepcopy(whole)
    for path, what, put in changes:
        if not path:
            value = put if what == "put" else value
            continue
        inside = value
        try:
            for key in path[:-1]:
                inside = inside[key]
            if what == "put":
                inside[path[-1]] = put
            else:
                part = inside.pop(path[-1])
                if what == "rename" and isinstance(inside, dict):
                    inside[f"{path[-1]}_"] = part
        except (KeyError, IndexError, TypeError, AttributeError):
            continue  # an earlier change took this place away
    return value


def damaged_archives(
    whole: bytes, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> st.SearchStrategy[bytes]:
    """An archive with damaged bytes, or a sound one around damaged values and arrays."""
    values = damaged_values(dict(meta))
    names = sorted(arrays) or ["array"]
    changes = st.lists(st.tuples(st.sampled_from(names), st.sampled_from(_ARRAYS)), min_size=1, max_size=2)
    members = st.tuples(st.sampled_from(_MEMBERS), st.sampled_from([b"", b"{}", pickle.dumps(Exploit())]))
    return st.one_of(
        damaged_bytes(whole),
        values.map(lambda value: _archive(value, arrays)),
        changes.map(lambda chosen: _archive(meta, arrays, chosen)),
        st.tuples(values, changes).map(lambda both: _archive(both[0], arrays, both[1])),
        members.map(lambda member: _archive(meta, arrays, (), [member])),
    )


def _archive(
    meta: Any,
    arrays: Mapping[str, np.ndarray],
    changes: Sequence[tuple[str, Callable[[np.ndarray], bytes | None]]] = (),
    members: Sequence[tuple[str, bytes]] = (),
) -> bytes:
    packed: dict[str, bytes | None] = {name: _npy(array) for name, array in arrays.items()}
    for name, change in changes:
        packed[name] = change(arrays.get(name, np.zeros(3)))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that come twice
        archive.writestr(zipfile.ZipInfo("meta.json"), _text(meta))
        for name, data in packed.items():
            if data is not None:
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data)
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data)
    return out.getvalue()


def _npy(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=True)
    return out.getvalue()


def _claims(shape: str, kind: str = "<f8") -> Callable[[np.ndarray], bytes]:
    """An array of nothing whose header claims a shape."""

    def change(_: np.ndarray) -> bytes:
        header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header

    return change


def _exploiting(array: np.ndarray) -> bytes:
    objects = np.empty(max(array.size, 1), object)
    objects[:] = Exploit()
    return _npy(objects)


_ARRAYS: Sequence[Callable[[np.ndarray], bytes | None]] = (
    lambda array: None,
    lambda array: b"",
    lambda array: pickle.dumps(Exploit()),
    _exploiting,
    lambda array: _npy(array.astype(np.float64) * np.nan if array.dtype.kind in "biuf" else array),
    lambda array: _npy(array[:0] if array.ndim else array),
    lambda array: _npy(np.zeros(())),
    lambda array: _npy(array[None]),
    lambda array: _npy(np.concatenate([array, array]) if array.ndim else array),
    lambda array: _npy(array.astype("U9") if array.dtype.kind in "biuf" else array),
    lambda array: _npy(-array - 1 if array.dtype.kind in "if" else array),
    lambda array: _npy(np.full(array.shape, 2**40) if array.dtype.kind in "iu" else array),
    lambda array: _npy(array.astype(np.complex128) if array.dtype.kind in "biuf" else array),
    _claims("(10**12,)"),
    _claims("(1000000000000,)"),
    _claims("(-1,)"),
    _claims("(" + "1," * 70 + ")"),
    _claims("(3,)", "|O"),
)

_MEMBERS = ("../../out.npy", "/tmp/out.npy", "meta.json", "code.py", "data.pkl", "x.npy", "a/../b.npy", "")
