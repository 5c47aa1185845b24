"""Whether the light tells both directions of slope apart, from what the balls did to the colours.

To first order in slope, and in place X, Y (from -1 to 1) for lamps that are near, a colour changes by

    u / sigma = A(X, Y) (p, q),        A = A0 + A1 X + A2 Y        (3, 2), by noise of one pixel

Its smaller singular value s says in which direction a slope is hidden worst: one of 1/s stands out of a pixel's
noise by one deviation. Two lamps of one colour opposite each other, or lamps of one colour all round, leave a
direction without any change (s = 0), however bright they are, and no method can then read it.
Samples are weighed as in the fit. What is of second order in slope is even in it, and does no harm: balls show all
directions alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.photometric.ball.samples import TYPICAL, Samples

MAX_PLACES = 500  # places at which A is looked at
MIN_NOISE = 1e-9  # relative noise of a colour that is not looked at, whose change is 0
MIN_ANSWER = 1e-6  # change of colour in deviations per unit of slope: none


@dataclass(frozen=True, slots=True)
class Observability:
    """`best`, `worst`: the slopes that are one pixel's noise along the directions told best and worst, medians
    over the balls' places; `worst_deg` that direction, from x towards y."""

    best: float
    worst: float
    worst_deg: float


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
    return Observability(float(best), float(worst), float(np.degrees(np.arctan2(least[1], least[0])) % 180.0))
