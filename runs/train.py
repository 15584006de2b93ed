"""Train one method in one world with one seed, from the command line.

`python -m runs.train STree --env attn_tree/VisualGridworld-4x4-v0 --seed 0 --out out/one`
leaves in the folder what a run of a study leaves: the model (which `runs.watch` opens), its
TensorBoard events, pictures of its tree and gaze, and `result.json`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from runs import cli, record
from runs.checkpoint import EVERY
from runs.methods import METHODS
from runs.run import RESULT, full_id, measure, train
from runs.study import Cell


def main(
    method: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="METHOD")],
    env: str,
    out: Path,
    seed: int = 0,
    bank_seed: int | None = None,
    steps: int = 20_000,
    gamma: float = 0.8,
    set: tuple[str, ...] = (),
    env_set: tuple[str, ...] = (),
    checkpoint_every: float = EVERY,
) -> int:
    """Train one method in one world with one seed, and measure what its decisions cost.

    Args:
        method: name of a method, for instance STree.
        env: registered id, for instance attn_tree/VisualGridworld-4x4-v0.
        out: folder of the run.
        seed: of the learner and of its environment.
        bank_seed: of the bank of images; 1000 + seed if not given.
        steps: environment steps.
        gamma: discount factor.
        set: settings of the method, key=value.
        env_set: settings of the environment, key=value.
        checkpoint_every: seconds between checkpoints, from which the same command goes on if it is killed.
    """
    name = cli.known("method", method, METHODS)
    if steps < 1:
        raise cli.UserMistake(f"--steps is {steps}; expected at least 1")
    if not checkpoint_every >= 0:
        raise cli.UserMistake(f"--checkpoint-every is {checkpoint_every}; expected seconds, at least 0")
    cell = Cell(
        study="train",
        method=name,
        env=full_id(env),
        variant="default",
        seed=seed,
        bank_seed=1000 + seed if bank_seed is None else bank_seed,
        steps=steps,
        gamma=gamma,
        evaluations=20,
        env_settings=cli.settings_from(env_set),
        method_settings=cli.settings_from(set),
    )
    with cli.mistakes():
        out.mkdir(parents=True, exist_ok=True)
    train(cell, out, checkpoint_every)
    measure([cell], [out])
    print(summary(record.read(out / RESULT)), f"\nwritten to {out}", sep="")
    return 0


def summary(run: record.Record) -> str:
    """The figures of a run in a few lines of text."""
    figures = {
        "return (optimal)": f"{_number(run.return_mean)} ({_number(run.return_optimal)})",
        "correct policy, seen": _number(run.correct_policy_rate),
        "correct policy, held out": _number(run.correct_policy_rate_heldout),
        "pixels of the image": _number(run.pixel_fraction),
        "decision, ms": _number(run.decision_ms_p50),
        "training, CPU s": _number(run.train_cpu_s),
    }
    if run.questions_per_decision is not None:
        asked = "glimpses" if run.tree_leaves is None else "questions"
        figures[f"{asked} of a decision"] = _number(run.questions_per_decision)
    if run.tree_leaves is not None:
        figures["tree leaves, depth"] = f"{run.tree_leaves}, {_number(run.tree_depth)}"
    width = max(map(len, figures))
    return "\n".join(
        [f"{run.method} on {run.env}, seed {run.seed}, {run.env_steps:,} steps"]
        + [f"  {name:<{width}}  {value}" for name, value in figures.items()]
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.train"))
