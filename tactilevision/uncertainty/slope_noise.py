"""The term of the camera's noise: what noise of the slopes, pixel by pixel, makes of the surface.

    variance(x, y) = < (z - median z)^2 >      z: the surface of drawn slopes N(0, noise(x, y)^2)

z is integrated as every surface is; the mean over N_DRAWS fields is blurred, as few draws are rough.
Vanishes with the noise, and grows with its square. Assumes noise that is independent from pixel to pixel: waves
that are not stand in `untouched_gel.py`. It depends on the place alone, so it is worked out once for a method.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.integration.poisson import integrate
from tactilevision.records import Pair, SlopeMap

Picture = npt.NDArray[np.float32]
N_DRAWS = 6  # noise fields: with the blur they fix the variance to a tenth
BLUR_SHARE = 1 / 12  # of the picture's longer side: sigma of the blur; noise of a surface varies no faster


def noise_variance(noise: Picture, mm_per_px: Pair) -> Picture:
    """Variance (H, W) mm² of depth by slopes of deviation `noise` (H, W) mm/mm, at `mm_per_px` (x, y)."""
    rng = np.random.default_rng(0)  # a fixed draw: the certificate of a method does not change between runs
    total = np.zeros(noise.shape, np.float32)
    for _ in range(N_DRAWS):
        fields = rng.standard_normal((2, *noise.shape), dtype=np.float32) * noise
        surface = integrate(SlopeMap(fields[0], fields[1]), mm_per_px)
        total += (surface - np.median(surface)) ** 2
    return np.asarray(cv2.GaussianBlur(total / N_DRAWS, (0, 0), max(noise.shape) * BLUR_SHARE), np.float32)
