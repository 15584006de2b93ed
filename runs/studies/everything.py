"""Every method in every world where it makes sense: the table of the whole comparison.

Its runs are those of `gridworld`, `cue`, `navigation` and `recognition` wherever they run there already, and
their committed scores are taken over. Pairs that are left out make no sense: what reads symbols has none
to read in worlds of images; AssociativeQ chooses where to look where the place is part of the action; RAM is
taught classes, in worlds of one step; RecurrentPPO is told the number of the image, and remembers, which
pays where images hide the state. Trees and tables choose one of a list of actions, a driver two things
at once.

Settings are the defaults of each method (what was tried for them is said in its module) and those that the
study gives where a task comes from; nothing was tried for this table.
"""

from runs.studies.ablate_stree import STUDY as STREE
from runs.studies.cue import STUDY as CUE
from runs.studies.gridworld import STUDY as GRIDWORLD
from runs.studies.navigation import STUDY as NAVIGATION
from runs.studies.recognition import STUDY as RECOGNITION
from runs.study import Study, tasks_of

_TREES = ["STree", "RLVC", "RLVC-salient"]
_GLIMPSES = ["SaliencyGlimpse", "SaliencyGlimpse-random", "SaliencyGlimpse-glance", "GlimpsePPO"]
_WHOLE = ["NaturePPO", "NaturePPO-48"]
_BOUNDS = ["TabularQ", "Random"]
_IMAGES = [*_TREES, *_GLIMPSES, *_WHOLE, *_BOUNDS]
_HIDDEN = ["STree", "STree-history", "RLVC", "SaliencyGlimpse", "NaturePPO-48", "RecurrentPPO", *_BOUNDS]
_MEMORY = [variant for variant in STREE.variants if variant.name == "history"]
STUDY = Study(
    name="everything",
    title="Every method in every world",
    purpose=(
        "What each method earns, what it looks at, and what that costs: gridworlds of photographs, a symbol "
        "to be found, cells that hide the state, driving, digits in clutter, objects on a turntable."
    ),
    tasks=[
        *(
            task
            for task in tasks_of(GRIDWORLD, ["distinct", "five-views"], _IMAGES)
            if task.env == "attn_tree/VisualGridworld-4x4-v0"
        ),
        *tasks_of(
            CUE, ["salient"], [*(name for name in _IMAGES if name in CUE.methods), "WindowTree-patches"]
        ),
        *tasks_of(STREE, ["hidden"], _HIDDEN),
        *tasks_of(NAVIGATION),
        *tasks_of(RECOGNITION),
    ],
    methods=[
        *_TREES,
        "ObjectTree",
        "UTree",
        "AssociativeQ",
        "WindowTree",
        *_GLIMPSES,
        *_WHOLE,
        "RecurrentPPO",
        "RAM",
        "ThumbnailQ",
        "ThumbnailNearest",
        *_BOUNDS,
    ],
    variants=[*CUE.variants, *_MEMORY],
    seeds=10,
    cpu_hours=5.8,
)
