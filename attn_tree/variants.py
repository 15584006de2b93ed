"""Percepts with jittered copies, so that what is learned of a view holds for views near it.

Each percept of an environment stands for itself and for a number of slightly shifted, turned, scaled
and relit copies (`attn_tree.vision.jitter`), drawn once and for all. What was earned in the percept is
taken to be earned in its copies too. They are for learning alone; no decision sees one.

`Rehearsing` gives such memories to any learner of trees, and with them what learning to name many
classes needs: refining again and again within a phase, and a criterion that adds up all actions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth, as_growth, from_fields, is_number, is_whole
from attn_tree.learner import QuasiStaticLearner
from attn_tree.memory import Transitions
from attn_tree.percepts import Percepts
from attn_tree.tree.criterion import Evidence
from attn_tree.tree.node import Node, Question, Tree
from attn_tree.tree.pruning import prune
from attn_tree.tree.splitter import Summed, best_summed_split
from attn_tree.vision.jitter import SMALL, Jitter, jitter
from attn_tree.vision.retina import Retina

# Percepts that judge the questions of one leaf, at most.
_JUDGES = 1500


class VariedPercepts:
    """Percepts by number, each followed by its copies: k(1 + copies) is percept k itself.

    Args:
        inner: the percepts themselves, images without a history.
        copies: of each, at least 1.
        ranges: how far copies may differ.
        seed: of the copies; which percept and which copy decide the rest.
    """

    def __init__(self, inner: Percepts, copies: int, ranges: Jitter, seed: int) -> None:
        self.inner, self.copies, self.ranges, self._seed = inner, copies, ranges, seed
        self._retinas: dict[int, Retina] = {}

    @property
    def each(self) -> int:
        """Numbers per percept."""
        return 1 + self.copies

    @property
    def sights(self) -> Any:
        """Percepts that number observations alone."""
        return self.inner.sights

    def seen(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers among `sights` of what is seen in these percepts."""
        return self.inner.seen(numbers // self.each)

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of a batch of observations."""
        return self.inner.numbers(observations) * self.each

    def after(self, numbers: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """What is seen, whatever was before."""
        return upcoming

    def of(self, numbers: np.ndarray) -> np.ndarray:
        """Percepts `(n,)` with their copies, `(n, 1 + copies)`."""
        return numbers[:, None] + np.arange(self.each)

    def percept(self, number: int) -> Retina:
        """The lasting retina of a percept or of a copy."""
        which, copy = divmod(number, self.each)
        if copy == 0:
            return self.inner.percept(which)
        if number not in self._retinas:
            rng = np.random.default_rng([self._seed, which, copy])
            image = self.inner.percept(which).whole()
            self._retinas[number] = Retina(jitter(image, rng, self.ranges))
        return self._retinas[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget all other percepts and their copies, where forgetting frees anything."""
        kept = {number // self.each for number in numbers}
        self.inner.keep(kept)
        self._retinas = {n: retina for n, retina in self._retinas.items() if n // self.each in kept}


class Rehearsing(QuasiStaticLearner):
    """A learner of trees that rehearses what it remembers.

    To be put before a learner of trees: `class JitteredRLVC(Rehearsing, RLVC)`.

    Args:
        env: as for the learner.
        copies: jittered copies of each percept; 0 for none.
        jitter: how far copies differ, a `Jitter` or its fields.
        summed: how the criterion adds up actions: "deviation", "variance", or None for the best
            action as the learner has it. Only for questions whose answers are 0 and 1.
        least: percepts and copies that must be on either side of a split (not with `summed=None`).
        rounds: most refinements in one phase.
        growth: as for `QuasiStaticLearner`; unless given, a memory of a million, values from the
            leaf model, two more tries at a leaf that no question separates, and the end of learning
            after one quiet phase.
        **settings: those of the learner.

    Raises:
        ValueError: a setting makes no sense; copies with a history.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *args: Any,
        copies: int = 0,
        jitter: Jitter | dict[str, float] = SMALL,
        summed: Summed | None = None,
        least: float = 1,
        rounds: int = 60,
        growth: Growth | dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if not is_whole(copies, 0) or not is_whole(rounds, 1):
            raise ValueError(
                f"copies is {copies!r} and rounds {rounds!r}; expected whole numbers of at least 0 and 1"
            )
        if not is_number(least) or not least >= 0:
            raise ValueError(f"least is {least!r}; expected a number of percepts and copies, at least 0")
        if settings.get("history"):
            raise ValueError("jittered copies of a history are not defined; use history=0")
        if summed not in ("deviation", "variance", None):
            raise ValueError(f"summed is {summed!r}; expected 'deviation', 'variance' or None")
        self.copies, self.summed, self.least, self.rounds = copies, summed, least, rounds
        self.jitter = from_fields(Jitter, jitter, "jitter")
        growth = as_growth(growth, Growth(memory_size=1_000_000, leaf_values="model", patience=1, retries=2))
        super().__init__(env, *args, growth=growth, **settings)

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
        phase, tried = self.phase, self._tried
        for _ in range(self.rounds):
            self._tried = tried  # a further round meets nothing new, but the phase may have
            super()._refine()
            self.phase = phase + 1
            if not self.aliased or self.growth.memory == "clear":
                break

    def _best_question(
        self, leaf: Node, percepts: list[Any], evidence: Evidence
    ) -> tuple[Question, np.ndarray] | None:
        if self.summed is None:
            return super()._best_question(leaf, percepts, evidence)
        if len(percepts) < 2 * self.least:
            return None
        judges = np.sort(self.rng.permutation(len(percepts))[:_JUDGES])
        judged = evidence if len(judges) == len(percepts) else evidence.of_percepts(judges)
        shown = [percepts[judge] for judge in judges]
        for attempt in range(1 + self.growth.retries):
            questions = self.vocabulary.candidates(leaf, shown, self.rng, attempt)
            if not questions:
                continue
            best = best_summed_split(
                judged,
                self._shares(questions, shown),
                summed=self.summed,
                cross_validated=self.growth.cross_validated,
                least=self.least,
            )
            if best is None:
                continue
            chosen = questions[best]
            answers = np.array([self.vocabulary.answer(chosen, percept) for percept in percepts])
            if 0 < answers.sum() < len(answers):
                return chosen, answers
        return None

    def _shares(self, questions: Any, percepts: list[Any]) -> np.ndarray:
        """How far the answers of percepts are yes, `(P, Q)` in [0, 1]."""
        return np.array([self.vocabulary.answers(questions, percept) for percept in percepts], np.float32)

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
        return {
            **super()._settings(),
            "copies": self.copies,
            "jitter": asdict(self.jitter),
            "summed": self.summed,
            "least": self.least,
            "rounds": self.rounds,
        }
