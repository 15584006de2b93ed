"""The worked examples of the docs run as they stand there."""

import re
import sys
from pathlib import Path

import gymnasium as gym
import pytest

import envs
from runs import cli, compare, methods, pages, record
from runs.experiments import EXPERIMENTS

EXTENDING = (pages.ROOT / "docs/extending.md").read_text()
STUDIES = (pages.ROOT / "docs/studies.md").read_text()


def test_a_world_a_question_a_method_and_a_study_are_one_file_and_one_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    known = {
        name: dict(table) for name, table in (("METHODS", methods.METHODS), ("FAMILIES", methods.FAMILIES))
    }
    variables: dict = {}
    try:
        for block in re.findall(r"```python\n(.*?)```", EXTENDING, re.DOTALL):
            if named := re.match(r"# (\w+\.py)\n", block):
                (tmp_path / named[1]).write_text(block)
            else:
                exec(compile(block, "extending.md", "exec"), variables)
    finally:
        for name, before in known.items():
            table = getattr(methods, name)
            table.clear()
            table.update(before)
        gym.registry.pop(envs.REGISTERED.pop())
        del envs.TABLE["TrafficLight-v0"]
        for name in ("traffic", "red_tree"):
            sys.modules.pop(name, None)
    world, model = variables["env"].unwrapped.world, variables["model"]
    actions, _ = model.predict(world.images, deterministic=True)
    assert world.correct_policy_rate(actions, 0.8) == 1.0 and len(model.tree.leaves) == 2
    runs = [record.read(path) for path in tmp_path.glob("out/lights/*/*/*/*/result.json")]
    assert len(runs) == 4 and all(run.correct_policy_rate == 1.0 for run in runs)
    (pixels,) = {run.pixels_recognition for run in runs if run.method == "RedTree"}
    assert pixels == 64


def test_the_study_and_the_commands_of_the_page_on_studies_are_good(tmp_path: Path) -> None:
    variables: dict = {}
    (block,) = re.findall(r"```python\n(.*?)```", STUDIES, re.DOTALL)
    exec(compile(block, "studies.md", "exec"), variables)
    compare.check(variables["STUDY"])
    plan = compare.planned(variables["STUDY"], tmp_path)
    assert "20 cells, 10 of them have scores" in plan and "taken over: 10 from gridworld" in plan
    commands = re.findall(r"`python -m runs.compare ([^`]*)`", STUDIES.replace("\n", " "))
    for command in commands:
        assert cli.main(compare.main, "runs.compare", [*command.split(), "--dry-run"]) == 0
    assert len(commands) == 2
    named = re.findall(r"python -m runs.thesis\s+([\w.-]+)`", STUDIES)
    assert len(named) == 2 and set(named) <= set(EXPERIMENTS)
