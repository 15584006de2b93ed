"""Spectral residual saliency (Hou & Zhang 2007): the floor that any saliency model should beat.

What is unusual in the log amplitude of the spectrum of a 64-pixel glance, put back into the image.
It knows neither colours nor orientations and cannot be told what to look for.
"""

from __future__ import annotations

import cv2
import numpy as np

from attn_tree.vision.retina import Retina

_SIDE = 64  # of the glance, as in the paper
_BLUR = 2.5  # standard deviation of the final smoothing, as in the authors' program


def spectral_residual(image: np.ndarray | Retina) -> np.ndarray:
    """Saliency `(H, W)` float32 of an image, `(H, W, 3)` or `(H, W)` uint8, or of a retina on it.

    Reads a glance of 64 pixels on the longer side, in the *selection* ledger.
    """
    retina = image if isinstance(image, Retina) else Retina(image)
    share = _SIDE / max(retina.width, retina.height)
    seen = retina.glance((max(round(share * retina.width), 1), max(round(share * retina.height), 1)))
    grey = cv2.cvtColor(seen, cv2.COLOR_RGB2GRAY) if seen.ndim == 3 else seen
    spectrum = np.fft.fft2(grey)
    amplitude = np.log(np.abs(spectrum) + 1e-9)
    residual = amplitude - cv2.blur(amplitude, (3, 3))
    unusual = np.abs(np.fft.ifft2(np.exp(residual + 1j * np.angle(spectrum)))) ** 2
    smooth = cv2.GaussianBlur(unusual.astype(np.float32), (0, 0), _BLUR)
    return cv2.resize(smooth, (retina.width, retina.height), interpolation=cv2.INTER_LINEAR)
