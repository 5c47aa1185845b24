"""Dense motion of the ink's own texture, made blind to light.

Contact changes the light over millimetres, the ink's grain over tenths: each channel's logarithm loses its mean
over `GRAIN_PX` pixels (a factor of light drops out) and is divided by its standard deviation there (so does
contrast). What is left is followed by OpenCV's inverse-search flow (Kroeger et al., ECCV 2016), both ways:
where the way forth and the way back do not meet, the two errors differ, and half their squared difference is
the variance. Noise of the frames themselves sets the least contrast that counts as texture; below it nothing is
known.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.records import Bools, Bytes, Floats

GRAIN_PX = 5.0
CONTRAST_PX = 12.0
ROUND_TRIP_PX = 1.0
LEAST_KNOWN = 0.5  # share of the view
TEXTURE_OVER_NOISE = 1.5
CORRELATION_PX = 8.0  # the flow's own patch


def grain(rgb: Bytes) -> tuple[Floats, Floats]:
    """The frame's texture (H, W) of unit contrast, and the standard deviation (H, W) of the noise in it."""
    light = np.log1p(rgb.astype(np.float32))
    fine = light - cv2.GaussianBlur(light, (0, 0), GRAIN_PX)
    fine = cv2.GaussianBlur(fine.mean(axis=2), (0, 0), 0.7)
    contrast = np.sqrt(cv2.GaussianBlur(fine**2, (0, 0), CONTRAST_PX))
    noise = _noise(light.mean(axis=2))
    scale = np.maximum(contrast, noise)
    return np.asarray(fine / scale, dtype=np.float64), np.asarray(noise / scale, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Texture:
    """The untouched gel's grain, made ready once: `picture` for the flow, `noise` (H, W), `slope` its mean square
    gradient, `known` (H, W) where it stands out of the noise."""

    picture: Bytes
    noise: Floats
    slope: Floats
    known: Bools


def read_texture(before: Bytes) -> Texture:
    """The texture of an untouched frame (H, W, 3)."""
    first, noise = grain(before)
    slope = cv2.GaussianBlur((np.gradient(first, axis=1) ** 2 + np.gradient(first, axis=0) ** 2) / 2, (0, 0),
                             CORRELATION_PX)  # fmt: skip
    return Texture(_as_bytes(first), noise, np.asarray(slope, dtype=np.float64), noise * TEXTURE_OVER_NOISE < 1)


def follow_texture(before: Texture, after: Bytes) -> tuple[Floats, Floats, Bools] | None:
    """Motion (H, W, 2) in pixels of what was at each pixel of `before`, its standard deviation, and where valid.

    None where the texture drowns in the noise over LEAST_KNOWN of either picture: the untouched one is often a
    mean of many, and shows more than one frame can.
    """
    second, noise = grain(after)
    known = before.known & (noise * TEXTURE_OVER_NOISE < 1)
    if known.mean() < LEAST_KNOWN:
        return None
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setFinestScale(0)
    flow.setUseSpatialPropagation(True)
    images = [before.picture, _as_bytes(second)]
    forth = flow.calc(images[0], images[1], None)
    back = flow.calc(images[1], images[0], None)
    rows, columns = second.shape
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    returned = cv2.remap(
        back, x + forth[..., 0], y + forth[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    miss = ((forth + returned) ** 2).mean(axis=2) / 2
    variance = cv2.GaussianBlur(miss, (0, 0), CORRELATION_PX)
    inside = (x + forth[..., 0] >= 0) & (x + forth[..., 0] <= columns - 1)
    inside &= (y + forth[..., 1] >= 0) & (y + forth[..., 1] <= rows - 1)
    least = 2 * before.noise**2 / (CORRELATION_PX**2 * np.maximum(before.slope, 1e-12))
    std = np.asarray(np.sqrt(variance + least), dtype=np.float64)
    return forth.astype(np.float64), std, known & inside & (std < ROUND_TRIP_PX)


def _noise(light: np.ndarray) -> float:
    """Standard deviation of a pixel's noise from the second differences of its logarithm (Immerkaer 1996)."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    step = cv2.filter2D(light, cv2.CV_32F, kernel)
    return float(1.4826 * np.median(np.abs(step)) / 6) + 1e-6


def _as_bytes(texture: Floats) -> Bytes:
    return np.asarray(np.clip(128 + 40 * texture, 0, 255), dtype=np.uint8)
