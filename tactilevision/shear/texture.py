"""Dense motion of the ink's own texture, made blind to light.

Contact changes the light over millimetres, the ink's grain over tenths: each channel's logarithm loses its mean
over `GRAIN_PX` pixels, so a factor of light drops out. Ink darkens all colours alike while noise is each channel's
own: what two channels differ by is noise, which gives each channel's variance (three-cornered hat),

    2 s_r^2 = V(r - g) + V(r - b) - V(g - b),

so that dark and noisy channels weigh little where they are dark. The weighted mean is divided by its contrast and
followed by OpenCV's inverse-search flow (Kroeger et al., ECCV 2016), both ways. Standard deviation: half the
squared difference where the way forth and the way back do not meet, and what is left between the two pictures
after the motion is undone, over the texture's slope: noise, and light that changed too fast to drop out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, Bytes, Floats

GRAIN_PX = 2.0  # px: size of the texture's grains
CONTRAST_PX = 12.0  # px over which contrast and noise are measured
ROUND_TRIP_PX = 1.0  # px: flow there and back that ends farther off is lost
MIN_KNOWN = 0.5  # share of the view
TEXTURE_OVER_NOISE = 1.5  # times the noise: weaker texture cannot be followed
CORRELATION_PX = 8.0  # the flow's own patch
Singles = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Texture:
    """The untouched gel's grain, made ready once: `weights` (H, W, 3) of the channels, `pattern` (H, W) of unit
    contrast, `slope` its mean square gradient, `known` (H, W) where it stands out of the noise."""

    weights: Singles
    pattern: Singles
    slope: Singles
    known: Bools


def read_texture(before: Bytes) -> Texture:
    """The texture of an untouched frame (H, W, 3)."""
    fine = _fine(before)
    variance = _channel_noise(fine)
    weights = np.asarray(1 / variance / (1 / variance).sum(axis=2, keepdims=True), dtype=np.float32)
    pattern, known = _pattern(fine, weights)
    along, down = (cv2.Sobel(pattern, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    slope = _smooth(np.asarray((along**2 + down**2) / 2), CORRELATION_PX)
    return Texture(weights, pattern, slope, known)


def follow_texture(before: Texture, after: Bytes) -> tuple[Floats, Floats, Bools] | None:
    """Motion (H, W, 2) in px of what was at each pixel of `before`, its standard deviation, and where valid.

    None where the texture drowns in the noise over MIN_KNOWN of either picture: the untouched one is often a
    mean of many, and shows more than one frame can.
    """
    second, seen = _pattern(_fine(after), before.weights)
    if (before.known & seen).mean() < MIN_KNOWN:
        return None  # under a contact the light's own change passes for noise here; what is left judges there
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setFinestScale(0)
    flow.setUseSpatialPropagation(True)
    images = [_as_bytes(before.pattern), _as_bytes(second)]
    forth = flow.calc(images[0], images[1], None)
    back = flow.calc(images[1], images[0], None)
    rows, columns = second.shape
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    to_x, to_y = x + forth[..., 0], y + forth[..., 1]
    returned = cv2.remap(back, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    undone = cv2.remap(second, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    apart = _smooth(((forth + returned) ** 2).mean(axis=2) / 2, CORRELATION_PX)
    left = _smooth((undone - before.pattern) ** 2, CORRELATION_PX)
    patch = CORRELATION_PX / GRAIN_PX  # independent grains along a side of what the flow matches
    std = np.sqrt(apart + left / (patch**2 * np.maximum(before.slope, 1e-12)))
    inside = (to_x >= 0) & (to_x <= columns - 1) & (to_y >= 0) & (to_y <= rows - 1)
    valid = np.asarray(before.known & inside & (std < ROUND_TRIP_PX), dtype=np.bool_)
    return forth.astype(np.float64), std.astype(np.float64), valid


def _fine(rgb: Bytes) -> Singles:
    """The logarithm of each channel (H, W, 3) without what is coarser than the grain."""
    light = np.log1p(rgb.astype(np.float32))
    return np.asarray(cv2.GaussianBlur(light, (0, 0), 0.7) - cv2.GaussianBlur(light, (0, 0), GRAIN_PX))


def _channel_noise(fine: Singles) -> Singles:
    """Variance of each channel's own noise (H, W, 3), from what the channels differ by."""
    r, g, b = cv2.split(fine)
    rg, rb, gb = (_smooth(one**2, CONTRAST_PX) for one in (r - g, r - b, g - b))
    found = np.stack([rg + rb - gb, rg + gb - rb, rb + gb - rg], axis=2) / 2
    return np.asarray(np.maximum(found, 0.02 * (rg + rb + gb)[..., None]) + 1e-9)


def _pattern(fine: Singles, weights: Singles) -> tuple[Singles, Bools]:
    """The weighted mean (H, W) of unit contrast, and where it stands out of the noise."""
    mean = np.einsum("hwc,hwc->hw", fine, weights)
    noise = np.einsum("hwc,hwc->hw", _channel_noise(fine), weights**2)
    power = _smooth(mean**2, CONTRAST_PX)
    scale = np.sqrt(np.maximum(power, noise))
    return np.asarray(mean / scale), np.asarray(power > (1 + TEXTURE_OVER_NOISE**2) * noise, dtype=np.bool_)


def _smooth(picture: npt.NDArray[Any], size_px: float) -> Singles:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), size_px), dtype=np.float32)


def _as_bytes(texture: Singles) -> Bytes:
    return np.asarray(np.clip(128 + 40 * texture, 0, 255), dtype=np.uint8)
