"""Which kind of drift is it? One without a pattern, that which stray light leaves, or one that leans.

    dI = I_0 (g_0 + g_x X + g_y Y) + b + I_0 (A de/dX + B de/dY)        e = exp(-d / L)

Exposure and supply dim all channels alike: g_x, g_y, b are 0. Under a stray light b that does not fade with the
lamps they leave b = -g_0 times it. A lamp that fades leans, by a part of what its channel left the others by. The
last term is the gel's own slope at a distance d beside the contacts, which is no drift; its size is free in
each channel, and L, about the thickness of a gel, need not be right. Each kind is a prior on g_x, g_y, b, and the
one under which the untouched gel is likeliest is taken (Bayesian evidence of a linear model; Bishop, Pattern
Recognition and Machine Learning, 3.5). Valid where errors hang together over no more than CORRELATED blocks.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.middle import median
from tactilevision.records import Bools, Floats

KINDS = np.array(
    [(0.02, 0.0), (0.02, 1.0), (0.3, 0.0)]
)  # parts of g_0: its lean, stray light in that of the picture
UNEVEN = 0.3  # lean of a lamp's drift, in parts of that by which its channel left the others
LEAST = 2e-4
FREE = 10.0  # g_0 and slopes: anything
CORRELATED = 5.0  # blocks
FALL = 10.0  # L in parts of the picture's width


def slopes_beside(touched: Bools) -> Floats:
    """Slopes (2, h * w) of gel beside `touched` blocks (h, w), of no known size."""
    away = cv2.distanceTransform(np.asarray(~touched, np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    height = np.exp(away * (-FALL / touched.shape[1]))
    return np.stack([cv2.Sobel(height, cv2.CV_64F, 1, 0), cv2.Sobel(height, cv2.CV_64F, 0, 1)]).reshape(2, -1)


def drift_of(change: Floats, weights: Floats, terms: Floats, *, constant: Floats, level: Floats) -> Floats:
    """g_0, g_x, g_y, b (3 channels, 4) of the likeliest kind, b in grey levels.

    `change` (3, blocks) and `terms` (3, 4 or 6, blocks), those of the equation, are in deviations of a block's
    noise, `weights` (blocks,); `constant` (3,) is g_0, roughly, and `level` (3,) the channels' mean grey level.
    """
    common, own = np.abs(constant), np.abs(constant - median(constant))
    std = np.full((len(KINDS), *terms.shape[:2]), FREE)
    std[..., 1] = KINDS[:, :1] * common + UNEVEN * own + LEAST
    std[..., 2] = std[..., 1]
    std[..., 3] = (KINDS[:, 1:] * common + LEAST) * level
    each = np.arange(terms.shape[1])
    normal = np.empty((*std.shape, len(each)))
    normal[:] = np.matmul(terms * weights, terms.transpose(0, 2, 1)) / CORRELATED
    normal[..., each, each] += std**-2
    right = np.matmul(terms, (change * weights)[:, :, None])[..., 0] / CORRELATED
    found = np.linalg.solve(normal, np.broadcast_to(right, std.shape)[..., None])[..., 0]
    told = np.sum(right * found, axis=(1, 2)) - np.linalg.slogdet(normal)[1].sum(axis=1)
    told -= 2.0 * np.log(std).sum(axis=(1, 2))
    return np.asarray(found[int(np.argmax(told)), :, :4])
