"""What of the remedy for other views helps: its parts taken away, or done otherwise, one by one (thesis 8.6).

The base is the window tree of `chapter8_views`, with the settings chosen there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from runs.experiments.chapter8_views import CHOSEN, DECIMALS, WORLDS, key, learn, scores
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit
from runs.experiments.growing import SEEDS, estimate

_SALIENT = {"frame": "salient", "resolution": 0.25}
_MATCH = {"questions": "match", "matches": 30}
# Differences from the chosen settings.
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "as chosen": {},
    "no jittered copies": {"copies": 0, "least": 1},
    "no doubt": {"doubt": 0.0},
    "criterion: best action": {"summed": None},
    "not cross-validated": {"cross_validated": False},
    "frame: most salient place": _SALIENT,
    "frame: union of 3 salient places": {**_SALIENT, "anchors": 3},
    "frame: strongest keypoint": {"frame": "keypoint", "resolution": 0.5},
    "patches, tolerance 0": {**_MATCH, "tolerance": 0},
    "patches, tolerance 20": {**_MATCH, "tolerance": 20},
    "forest of 3": {"trees": 3},
}
_LESS = {"photographs": {"copies": 8}}  # as many variants take long


def compute_variant(unit: Unit, lines: Lines) -> dict[str, Any]:
    """One variant in one world."""
    from attn_tree.growth import Growth
    from attn_tree.window_tree import WindowTree

    settings = unit.settings
    dataset, change = settings["dataset"], dict(settings["change"])
    trees = change.pop("trees", 1)
    checked = change.pop("cross_validated", True)
    growth = Growth(
        memory_size=1_000_000, leaf_values="model", patience=1, retries=2, cross_validated=checked
    )
    chosen = {**CHOSEN[dataset], **_LESS.get(dataset, {}), **change, "growth": growth}

    def build(env: Any, **others: Any) -> Any:
        return WindowTree(env, **{**chosen, **others})

    return scores(*learn(WORLDS[dataset], settings["seed"], build, trees))


def score_variants(lines: Sequence[Line]) -> list[Table]:
    """One row per variant."""
    names = ("heldout", "fraction", "selection", "questions", "leaves")
    head = ["variant", "held out", "read", "of it selection", "questions", "leaves"]
    rows = [[v, *(estimate(lines, n, variant=v) for n in names)] for v in VARIANTS]
    return [Table(head, rows, "", {name: digits for name, digits in DECIMALS.items() if name in head})]


EXPERIMENTS = [
    Experiment(
        name=f"remedy-ablation-{key(dataset).lower().replace('_', '-')}",
        chapter=8,
        title=f"What of the remedy helps, {dataset}",
        section="8.6",
        claim="The thesis proposes a frame fixed to salient points.",
        units=[
            Unit(
                key(variant.replace(":", ""), seed),
                {"dataset": dataset, "variant": variant, "change": change, "seed": seed},
            )
            for variant, change in VARIANTS.items()
            for seed in range(SEEDS)
        ],
        compute=compute_variant,
        score=score_variants,
        deviations=(f"Settings that are not named are those of `held-out-*`.{less}",),
        cpu_minutes=30,
        data=("coil100",) if dataset.startswith("COIL") else (),
    )
    for dataset, less in (("COIL 16", ""), ("photographs", " Every row with fewer jittered copies."))
]
