"""The report: right figures, everything escaped, nothing fetched, nothing hidden."""

import csv
import json
import re
import shutil
import subprocess
import threading
from html.parser import HTMLParser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runs import figures, record, report
from runs.ablations import effects
from runs.methods import METHODS
from runs.record import Record
from runs.report_pictures import plots_of
from runs.tables import task_tables
from runs.wording import latex_cell

EVIL = "<script>alert(1)</script>|`x`](http://evil.example)$\\frac{$"


def run(method: str, seed: int, **changes: Any) -> Record:
    rng = np.random.default_rng(seed)
    figures = {
        "return_mean": 1.0,
        "return_mean_heldout": float(rng.normal()),
        "return_optimal": 1.0,
        "correct_policy_rate": 1.0,
        "correct_policy_rate_heldout": float(rng.random()),
        "pixel_fraction": 0.2,
        "pixels_processed": 100.0,
        "decision_ms_p50": 3.0,
        "curve": [{"steps": 100.0 * k, "correct_policy_rate": k / 10} for k in range(1, 11)],
        "git_commit": "abc123",
    }
    identity = {"study": "toy", "method": method, "env": "attn_tree/Toy-v0", "variant": "plain", "seed": seed}
    settings = {"bank_seed": seed, "config": "c", "env_steps": 1000}
    return Record(**{**identity, **settings, **figures, **changes})


def folder_of(tmp_path: Path, runs: list[Record], **header: Any) -> Path:
    for each in runs:
        record.write(
            each, tmp_path / f"m{abs(hash(each.method))}" / "e" / "v" / str(each.seed) / "result.json"
        )
    (tmp_path / "study.json").write_text(json.dumps({"name": "toy", **header}))
    return tmp_path


def test_table_counts_failures_and_compares(tmp_path: Path) -> None:
    runs = [run("STree", s, correct_policy_rate=[1, 0.9, 1][s]) for s in range(3)]
    runs += [run("RLVC", s, pixels_processed=900.0, decision_ms_p50=9.0) for s in range(3)]
    (table,) = task_tables(runs, ["RLVC", "STree"], {}, "STree")
    assert [row.method for row in table.rows] == ["RLVC", "STree"]
    assert [row.failed for row in table.rows] == [0, 1]
    assert table.rows[0].better is not None and table.rows[1].better is None
    assert table.rows[0].better.value == 0.5  # the same held-out returns
    (verdict,) = table.verdicts
    assert verdict.equal_return and verdict.words == "fewer pixels, less time"


def test_fronts_say_what_their_axes_leave_out() -> None:
    """Operations where there are any; ticks once each and as people write them; 0 named, not dropped."""
    returns = {"STree": 1.0, "RLVC": 0.5, "GlimpsePPO": 0.9, "NaturePPO": 0.8, "Random": -99.0}
    costs = {"STree": 0.1, "RLVC": 3.0, "GlimpsePPO": 0.2, "NaturePPO": 1.0, "Random": 0.0}
    macs = {"NaturePPO": 8e6, "GlimpsePPO": 7e5}
    runs = [
        run(name, s, return_mean=r, return_mean_heldout=r, pixel_fraction=costs[name], macs=macs.get(name))
        for name, r in returns.items()
        for s in range(2)
    ]
    (table,) = task_tables(runs, list(returns), {}, "STree")
    pictures = {picture.title: picture for picture in plots_of(table)}
    pixels = next(p for title, p in pictures.items() if "pixels" in title)
    assert "Random" in pixels.note and "Random" in pixels.alt and "STree" not in pixels.note
    counted = next(picture for title, picture in pictures.items() if "operations" in title)
    assert "not counted: STree, RLVC, Random" in counted.note
    assert not any("operations" in p.title for p in plots_of(task_tables(runs[:2], [], {}, "STree")[0]))
    told = [each for each in runs if each.method != "Random"]
    told += [run("TabularQ", 0, return_mean=0.5, return_mean_heldout=None, pixel_fraction=0.001)]
    (mixed,) = task_tables(told, [], {}, "STree")
    front = figures.pareto(mixed, "pixel_fraction", "pixels")
    assert "#777777" not in front  # STree earns most for least; what is told the state is no rival
    assert figures.spans_decades(list(returns.values())) and not figures.spans_decades([-6.0, 0.1, 1.0])
    for picture in pictures.values():
        assert b"10^" not in picture.data  # Matplotlib keeps a label's source as a comment
    times = next(p.data.decode() for title, p in pictures.items() if "milliseconds" in title)
    labels = re.findall(r"<!-- (−?[\d.]+) -->", times[times.index("matplotlib.axis_2") :])
    assert sorted(labels) == sorted(["−100", "−10", "−1", "0", "1"])


def test_ablations_pair_seeds_and_leave_out_what_one_side_lacks(tmp_path: Path) -> None:
    shift = np.random.default_rng(0).normal(0, 20, 6)  # what a seed does to both
    base = [run("GlimpsePPO", s, return_mean=shift[s], return_mean_heldout=None) for s in range(6)]
    changed = [
        run("GlimpsePPO-fixed", s, return_mean=shift[s] + 0.5, pixel_fraction=0.1) for s in range(1, 6)
    ]
    changed += [run("GlimpsePPO-fixed", 9, return_mean=1e6)]  # its base has no seed 9
    changed[0].pixel_fraction = None
    runs = [*base, *changed, run("NaturePPO-48", 0)]  # its base did not run
    (table,) = task_tables(runs, list(METHODS), {}, "STree")
    (found,) = effects(table)
    assert (found.method, found.base, found.pairs) == ("GlimpsePPO-fixed", "GlimpsePPO", 5)
    for seen, wanted in ((found.return_seen, 0.5), (found.pixels, -0.1), (found.correct, 0.0)):
        assert seen is not None and [seen.low, seen.value, seen.high] == pytest.approx([wanted] * 3)
    assert found.return_heldout is None and found.better is not None and found.better.value > 0.5
    written = {path.name: path.read_text() for path in report.write_report(folder_of(tmp_path, runs))}
    (row,) = csv.DictReader(written["report-changes.csv"].splitlines())
    assert float(row["return_seen_low"]) == pytest.approx(0.5) and row["return_heldout"] == ""
    assert all("+0.5" in written[f"report.{kind}"] for kind in ("html", "md", "tex"))


def test_every_base_is_a_method_with_the_same_learner() -> None:
    bases = [(method, METHODS[method.base]) for method in METHODS.values() if method.base]
    assert len(bases) >= 12 and all(method.base != method.name for method, _ in bases)
    assert all(method.family == base.family and method.note for method, base in bases)


class Page(HTMLParser):
    """Collects what could leave the page or lacks words."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.images: list[dict[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        given = dict(attrs)
        self.links += [value or "" for name, value in given.items() if name in ("src", "href", "srcset")]
        if tag == "img":
            self.images.append(given)


def test_page_escapes_and_asks_for_nothing(tmp_path: Path) -> None:
    runs = [run(method, seed) for method in ("STree", EVIL) for seed in range(3)]
    runs += [run("STree", s, variant=EVIL) for s in range(2)]
    folder = folder_of(tmp_path, runs, title=EVIL, purpose=EVIL, command=EVIL, reference=EVIL)
    record.write_atomically(folder / "m" / "e" / "v" / "0" / "tree.png", b"no png")
    html_path, markdown_path, latex_path = report.write_report(folder)[:3]
    page = Page()
    page.feed(html_path.read_text())
    assert "script" not in page.tags and "a" not in page.tags
    assert page.links and all(link.startswith("data:image/") for link in page.links)
    assert all(image["alt"] for image in page.images) and len(page.images) >= 8
    assert "&lt;script&gt;" in html_path.read_text()
    markdown = markdown_path.read_text()
    assert markdown.count("<script") == 1  # the command, in a code span
    assert not re.search(r"(?<!\\)(\]\(http|`x)", markdown.replace("`" + EVIL.replace("`", "") + "`", ""))
    rows = [re.sub(r"\\.", "", line) for line in markdown.splitlines() if line.startswith("| ")]
    assert {row.count("|") for row in rows} <= {8, 11, 16}
    latex = latex_path.read_text()
    rows = [line for line in latex.splitlines() if line.endswith(r" \\")]
    body = [row for row in rows if not row.startswith(("P(", "leaves"))]
    assert {len(re.findall(r"(?<!\\)&", row)) for row in body} <= {6, 9, 14}
    assert "\\frac" not in latex and latex.count("textbackslash{}frac") >= 8
    assert latex.count("{") - latex.count("\\{") == latex.count("}") - latex.count("\\}")


UNESCAPED = {"{[}": "[", "{]}": "]", "{*}": "*", "$-$": "−", r"$\times$": "×", r"$\cdot$": "·"}
UNESCAPED |= {r"$\tau$": "τ", r"$\beta$": "β"} | {f"\\{mark}": mark for mark in "&%$#_{}"}
UNESCAPED |= {r"\textbackslash{}": "\\", r"\textasciitilde{}": "~", r"\textasciicircum{}": "^"}
UNESCAPED |= {r"\textless{}": "<", r"\textgreater{}": ">", r"\textbar{}": "|", r"\textasciigrave{}": "`"}
UNESCAPED |= {r"\textendash{}": "–", r"\textemdash{}": "—", "-{}": "-", ",{}": ",", "'{}": "'"}
PARTS = sorted(map(re.escape, UNESCAPED), key=len, reverse=True)
LATEX = re.compile("|".join([*PARTS, r"[^\\{}$&#%_^~<>|`*\[\]]"]))


@given(st.one_of(st.text(), st.text("\\{}$&#%_^~<>|`*[]-,'\" \n\t0a–−×τ")))
@settings(max_examples=400)
def test_latex_says_the_text_and_nothing_else(text: str) -> None:
    """Split into known escapes and harmless letters, with nothing over, it reads as it did."""
    cell = latex_cell(text)
    parts = LATEX.findall(cell)
    assert "".join(parts) == cell and not re.search(r"--|,,|''|\n", cell)
    said = "".join(UNESCAPED.get(part, part) for part in parts)
    plain = " ".join(text.split())
    codes = (c if c in _SET or (c.isascii() and c.isprintable()) else f"U+{ord(c):04X}" for c in plain)
    assert said.replace("−", "-") == "".join(codes).replace("−", "-")


_SET = {*UNESCAPED.values(), *(chr(c) for c in range(0xC0, 0x100) if chr(c).isalpha())}


def test_csv_holds_every_figure(tmp_path: Path) -> None:
    runs = [run(method, seed, operations={"taps": 3.5}) for method in ("STree", "=1+1") for seed in range(3)]
    report.write_report(folder_of(tmp_path, runs, tasks=[["attn_tree/Toy-v0", "plain", "", ["STree"]]]))
    rows = list(csv.DictReader((tmp_path / "report.csv").read_text().splitlines()))
    (table,) = task_tables(runs, [], {}, "STree")
    ours = next(row for row in table.rows if row.method == "STree")
    assert [row["method"] for row in rows] == ["STree", "'=1+1"] and rows[0]["runs"] == "3"
    assert ours.return_heldout is not None
    assert float(rows[0]["return_heldout_low"]) == ours.return_heldout.low
    assert float(rows[0]["return_heldout"]) == ours.return_heldout.value and rows[0]["depth"] == ""
    rows = list(csv.DictReader((tmp_path / "report-runs.csv").read_text().splitlines()))
    mine = {int(r["seed"]): float(r["return_mean_heldout"]) for r in rows if r["method"] == "STree"}
    assert mine == {each.seed: each.return_mean_heldout for each in runs if each.method == "STree"}
    assert {row["operations.taps"] for row in rows} == {"3.5"}


def test_same_scores_same_report(tmp_path: Path) -> None:
    runs = [run("STree", seed) for seed in range(3)]
    (tmp_path / "toy.jsonl").write_text("".join(record.to_line(each) + "\n" for each in runs))
    first = [path.read_bytes() for path in report.write_report(tmp_path / "toy.jsonl")]
    assert first == [path.read_bytes() for path in report.write_report(tmp_path / "toy.jsonl")]


def test_missing_runs_are_named(tmp_path: Path) -> None:
    task = ("attn_tree/Toy-v0", "plain", "", ["STree", "RLVC"])
    folder = folder_of(tmp_path, [run("STree", 0)], tasks=[task], seeds=2)
    found = report.contents(folder, pictures=False)
    assert len(found.missing) == 2 and "RLVC" in found.missing[1] and "2 of 2" in found.missing[1]
    assert "missing: " in report.terminal_table(folder)


def test_committed_lines_stand_in_for_runs_not_on_disk(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, [run("STree", 0)])
    lines = [run("STree", 0, return_mean=-9.0), run("STree", 1)]
    (folder / "committed.jsonl").write_text("".join(record.to_line(line) + "\n" for line in lines))
    _, records, _ = report.collect(folder)
    assert [(r.seed, r.return_mean) for r in records] == [(0, 1.0), (1, 1.0)]


@pytest.mark.parametrize("text", ["", "[]", "[" * 9999, '{"name": "x", "methods": 3}', '{"name": 1}', "{}"])
def test_damaged_header_gives_one_line(tmp_path: Path, text: str) -> None:
    folder = folder_of(tmp_path, [run("STree", 0)])
    (folder / "study.json").write_text(text)
    with pytest.raises(record.RecordError) as caught:
        report.contents(folder, pictures=False)
    assert "study.json" in str(caught.value) and "\n" not in str(caught.value)


def test_every_tag_has_a_chart_and_hparams_have_metrics(tmp_path: Path) -> None:
    """One layout for all methods; whatever our learners and callbacks log is somewhere in it."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    from runs.tensorboard import _TAGS, LAYOUT, write_summary

    root = Path(report.__file__).parents[1]
    shown = [tag for charts in LAYOUT.values() for _, tags in charts.values() for tag in tags]
    sources = [path for name in ("attn_tree", "baselines", "runs") for path in (root / name).rglob("*.py")]
    text = "".join(path.read_text() for path in sources)
    logged = set(re.findall(r'logger\.record\("(\w+/\w+)", [^\n]*\)(?<!exclude="tensorboard"\))', text))
    logged |= {*_TAGS.values(), "eval/correct_policy_rate", "train/loss", "rollout/ep_rew_mean"}
    assert len(logged) > 12
    assert not [tag for tag in logged if not any(re.search(pattern, tag) for pattern in shown)]
    write_summary(tmp_path, run("STree", 0), {"radius": 24})
    (events,) = (tmp_path / "tensorboard").glob("events*")
    accumulated = EventAccumulator(str(events)).Reload()
    assert accumulated.PluginTagToContent("custom_scalars")
    assert len(accumulated.PluginTagToContent("hparams")) == 3
    scalars = set(accumulated.Tags()["scalars"])
    assert {"final/return_mean_heldout", "final/correct_policy_rate_heldout"} <= scalars


class Proxy(BaseHTTPRequestHandler):
    """Counts what a browser asks the network for, and gives nothing."""

    asked: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.asked.append(self.path)
        self.send_error(404)

    do_CONNECT = do_GET

    def log_message(self, *_: Any) -> None:
        pass


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_shows_the_page_without_errors_or_requests(tmp_path: Path) -> None:
    """In a real browser, at the width of a phone: nothing on the console, nothing asked of the network,
    nothing wider than the screen. The page beside it asks and errs, to show that it would be seen."""
    evil = f'"><img src="http://leak.example/report.png">{EVIL}'
    runs = [run(method, s) for method in ("STree", evil) for s in range(2)]
    page = report.write_report(folder_of(tmp_path, runs, title=evil))[0]
    control = "<img src=http://leak.example/control.png><script>boom()</script>"
    (tmp_path / "control.html").write_text(control)
    frames = f"<iframe id=f src={page.name} style='width:390px;height:9000px;border:0'></iframe>"
    frames += "<iframe src=control.html></iframe><script>onload=()=>{document.title='width '+"
    frames += "document.getElementById('f').contentDocument.documentElement.scrollWidth}</script>"
    (tmp_path / "frames.html").write_text(frames)
    server = ThreadingHTTPServer(("127.0.0.1", 0), Proxy)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += ["--disable-background-networking", "--disable-component-update", "--no-first-run"]
    command += ["--allow-file-access-from-files", f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
    command += [f"--proxy-server=127.0.0.1:{server.server_port}", (tmp_path / "frames.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    server.shutdown()
    assert {path for path in Proxy.asked if "leak" in path} == {"http://leak.example/control.png"}
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert console and all("control" in line for line in console)
    width = re.search(r"<title>width (\d+)</title>", done.stdout)
    assert width is not None and int(width[1]) <= 390


def test_it_says_which_runs_another_study_made(tmp_path: Path) -> None:
    runs = [run("STree", seed, taken_from="cue" if seed else None) for seed in range(3)]
    written = report.write_report(folder_of(tmp_path, runs))
    for path in written[:3]:
        assert "Taken over from other studies: 2 runs of cue. Their milliseconds" in path.read_text()
