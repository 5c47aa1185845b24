"""Which power of a grey level is light? Balls tell: their slopes are known, and light is straight in slope.

    (I / I_0)^power - 1 = (1 - c) ((1 + a p + b q) / sqrt(1 + p^2 + q^2) - 1)

holds for a matt surface under far lamps and stray light, a part c of all, with a and b polynomials of second order
in place. Both c and the power bend the answer, so c is held within STRAY_PARTS. Nearly all cameras write about the
root of light: power 1 is taken where it leaves clearly less. On simulated lights it leaves .19 to .36 of what
power 2 leaves where cameras write light, and .84 to 4.8 times as much where they write its 1.8th root.
"""

from __future__ import annotations

import numpy as np

from tactilevision.photometric.ball.samples import Samples
from tactilevision.photometric.ball.shading_fit import PLACE_ORDER, SLOPE_SOFTENING, fit_light, terms_of
from tactilevision.photometric.illumination.camera_response import LINEAR_TERMS, SOFTENING_GREY, Response
from tactilevision.records import Bools, Floats

STRAY_PARTS = (0.0, 0.1, 0.2)  # parts c of the light that are stray; more would bend the answer as the power does
MAX_RATIO = 2 / 3  # of power 2's misfit; between the .36 and .84 of simulated lights (above; test_gamma.py)
DARK_GREY = 30.0  # below, stray light and the black level bend the answer
SHADOW = 0.1  # least I / I_0
GAMMA_TERMS = terms_of({**PLACE_ORDER, 1: 2})  # over the picture, as LINEAR_TERMS


def response_of(contact: Samples, level: Floats) -> Response:
    """The response that samples of balls show; `level` (N, 3) is the untouched picture at them."""
    ratio = np.maximum(1.0 + contact.change * (level + SOFTENING_GREY) / np.maximum(level, 1.0), SHADOW)
    straight, root = (_nonlinearity(power, ratio, contact, level > DARK_GREY) for power in (1, 2))
    return Response(
        1 if straight < MAX_RATIO * root else 2, fit_light(contact, terms=GAMMA_TERMS)[: len(LINEAR_TERMS)]
    )


def _nonlinearity(power: int, ratio: Floats, contact: Samples, bright: Bools) -> float:
    """Sum of squares, in parts of I_0, of what is left of I if `power` of it is taken to be straight in slope."""
    p, q = contact.slopes.T
    x, y = contact.place.T
    square, total = p * p + q * q, np.zeros(len(STRAY_PARTS))
    upright = 1.0 / np.sqrt(1.0 + square)
    design = np.stack([upright * p**a * q**b * x**i * y**j for a, b, i, j in LINEAR_TERMS], axis=1)
    for channel, lit in zip(ratio.T, bright.T, strict=True):
        weight = (channel ** (1 - power) / (power * np.sqrt(square + SLOPE_SOFTENING**2)))[lit]
        light = [weight * (channel**power - 1.0 - (1.0 - stray) * (upright - 1.0))[lit] for stray in STRAY_PARTS]
        straight, wanted = design[lit] * weight[:, None], np.stack(light, axis=1)
        residual = wanted - straight @ np.linalg.lstsq(straight, wanted, rcond=None)[0]
        total += np.sum(residual**2, axis=0)
    return float(total.min())
