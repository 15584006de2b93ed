"""What each part of the glimpse policy does, in the world where looking is all that helps.

The base and the ways of choosing a place are those of `cue`, so that their scores are those; the number of
glimpses K, the size of the glance, scales, and how saliency and inhibition of return weigh come on top.
"""

from runs.studies.cue import STUDY as CUE
from runs.study import Study, Variant, tasks_of

_CHANGES = [
    Variant("SaliencyGlimpse", "K3", {"glimpses": 3}, "K = 3 glimpses, not 1"),
    Variant("SaliencyGlimpse", "scales", {"scales": [1, 2]}, "windows in two scales"),
    Variant("SaliencyGlimpse", "glance-16", {"glance": 16}, "a glance of 16×16, not 32×32"),
    Variant("SaliencyGlimpse", "beta-0.5", {"beta": 0.5}, "saliency weighs a quarter to begin with"),
]

STUDY = Study(
    name="ablate_glimpse",
    title="The glimpse policy, one change at a time",
    purpose="What K, β, halting, the glance, scales and how places are chosen do to the glimpse policy.",
    tasks=tasks_of(
        CUE,
        ["salient"],
        [
            *(name for name in CUE.methods if name.startswith("SaliencyGlimpse")),
            *(change.method for change in _CHANGES),
        ],
    ),
    methods=[name for name in CUE.methods if name.startswith("SaliencyGlimpse")],
    variants=_CHANGES,
    seeds=10,
    cpu_hours=3.5,
    reference="SaliencyGlimpse",
)
