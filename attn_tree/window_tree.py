"""A saccade tree that generalises to views it was not trained on: S-Tree's sibling (thesis 8.5, 8.6).

The thesis admits that S-Tree, whose nodes branch on the codeword seen at a place, does not survive a
change of view. Four things are meant to mend it; the experiments `remedy-ablation-*` take them away in turn:

1. questions with a threshold, on the mean colour of a small window or on the fit of a patch near a
   place, in place of codewords (`window_questions`);
2. jittered memories: each percept stands for itself and for copies of it (`variants`);
3. a criterion for many classes: reductions summed over actions, not those of the best action
   (`tree.splitter.best_summed_split`);
4. answers near the threshold count on both sides while the tree grows, so that thresholds go where no
   percept is near.

Deviations from the thesis beside these: (1) a phase refines again and again, up to `rounds` times,
until nothing is aliased that it can split, since Δ of a one-step task does not change with the tree;
(2) leaf values are by default those of the process estimated from memory (`Growth(leaf_values="model")`), in
which copies count like percepts; (3) a leaf with very many percepts judges questions by a random
sample of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.frames import Frame
from attn_tree.tree.splitter import Summed
from attn_tree.variants import Rehearsing
from attn_tree.vision.jitter import SMALL, Jitter
from attn_tree.window_questions import Kinds, WindowThresholds


class WindowTree(Rehearsing):
    """A tree of yes-or-no questions about small windows.

    Args:
        env: as for `QuasiStaticLearner`.
        questions: "colour" of windows, "match" of patches, or "both".
        copies: jittered copies of each percept; 0 for none.
        jitter: how far copies differ, a `Jitter` or its fields.
        summed: how the criterion adds up actions: "deviation", "variance", or None for the best action.
        least: percepts and copies that must be on either side of a split.
        sizes, samples, candidates, matches, patch, stride, tolerance, levels, doubt, frame, anchors,
            resolution: those of `WindowThresholds`.
        **settings: those of `Rehearsing`, `QuasiStaticLearner` and `TableLearner`.
    """

    vocabulary: WindowThresholds

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        questions: Kinds = "colour",
        copies: int = 4,
        jitter: Jitter | dict[str, float] = SMALL,
        summed: Summed | None = "deviation",
        least: float = 1,
        sizes: Sequence[int] = (8, 16),
        samples: int = 4,
        candidates: int = 200,
        matches: int = 60,
        patch: int = 8,
        stride: int = 4,
        tolerance: int | None = 16,
        levels: int = 15,
        doubt: float = 0.5,
        frame: Frame = "image",
        anchors: int = 1,
        resolution: float = 0.25,
        **settings: Any,
    ) -> None:
        self.windows = WindowThresholds(
            questions,
            sizes=sizes,
            samples=samples,
            candidates=candidates,
            matches=matches,
            patch=patch,
            stride=stride,
            tolerance=tolerance,
            levels=levels,
            doubt=doubt,
            frame=frame,
            anchors=anchors,
            resolution=resolution,
        )
        super().__init__(
            env, self.windows, copies=copies, jitter=jitter, summed=summed, least=least, **settings
        )

    def _shares(self, questions: Any, percepts: list[Any]) -> np.ndarray:
        return self.windows.shares(questions, percepts)

    def _settings(self) -> dict[str, Any]:
        words = self.windows
        return {
            **super()._settings(),
            "questions": words.kinds,
            "sizes": list(words.sizes),
            "samples": words.samples,
            "candidates": words.n_candidates,
            "matches": words.n_matches,
            "patch": words.patch,
            "stride": words.stride,
            "tolerance": words.tolerance,
            "levels": words.levels,
            "doubt": words.doubt,
            "frame": words.frame,
            "anchors": words.n_anchors,
            "resolution": words.resolution,
        }
