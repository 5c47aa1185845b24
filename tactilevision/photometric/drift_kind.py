"""Which kind of drift is it? One without a pattern, stray light's, that of lamps which fade apart, or a lean.

    d(I_c^p) / p I_c^(p-1) = I_c (g_0 + g_x X + g_y Y) + I_c (b + sum_j m_j (l_j - l_c)) / p l_c
                             + (I_c + s) (J_c grad) (A + B d/L) exp(-d / L)

I is the untouched picture, c a channel and j the other two, I^p the light that made it (`response.py`), l that
light, its mean 1 in each channel. Exposure and supply dim all channels alike: g_x, g_y, b, m are 0. A stray light
that does not fade with the lamps leaves b = -p g_0 times it. Lamps add up in light, so what the fading of one
leaves is a mixture of channels, m, exactly; m_j has the sign of what channel j gained over c, as it is a part of
that lamp's light that c sees. A lean is for what is none of these; lamps fade apart under one as
well, as where stray light is uneven itself.
The last term is the gel's own slope at a distance d beside the contacts, which is no drift: J (3, 2) is what a
slope makes of colours, s the softening of `change.py`, A and B are free. Where J is not known, each channel has A
and B of its own in x and in y. L, about the thickness of a gel, need not be right.
Each kind is a prior on g_x, g_y, b, m, and the kinds count as far as the untouched gel makes them likely (Bayesian
evidence of a linear model; Bishop, Pattern Recognition and Machine Learning, 3.5). Noise is what the frame's own
blocks show against their neighbours. Valid where errors hang together over no more than CORRELATED blocks.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.middle import median
from tactilevision.records import Bools, Floats

# stray light and its deviation in parts of the light, lean in parts of g_0; m and its deviation, and lean once
# more, in parts of that by which channels left each other
KINDS = np.array(
    [
        (0.0, 0.0, 0.003, 0.0, 0.0, 0.03),
        (0.1, 0.1, 0.003, 0.0, 0.0, 0.03),
        (0.0, 0.15, 0.003, 0.2, 0.2, 0.03),
        (0.0, 0.0, 0.3, 0.0, 0.0, 0.3),
        (0.0, 0.15, 0.1, 0.2, 0.2, 0.1),
    ]
)
OFTEN = np.array([1.0, 1.0, 1.0, 1.0, 0.05])  # each kind, beforehand; all at once is rare
LEAST = 1e-4
FREE = 10.0  # g_0 and slopes: anything
CORRELATED = 6.0
FALL = 10.0  # L in parts of the picture's width
TERMS = 6  # g_0, g_x, g_y, b, m, m
OTHERS = ((1, 2), (0, 2), (0, 1))  # the other two channels of each
ROOM = 2  # blocks round the picture, so that slopes at its border are known
QUIET = 0.05  # least noise, in parts of what a block's is taken to be


def slopes_beside(touched: Bools) -> Floats:
    """Slopes (2 forms, x and y, h * w) of gel beside `touched` blocks (h, w), of no known size."""
    wide = cv2.copyMakeBorder(np.asarray(~touched, np.uint8), *(ROOM,) * 4, cv2.BORDER_CONSTANT, value=1)
    away = cv2.distanceTransform(wide, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * np.float32(FALL / touched.shape[1])
    height = cv2.exp(-away)
    inside = slice(ROOM, -ROOM), slice(ROOM, -ROOM)
    return np.stack(
        [
            cv2.Sobel(form, cv2.CV_64F, *axis, scale=0.125)[inside].ravel()
            for form in (height, away * height)
            for axis in ((1, 0), (0, 1))
        ]
    ).reshape(2, 2, -1)


def noise_of(change: Floats, weights: Floats) -> float:
    """How noisy blocks (3, h, w) are against their neighbours in a row; `weights` (h, w) of those that count."""
    bent = np.abs(change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2])[:, weights[:, 1:-1] > 0.5]
    return max(QUIET, 1.4826 / np.sqrt(6.0) * float(median(bent.ravel()))) if bent.size else 1.0


def drift_of(
    change: Floats,
    weights: Floats,
    terms: Floats,
    *,
    beside: Floats | None,
    shared: bool,
    gain: Floats,
    power: int,
) -> tuple[Floats, Floats]:
    """g_0, g_x, g_y, b, m, m (3 channels, 6), and their covariance (18, 18).

    `change` (3, blocks), the equation's left side, `terms` (3, 6, blocks) and what slopes `beside` a contact make
    of it (3, k, blocks) are in deviations of a block's noise, `weights` (blocks,); k amplitudes are `shared` by
    the channels or each channel's own; `gain` (3,) is the light's, roughly.
    """
    normal, right = _normal(change, weights, terms, beside=beside, shared=shared)
    usual, std = _expected(len(right), gain, power)
    each = np.arange(len(right))
    held = np.repeat(normal[None], len(KINDS), axis=0)
    held[:, each, each] += std**-2
    pulled = right + usual / std**2
    spread = np.linalg.inv(held)
    found = np.matmul(spread, pulled[..., None])[..., 0]
    told = np.sum(pulled * found, axis=1) - np.linalg.slogdet(held)[1]
    told -= np.sum(2.0 * np.log(std) + (usual / std) ** 2, axis=1)
    likely = OFTEN * np.exp(0.5 * (told - told.max()))
    likely /= likely.sum()
    mean = likely @ found
    apart = found - mean
    spread += apart[:, :, None] * apart[:, None, :]
    told_of = 3 * TERMS
    return mean[:told_of].reshape(3, TERMS), np.tensordot(likely, spread, axes=1)[:told_of, :told_of]


def _normal(
    change: Floats, weights: Floats, terms: Floats, *, beside: Floats | None, shared: bool
) -> tuple[Floats, Floats]:
    """Normal equations (n, n) and right side (n,) of all channels at once, slopes behind what is sought."""
    all_terms = terms if beside is None else np.concatenate([terms, beside], axis=1)
    heavy = all_terms * (weights / CORRELATED)
    blocks, sides = np.matmul(heavy, all_terms.transpose(0, 2, 1)), np.matmul(heavy, change[:, :, None])[..., 0]
    more = all_terms.shape[1] - TERMS
    count = 3 * TERMS + (more if shared else 3 * more)
    normal, right = np.zeros((count, count)), np.zeros(count)
    for c, (block, side) in enumerate(zip(blocks, sides, strict=True)):
        slopes = 3 * TERMS + (0 if shared else more * c) + np.arange(more)
        at = np.concatenate([TERMS * c + np.arange(TERMS), slopes])
        normal[np.ix_(at, at)] += block
        right[at] += side
    return normal, right


def _expected(terms: int, gain: Floats, power: int) -> tuple[Floats, Floats]:
    """What the coefficients are under each kind (kinds, terms), and the deviations from it."""
    common, apart = np.abs(gain), float(np.abs(gain - median(gain)).max())
    stray, stray_std, lean, mixed, mixed_std, uneven = KINDS.T[:, :, None]
    usual, std = np.zeros((2, len(KINDS), 3, TERMS))
    std[..., 0] = FREE
    std[..., 1:3] = ((lean * common + uneven * apart + LEAST) / power)[..., None]
    usual[..., 3], std[..., 3] = -stray * gain, stray_std * common + LEAST
    usual[..., 4:] = mixed[..., None] * (gain[np.array(OTHERS)] - gain[:, None])
    std[..., 4:] = (mixed_std * apart + LEAST)[..., None]
    rest = len(KINDS), terms - 3 * TERMS
    usual, std = (values.reshape(len(KINDS), -1) for values in (usual, std))
    return np.hstack([usual, np.zeros(rest)]), np.hstack([std, np.full(rest, FREE)])
