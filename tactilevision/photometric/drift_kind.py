"""Which kind of drift is it? One without a pattern, stray light's, that of lamps which fade apart, or a lean.

    dI_c = I_c (g_0 + g_x X + g_y Y) + b + sum_j m_j (I_j k_cj - I_c)
           + I_c (A_0 + A_x X + A_y Y) de/dX + I_c (B_0 + B_x X + B_y Y) de/dY        e = exp(-d / L)

I is the untouched picture, c a channel and j the other two, k_cj what makes them as bright on the mean. Exposure
and supply dim all channels alike: g_x, g_y, b, m are 0. Under a stray light b that does not fade with the lamps
they leave b = -g_0 times it. A lamp has a colour and a pattern; three channels show the patterns of three lamps
mixed alike all over the picture, so what the fading of one leaves is a mixture of channels, m (in linear light
just that; seen through a gamma of 1.8 some 4 % of the fading is left, of which a plane g_x, g_y leaves 8 to 20).
A lean is for what is none of these. The last terms are the gel's own slope at a distance d beside the contacts,
which is no drift. They are free in each channel; near lights answer to a slope differently from place to place,
which round a contact does not cancel out. L, about the thickness of a gel, need not be right. Each kind is a prior
on g_x, g_y, b, m, and the kinds count as far as the untouched gel makes them likely (Bayesian evidence of a linear
model; Bishop, Pattern Recognition and Machine Learning, 3.5). Valid where errors hang together over no more than
CORRELATED blocks.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.middle import median
from tactilevision.records import Bools, Floats

# stray light and its deviation in parts of the picture, lean in parts of g_0; m, and lean once more, in parts of
# that by which channels left each other
KINDS = np.array(
    [
        (0.0, 0.0, 0.003, 0.0, 0.03),
        (0.25, 0.25, 0.003, 0.0, 0.03),
        (0.0, 0.25, 0.003, 0.5, 0.03),
        (0.0, 0.0, 0.3, 0.0, 0.3),
    ]
)
LEAST = 1e-4
FREE = 10.0  # g_0 and slopes: anything
CORRELATED = 8.0  # blocks: slopes beside a contact that are no exponential, wrong over L by L
FALL = 10.0  # L in parts of the picture's width
TERMS = 6  # g_0, g_x, g_y, b, m, m


def slopes_beside(touched: Bools) -> Floats:
    """Slopes (6, h * w) of gel beside `touched` blocks (h, w), of no known size, and the same times X and Y."""
    away = cv2.distanceTransform(np.asarray(~touched, np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    height = np.exp(away * (-FALL / touched.shape[1]))
    slopes = np.stack([cv2.Sobel(height, cv2.CV_64F, *axis) for axis in ((1, 0), (0, 1))])
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in touched.shape), indexing="ij")
    return np.concatenate([slopes, x * slopes, y * slopes]).reshape(6, -1)


def drift_of(
    change: Floats, weights: Floats, terms: Floats, *, constant: Floats, level: Floats
) -> tuple[Floats, Floats]:
    """g_0, g_x, g_y, b, m, m (3 channels, 6), b in grey levels, and their covariance (3, 6, 6).

    `change` (3, blocks) and `terms` (3, 6 or 12, blocks), those of the equation, are in deviations of a block's
    noise, `weights` (blocks,); `constant` (3,) is g_0, roughly, and `level` (3,) the channels' mean grey level.
    """
    usual, std = _expected(terms.shape[1], constant, level)
    each = np.arange(terms.shape[1])
    normal = np.empty((*std.shape, len(each)))
    normal[:] = np.matmul(terms * weights, terms.transpose(0, 2, 1)) / CORRELATED
    normal[..., each, each] += std**-2
    right = np.matmul(terms, (change * weights)[:, :, None])[..., 0] / CORRELATED + usual / std**2
    spread = np.linalg.inv(normal)
    found = np.matmul(spread, right[..., None])[..., 0]
    told = np.sum(right * found, axis=(1, 2)) - np.linalg.slogdet(normal)[1].sum(axis=1)
    told -= np.sum(2.0 * np.log(std) + (usual / std) ** 2, axis=(1, 2))
    likely = np.exp(0.5 * (told - told.max()))
    likely /= likely.sum()
    mean = np.tensordot(likely, found, axes=1)
    apart = found - mean
    spread += apart[..., :, None] * apart[..., None, :]
    return mean[:, :TERMS], np.tensordot(likely, spread, axes=1)[:, :TERMS, :TERMS]


def _expected(terms: int, constant: Floats, level: Floats) -> tuple[Floats, Floats]:
    """What the coefficients are under each kind (kinds, 3, terms), and the deviations from it."""
    common, apart = np.abs(constant), float(np.abs(constant - median(constant)).max())
    stray, stray_std, lean, mixed, uneven = KINDS.T[:, :, None]
    usual = np.zeros((len(KINDS), len(constant), terms))
    std = np.full_like(usual, FREE)
    usual[..., 3] = -stray * constant * level
    std[..., 1:3] = (lean * common + uneven * apart + LEAST)[..., None]
    std[..., 3] = (stray_std * common + LEAST) * level
    std[..., 4:TERMS] = (mixed * apart + LEAST)[..., None]
    return usual, std
