"""How salient each place of a glance is: the shared front-end of the trees, for a network.

The map is that of `attn_tree.vision.saliency` (the revised model of thesis 5.3.1), worked out on
the values of a glance that the network has taken in anyway. The glance is paid for by the
retina that gave it; working on its values reads nothing more, and its operations are added to
the same ledger. While no meter runs, the map of a glance seen before is remembered.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np
import torch

from attn_tree.vision.retina import Ledger, meter, metering
from attn_tree.vision.saliency import saliency_map

REMEMBERED = 4096  # maps; one of 32 × 32 takes 4 KB


class GlanceSaliency:
    """Saliency maps of glances, each of them scaled to a maximum of 1.

    Args:
        remembered: how many maps are kept for glances that come back; the oldest go first.
    """

    def __init__(self, remembered: int = REMEMBERED) -> None:
        self._limit = remembered
        self._known: OrderedDict[bytes, np.ndarray] = OrderedDict()

    def __call__(self, glances: torch.Tensor, ledgers: Sequence[Ledger] = ()) -> torch.Tensor:
        """Maps `(B, h, w)`, zeros where nothing is salient.

        Args:
            glances: `(B, C, h, w)` in [0, 1], C 3 or 1; rounded to 256 levels.
            ledgers: one per glance while a meter runs; the operations are entered there.
        """
        levels = (glances.detach() * 255).round().to(torch.uint8).permute(0, 2, 3, 1).cpu().numpy()
        if levels.shape[-1] == 1:
            levels = levels[..., 0]
        if metering():
            maps = [_counted(each, ledger) for each, ledger in zip(levels, ledgers, strict=True)]
        else:
            maps = [self._remembered(each) for each in levels]
        return torch.from_numpy(np.stack(maps)).to(glances)

    def _remembered(self, levels: np.ndarray) -> np.ndarray:
        key = levels.tobytes()
        if key not in self._known:
            self._known[key] = _scaled(saliency_map(levels))
            if len(self._known) > self._limit:
                self._known.popitem(last=False)
        return self._known[key]


def _counted(levels: np.ndarray, ledger: Ledger) -> np.ndarray:
    # The front-end opens a ledger for whatever it is given. These values have been paid for where
    # they were read, so it goes to a meter of its own, of which only the operations count.
    with meter() as inner:
        result = _scaled(saliency_map(levels))
    ledger.operations.update(inner.operations)
    return result


def _scaled(saliency: np.ndarray) -> np.ndarray:
    peak = float(saliency.max())
    return saliency / np.float32(peak) if peak > 0 else saliency.copy()
