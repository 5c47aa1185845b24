"""Which kind of drift is it? One without a pattern, stray light's, that of lamps which fade apart, or a lean.

    d(I_c^p) / p I_c^(p-1) = I_c (g_0 + g_x X + g_y Y) + I_c (b + sum_j m_j (l_j - l_c)) / p l_c
                             + (I_c + s) J_c slope

I is the untouched picture, c a channel and j the other two, I^p the light that made it (`camera_response.py`), l
that light, its mean 1 in each channel. Exposure and supply dim all channels alike: g_x, g_y, b, m are 0. A stray
light that does not fade with the lamps leaves b = -p g_0 times it. Lamps add up in light, so what the fading of
one leaves is a mixture of channels, m, exactly; m_j has the sign of what channel j gained over c, as it is a part
of that lamp's light that c sees. A lean is for what is none of these; lamps fade apart under one as well, as where
stray light is uneven itself. The last term is the gel's own slope beside the contacts, which is no drift: J (3, 2)
is what a slope makes of colours, s the softening of `colour_change.py`. Which shape it has is left open: in each
block a slope may be as steep as SLOPE_SHARE of those under the contact times exp(-d / a), at a distance d from a
contact of radius a, and is integrated out (a Gaussian of that deviation). So near a contact drift is read in the
one combination of three colours that slopes leave alone, and far from it in all. Where J is not known, slopes may
change each channel by itself. Each kind is a prior on g_0 (of all channels alike, or of each its own), g_x, g_y,
b, m, and the kinds count as far as the untouched gel makes them likely (Bayesian evidence of a linear model;
Bishop, Pattern Recognition and Machine Learning, 3.5). Noise is what the frame's own blocks show against their
neighbours. Valid where errors hang together over no more than CORRELATED blocks.
"""

from __future__ import annotations

import numpy as np

from tactilevision.distance import distance_px
from tactilevision.records import Bools, Floats
from tactilevision.robust import MAD_TO_STD, median

UNBOUNDED = 1e4  # of g_0: a deviation so large that each channel drifts by itself
# stray light and its deviation in parts of the light, lean in parts of g_0; m and its deviation, and lean once
# more, in parts of that by which channels left each other; that by which they do, in parts of g_0, or anything
DRIFT_KINDS = np.array(
    [
        (0.0, 0.0, 0.003, 0.0, 0.0, 0.03, 0.02),
        (0.1, 0.1, 0.003, 0.0, 0.0, 0.03, 0.02),
        (0.0, 0.0, 0.003, 0.0, 0.0, 0.03, UNBOUNDED),
        (0.1, 0.1, 0.003, 0.0, 0.0, 0.03, UNBOUNDED),
        (0.0, 0.15, 0.003, 0.2, 0.2, 0.03, UNBOUNDED),
        (0.0, 0.0, 0.3, 0.0, 0.0, 0.3, UNBOUNDED),
        (0.0, 0.15, 0.1, 0.2, 0.2, 0.1, UNBOUNDED),
    ]
)
PRIOR_WEIGHTS = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.05])  # each kind, beforehand; all at once is rare
MIN_STD = 1e-4  # of the light: the least deviation of any coefficient, which keeps priors invertible
COMMON_STD = 10.0  # of the light: deviation of g_0 of all channels alike, far above any drift
CORRELATED = 6.0  # blocks whose noise hangs together; more widen the covariance (test_drift_error.py)
SLOPE_SHARE = 0.4  # of the slopes under a contact, close beside it
GUESSED_SHARE = 0.04  # of its colours, where nobody knows what slopes do: more would leave nothing to read
TERMS = 6  # g_0, g_x, g_y, b, m, m
CHANNELS = np.arange(3)
TINY = 1e-30  # keeps blocks without weight from 0 / 0
COMMON_PLACES = [TERMS * c for c in range(3)]  # where g_0 stands
OTHERS = ((1, 2), (0, 2), (0, 1))  # the other two channels of each
MIN_NOISE = 0.05  # least noise, in parts of what a block's is taken to be


def likely_slopes(change: Floats, answers: Floats, *, touched: Bools) -> Floats:
    """What a slope of one deviation makes of the channels (3, k, blocks): `answers` (3, k, blocks) to slopes of 1.

    How steep the gel is under the contact, blocks `touched` (h, w), is read out of the `change` (3, blocks) there.
    `answers` are for x and y, or, k = 3, for each channel by itself.
    """
    under = touched.ravel()
    slope_rms = np.sqrt(
        np.median(np.sum(change[:, under] ** 2, axis=0) / np.sum(answers[:, :, under] ** 2, axis=(0, 1)))
    )
    distance = distance_px(~touched).ravel()
    fall = np.exp(distance * -np.sqrt(np.pi / np.count_nonzero(under)))
    return np.asarray(answers * ((SLOPE_SHARE if answers.shape[1] == 2 else GUESSED_SHARE) * slope_rms * fall))


def noise_of(change: Floats, weights: Floats) -> float:
    """Relative noise of blocks (3, h, w) by their neighbours in a row, 1 as assumed.

    `weights` (h, w) of those that count.
    """
    bend = np.abs(change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2])[:, weights[:, 1:-1] > 0.5]
    return max(MIN_NOISE, MAD_TO_STD / np.sqrt(6.0) * float(median(bend.ravel()))) if bend.size else 1.0


def drift_of(
    change: Floats, weights: Floats, *, terms: Floats, slopes: Floats | None, gain: Floats, power: int
) -> tuple[Floats, Floats]:
    """g_0, g_x, g_y, b, m, m (3 channels, 6), and their covariance (18, 18).

    `change` (3, blocks), the equation's left side, `terms` (3, 6, blocks) and what a likely slope makes of it,
    `slopes` (3, k, blocks), are in deviations of a block's noise, `weights` (blocks,); `gain` (3,) is the light's,
    roughly.
    """
    normal, right = _normal(change, weights / CORRELATED, terms, slopes)
    expected, precision, log_of_spread = _expected(gain, power)
    target = right + np.matmul(precision, expected[..., None])[..., 0]
    precision += normal
    spread = np.linalg.inv(precision)
    solution = np.matmul(spread, target[..., None])[..., 0]
    log_evidence = np.sum(target * solution, axis=1) - np.linalg.slogdet(precision)[1] - log_of_spread
    probability = PRIOR_WEIGHTS * np.exp(0.5 * (log_evidence - log_evidence.max()))
    probability /= probability.sum()
    mean = probability @ solution
    deviation = solution - mean
    spread += deviation[:, :, None] * deviation[:, None, :]
    return mean.reshape(3, TERMS), np.tensordot(probability, spread, axes=1)


def _normal(change: Floats, weights: Floats, terms: Floats, slopes: Floats | None) -> tuple[Floats, Floats]:
    """Normal equations (18, 18) and right side (18,) of all channels; noise is 1, and slopes add to it."""
    trust = np.zeros((3, 3, len(weights)))
    trust[CHANNELS, CHANNELS] = weights
    for unit in () if slopes is None else slopes.transpose(1, 0, 2):  # one slope after the other is integrated out
        projection = np.sum(trust * unit, axis=1)
        trust -= projection[:, None] * (projection / (weights + np.sum(unit * projection, axis=0) + TINY))
    weighted = (trust[:, :, None] * terms).reshape(3, 3 * TERMS, -1)
    normal = np.matmul(terms, weighted.transpose(0, 2, 1)).reshape(3 * TERMS, 3 * TERMS)
    return normal, np.matmul(terms, np.sum(trust * change, axis=1)[..., None]).ravel()


def _expected(gain: Floats, power: int) -> tuple[Floats, Floats, Floats]:
    """What the coefficients are under each kind (kinds, 18), the inverse of their covariance about it (kinds, 18,
    18), and the log of its determinant and of what is expected (kinds,)."""
    common, spread = np.abs(gain), float(np.abs(gain - median(gain)).max())
    stray, stray_std, lean, mixed, mixed_std, uneven, alike = DRIFT_KINDS.T[:, :, None]
    expected, std = np.zeros((2, len(DRIFT_KINDS), 3, TERMS))
    gain_std = np.minimum(alike * float(common.max()) + MIN_STD, COMMON_STD)
    std[..., 0] = gain_std / power
    std[..., 1:3] = ((lean * common + uneven * spread + MIN_STD) / power)[..., None]
    expected[..., 3], std[..., 3] = -stray * gain, stray_std * common + MIN_STD
    expected[..., 4:] = mixed[..., None] * (gain[np.array(OTHERS)] - gain[:, None])
    std[..., 4:] = (mixed_std * spread + MIN_STD)[..., None]
    expected, std = (values.reshape(len(DRIFT_KINDS), -1) for values in (expected, std))
    precision, diagonal = np.zeros((len(DRIFT_KINDS), 3 * TERMS, 3 * TERMS)), np.arange(3 * TERMS)
    precision[:, diagonal, diagonal] = std**-2
    weight = std[:, 0] ** -2  # what all channels have in common, COMMON_STD, beside what each has of its own
    shared = weight / (3.0 + 1.0 / (COMMON_STD**2 * weight))
    for c in COMMON_PLACES:
        precision[:, c, COMMON_PLACES] -= shared[:, None]
    log_of_spread = 2.0 * np.log(std).sum(axis=1) + np.log1p(3.0 * COMMON_STD**2 * weight)
    return expected, precision, log_of_spread + np.sum((expected / std) ** 2, axis=1)
