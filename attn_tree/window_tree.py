"""A saccade tree that generalises to views it was not trained on: S-Tree's sibling (thesis 8.5, 8.6).

The thesis admits that S-Tree, whose nodes branch on the codeword seen at a place, does not survive a
change of view. Four things mend most of it, all of them measured (experiment `remedy-ablation`):

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
from dataclasses import asdict
from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.frames import Frame
from attn_tree.growth import Growth
from attn_tree.learner import QuasiStaticLearner
from attn_tree.memory import Transitions
from attn_tree.percepts import Percepts
from attn_tree.tree.criterion import Evidence
from attn_tree.tree.node import Node, Question, Tree
from attn_tree.tree.pruning import prune
from attn_tree.tree.splitter import Summed, best_summed_split
from attn_tree.variants import VariedPercepts
from attn_tree.vision.jitter import SMALL, Jitter
from attn_tree.window_questions import Kinds, WindowThresholds

# Percepts that judge the questions of one leaf, at most.
_JUDGES = 1500


class WindowTree(QuasiStaticLearner):
    """A tree of yes-or-no questions about small windows.

    Args:
        env: as for `QuasiStaticLearner`.
        questions: "colour" of windows, "match" of patches, or "both".
        copies: jittered copies of each percept; 0 for none.
        jitter: how far copies differ, a `Jitter` or its fields.
        summed: how the criterion adds up actions: "deviation", "variance", or None for the best action.
        least: percepts and copies that must be on either side of a split.
        rounds: most refinements in one phase.
        growth: as for `QuasiStaticLearner`; unless given, a memory of a million, values from the
            leaf model, and the end of learning after one quiet phase.
        sizes, samples, candidates, matches, patch, stride, tolerance, levels, doubt, frame, anchors,
            resolution: those of `WindowThresholds`.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.
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
        rounds: int = 60,
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
        growth: Growth | dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if copies < 0 or rounds < 1:
            raise ValueError(f"copies is {copies} and rounds {rounds}; expected at least 0 and at least 1")
        if copies and settings.get("history"):
            raise ValueError("jittered copies of a history are not defined; use copies=0 or history=0")
        if summed not in ("deviation", "variance", None):
            raise ValueError(f"summed is {summed!r}; expected 'deviation', 'variance' or None")
        self.copies, self.summed, self.least, self.rounds = copies, summed, least, rounds
        self.jitter = Jitter(**jitter) if isinstance(jitter, dict) else jitter
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
        if growth is None:
            growth = Growth(memory_size=1_000_000, leaf_values="model", patience=1)
        super().__init__(env, self.windows, growth=growth, **settings)

    # Jittered memories ------------------------------------------------------------------

    def _make_percepts(self) -> Percepts:
        percepts = super()._make_percepts()
        return VariedPercepts(percepts, self.copies, self.jitter, self.seed or 0) if self.copies else percepts

    def _recalled(self) -> tuple[Transitions, np.ndarray]:
        memory, counts = super()._recalled()
        if not isinstance(self._percepts, VariedPercepts):
            return memory, counts
        row = np.repeat(np.arange(len(memory)), self._percepts.each)
        again = memory.take(row)
        percepts = self._percepts.of(memory.percepts).ravel()
        lived = Transitions(percepts, again.actions, again.rewards, again.next_percepts, again.terminated)
        return lived, counts[row]

    # Growing ----------------------------------------------------------------------------

    def _refine(self) -> None:
        phase = self.phase
        for _ in range(self.rounds):
            super()._refine()
            self.phase = phase + 1
            if not self.aliased or self.growth.memory == "clear":
                break

    def _best_question(
        self, leaf: Node, percepts: list[Any], evidence: Evidence
    ) -> tuple[Question, np.ndarray] | None:
        if self.summed is None or self.history:
            return super()._best_question(leaf, percepts, evidence)
        judges = np.sort(self.rng.permutation(len(percepts))[:_JUDGES])
        judged = evidence if len(judges) == len(percepts) else evidence.of_percepts(judges)
        shown = [percepts[judge] for judge in judges]
        for attempt in range(1 + self.growth.retries):
            questions = self.windows.candidates(leaf, shown, self.rng, attempt)
            if not questions:
                continue
            best = best_summed_split(
                judged,
                self.windows.shares(questions, shown),
                summed=self.summed,
                cross_validated=self.growth.cross_validated,
                least=self.least,
            )
            if best is None:
                continue
            chosen = questions[best]
            answers = np.array([self.windows.answer(chosen, percept) for percept in percepts])
            if 0 < answers.sum() < len(answers):
                self.windows.keep(chosen)
                return chosen, answers
        return None

    def decide(self) -> tuple[Tree, np.ndarray]:
        """The tree and the values that the policy should use now: pruned, if asked for."""
        if not self.growth.prune or len(self.grown_tree.leaves) == 1:
            return self.grown_tree.copy(), self.values.copy()
        percepts = self._remembered()
        if isinstance(self._percepts, VariedPercepts):
            percepts = self._percepts.of(percepts).ravel()
        # A merged leaf takes the mean of values that agree on the best action: nothing to check.
        return prune(self.grown_tree, self.values, set(self._rows(percepts).tolist()))

    def _settings(self) -> dict[str, Any]:
        words = self.windows
        return {
            **super()._settings(),
            "questions": words.kinds,
            "copies": self.copies,
            "jitter": asdict(self.jitter),
            "summed": self.summed,
            "least": self.least,
            "rounds": self.rounds,
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
