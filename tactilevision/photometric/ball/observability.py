"""Whether the light tells both directions of slope apart, from what the balls did to the colours.

To first order in slope, and in place X, Y (from -1 to 1) for lamps that are near, a colour changes by

    u / sigma = A(X, Y) (p, q),        A = A0 + A1 X + A2 Y        (3, 2), by noise of one pixel

Its smaller singular value s says in which direction a slope is hidden worst: one of 1/s stands out of a pixel's
noise by one deviation. Two lamps of one colour opposite each other, or lamps of one colour all round, leave a
direction without any change (s = 0), however bright they are, and no method can then read it.
Where no colour lights the gel from more than half of the circle, two lamps are all there are: the widest gap
between the directions in which colours grow brighter says so. Lamps of one colour that face each other have none.
Samples are weighed as in the fit. What is of second order in slope is even in it, and does no harm: balls show all
directions alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.photometric.ball.samples import TYPICAL, Samples
from tactilevision.records import Floats, Pair

MAX_PLACES = 500  # places at which A is looked at
MIN_NOISE = 1e-9  # relative noise of a colour that is not looked at, whose change is 0
MIN_SHARE = 0.1  # of the greatest answer: a colour that answers less has no lamp of its own
MIN_ANSWER = 1e-6  # change of colour in deviations per unit of slope: none


@dataclass(frozen=True, slots=True)
class Observability:
    """`best`, `worst`: the slopes that are one pixel's noise along the directions told best and worst, medians
    over the balls' places; `worst_deg` that direction, from x towards y. `gap_deg`: the widest gap between sides
    that colours light the gel from, about `dark_deg`; 0 where a colour is overexposed and was not looked at."""

    best: float
    worst: float
    worst_deg: float
    gap_deg: float = 0.0
    dark_deg: float = 0.0


def slope_observability(samples: Samples) -> Observability:
    """What the colours of `samples`, whose noise is known, say of each direction of slope."""
    assert samples.noise is not None
    x, y = samples.place.T
    where = np.stack([np.ones_like(x), x, y], axis=1)
    design = (where[:, :, None] * samples.slopes[:, None, :]).reshape(len(x), 6)
    weights = 1.0 / np.sqrt(np.sum(samples.slopes**2, axis=1) + TYPICAL**2)
    signal = samples.change / np.maximum(samples.noise, MIN_NOISE)
    answers = np.linalg.lstsq(design * weights[:, None], signal * weights[:, None], rcond=None)[0].reshape(3, 2, 3)
    changes = np.einsum("nm,mkc->nkc", where[:: max(1, len(x) // MAX_PLACES)], answers)
    best, worst = 1.0 / np.maximum(np.median(np.linalg.svd(changes, compute_uv=False), axis=0), MIN_ANSWER)
    least = np.linalg.eigh(np.einsum("nkc,nlc->kl", changes, changes))[1][:, 0]
    gap = (0.0, 0.0) if np.any(samples.noise.max(axis=0) <= 0.0) else _dark_side(changes.mean(axis=0).T)
    return Observability(
        float(best), float(worst), float(np.degrees(np.arctan2(least[1], least[0])) % 180.0), *gap
    )


def _dark_side(changes: Floats) -> Pair:
    """The widest gap between the sides colours of `changes` (3, 2) are lit from, and its middle, in degrees."""
    answers = np.hypot(*changes.T)
    x, y = -changes[answers > MIN_SHARE * answers.max()].T  # gel that faces a lamp rises away from it
    sides = np.sort(np.degrees(np.arctan2(y, x)))
    gaps = np.diff(sides, append=sides[0] + 360.0)
    widest = int(np.argmax(gaps))
    return float(gaps[widest]), float((sides[widest] + 0.5 * gaps[widest]) % 360.0)
