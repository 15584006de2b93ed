"""Q-learning with a table: the controls without any attention.

- `TabularQ` is told the hidden state: the thesis's "traditional RL" (3.2), the
  bound that no method which has to look can beat.
- `ThumbnailQ` has one row for each distinct thumbnail it meets. It reads a few
  dozen values and asks no question at all. Where one photograph stands for one
  cell this is enough, and any claim for attention has to be made elsewhere. So that
  it is no straw man on new views, a thumbnail never met in learning is taken for the
  nearest one that was, as the trees take an unknown answer for the nearest known one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback

from attn_tree.percepts import as_image
from attn_tree.q_learning import TableLearner
from attn_tree.rates import Rate
from attn_tree.vision.retina import Retina, metering
from baselines.bank_extractor import bank_of

_NOTHING = 0  # the row before anything has been met; it stays at zero


class TabularQ(TableLearner):
    """Q-learning over `Discrete` observations: the hidden state of `obs="state"` environments.

    Arguments are `TableLearner`'s. It reads no pixels.
    """


class ThumbnailQ(TableLearner):
    """Q-learning over a hash of a grey thumbnail.

    Args:
        env: observations are images `(H, W, C)` or indices into the environment's `bank`.
        size: the thumbnail has `size` × `size` values …
        levels: … of this many grey levels. Two images with the same thumbnail are the same percept.
        **kwargs: `TableLearner`'s.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        size: int = 8,
        levels: int = 8,
        learning_rate: Rate = 0.7,
        gamma: float = 0.8,
        epsilon: Rate = 0.3,
        **kwargs: Any,
    ) -> None:
        if not 1 <= size <= 256 or not 2 <= levels <= 256:
            raise ValueError(f"size must be 1 to 256 and levels 2 to 256, not {size} and {levels}")
        self.size, self.levels = size, levels
        self.bank: np.ndarray | None = None
        self._row_of: dict[bytes, int] = {}
        self._rows_of_bank: np.ndarray | None = None
        self._learning = False
        super().__init__(env, learning_rate=learning_rate, gamma=gamma, epsilon=epsilon, **kwargs)

    def set_bank(self, images: np.ndarray) -> None:
        """Look indices up in other images `(n, H, W, C)` uint8 from now on."""
        self.bank = np.asarray(images)
        self._rows_of_bank = None

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 100,
        tb_log_name: str | None = None,
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> ThumbnailQ:
        """As `TableLearner.learn`; new thumbnails get rows meanwhile."""
        self._learning, self._rows_of_bank = True, None
        try:
            return super().learn(
                total_timesteps, callback, log_interval, tb_log_name, reset_num_timesteps, progress_bar
            )
        finally:
            self._learning, self._rows_of_bank = False, None

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.env is not None and isinstance(self.observation_space, spaces.Discrete):
            self.set_bank(bank_of(self.env))

    def _n_rows(self) -> int:
        return 1

    def _perceive(self, observations: Any) -> np.ndarray:
        observations = np.asarray(observations)
        if observations.ndim > 1:
            return self._look(observations)
        if self.bank is None:
            raise ValueError("this model reads indices and has no bank of images; call set_bank(images)")
        if metering():
            return self._look(self.bank[observations])
        if self._rows_of_bank is None:
            self._rows_of_bank = self._look(self.bank)
        return self._rows_of_bank[observations]

    def _look(self, images: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
        """Rows `(n,)` of images."""
        rows = np.array([self._row(image) for image in images], np.intp)
        missing = 1 + len(self._row_of) - len(self.values)
        if missing > 0:
            self.values = np.concatenate([self.values, np.zeros((missing, self.values.shape[1]))])
        return rows

    def _row(self, image: np.ndarray) -> int:
        retina = Retina(as_image(image))
        thumbnail = self._thumbnail(retina)
        row = self._row_of.get(thumbnail)
        if row is not None:
            return row
        if self._learning:
            return self._row_of.setdefault(thumbnail, 1 + len(self._row_of))
        if not self._row_of:
            return _NOTHING
        met = self._met().astype(np.int64)
        retina.count(distance_operations=met.size)
        gaps = np.abs(met - np.frombuffer(thumbnail, np.uint8)).sum(axis=1)
        return 1 + int(gaps.argmin())

    def _thumbnail(self, retina: Retina) -> bytes:
        colours = retina.glance(self.size, stage="recognition")
        grey = colours.reshape(self.size, self.size, -1).mean(axis=2)
        return (grey * (self.levels / 256)).astype(np.uint8).tobytes()

    def _met(self) -> np.ndarray:
        """Thumbnails met in learning, `(rows - 1, size²)`, in the order of their rows."""
        return np.frombuffer(b"".join(self._row_of), np.uint8).reshape(-1, self.size**2)

    def _settings(self) -> dict[str, Any]:
        return super()._settings() | {"size": self.size, "levels": self.levels}

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        meta, arrays = super()._state()
        return meta, arrays | {"thumbnails": self._met()}

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        super()._restore(meta, arrays)
        seen = np.ascontiguousarray(arrays["thumbnails"], np.uint8)
        if seen.shape != (len(self.values) - 1, self.size**2):
            raise ValueError(f"{len(self.values) - 1} thumbnails expected, {seen.shape} found")
        self._row_of = {thumbnail.tobytes(): row for row, thumbnail in enumerate(seen, start=1)}
