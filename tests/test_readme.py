"""What the README says is true: its code runs, its commands exist, its tables are the committed scores."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from runs import pages

README = (pages.ROOT / "README.md").read_text()


def test_the_code_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    variables: dict = {}
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        exec(compile(block, "README.md", "exec"), variables)
    assert (tmp_path / "out/tree.png").stat().st_size > 10_000
    assert 0 < variables["cost"].fraction < 1
    world = variables["env"].unwrapped.world
    actions, _ = variables["model"].predict(world.images, deterministic=True)
    assert world.correct_policy_rate(actions, 0.8) == 1.0


def test_every_command_of_the_readme_exists() -> None:
    makefile = (pages.ROOT / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", README, re.MULTILINE):
        assert f"\n{target}:" in makefile
    modules = set(re.findall(r"python -m (runs\.\w+)", README))
    assert {"runs.train", "runs.watch", "runs.compare", "runs.report"} <= modules
    for module in modules:
        assert (pages.ROOT / f"{module.replace('.', '/')}.py").exists()


def test_tables_are_those_of_the_committed_scores() -> None:
    command = [sys.executable, "-m", "runs.pages", "--check"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=pages.ROOT, check=False)
    assert done.returncode == 0, done.stderr
