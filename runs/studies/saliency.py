"""What the saliency that all methods share gives each of them: chapter 5's front-end, put to use.

RLVC reads windows at salient places, at random or at fixed ones, as many pixels each time; the window tree
lays its windows out from the image's corner, from its most salient place or from its strongest keypoint; the
glimpse policy is led by keys and saliency, by either alone, by chance, or not at all. Where something
vivid means nothing (`distractor`) saliency misleads. Weights learned for a target (5.3) lead detectors of
objects: they are in the experiments of chapters 5 and 6, no learner here takes them as a setting.

Most runs are those of `cue`, `ablate_rlvc`, `scenes` and `recognition`.
"""

from runs.studies.ablate_rlvc import STUDY as RLVC
from runs.studies.cue import STUDY as CUE
from runs.studies.recognition import STUDY as RECOGNITION
from runs.studies.scenes import STUDY as SCENES
from runs.study import Study, Variant, tasks_of

_WINDOWS = ["RLVC", "RLVC-salient", "RLVC-random", "RLVC-fixed", "RLVC-half-map"]
_GLIMPSES = [name for name in CUE.methods if name.startswith("SaliencyGlimpse") and "halting" not in name]
_FRAMES = [
    Variant("WindowTree", "salient", {"frame": "salient"}, "windows placed from the most salient place"),
    Variant("WindowTree", "keypoint", {"frame": "keypoint"}, "windows placed from the strongest keypoint"),
]
_RLVC = [variant for variant in RLVC.variants if variant.method in _WINDOWS]

STUDY = Study(
    name="saliency",
    title="What saliency gives each method",
    purpose=(
        "Places that are salient against places that are not, at equal pixels: for trees over features, for "
        "trees over windows, and for networks that look."
    ),
    tasks=[
        *tasks_of(CUE, ["salient"], [*_GLIMPSES, *_WINDOWS[:4]]),
        *tasks_of(CUE, ["distractor"], _GLIMPSES[:6]),
        *tasks_of(RLVC, ["five-views"], _WINDOWS),
        *tasks_of(SCENES, ["scenes"], _WINDOWS),
        *tasks_of(
            RECOGNITION,
            ["coil-16"],
            ["RLVC", "RLVC-salient", "WindowTree", *(each.method for each in _FRAMES), *_GLIMPSES[:1]],
        ),
    ],
    methods=["RLVC", "RLVC-salient", "WindowTree", *_GLIMPSES],
    variants=[*_RLVC, *_FRAMES],
    seeds=10,
    cpu_hours=4.0,
    reference="RLVC",
)
