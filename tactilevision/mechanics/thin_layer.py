"""Printed thin-layer corrections for a ball and a cone on a bonded layer, which multiply the half-space.

    ball:  P = 4/3 E* sqrt(R) w^1.5 (1 + b1 chi + b2 chi^2 + b3 chi^3 + b4 chi^4),     chi = sqrt(R w)/h
    cone:  P = (2/pi) E* tan(t) w^2 (1 + c1 chi + ...),                                chi = w tan(t)/h

They are quick and well known; round_contact.py is what they approximate. Measured against it at nu = .5:

    chi                 .1       .3       .5       .7      1.0
    Dimitriadis ball   -.2     -2.7     -7.7    -12.6    -16.3 %
    Garcia ball         .1       .1       .7      3.7     14.5 %
    Garcia cone         .0       .1      -.1      -.3      1.4 %

All: nu = .5, frictionless, small strain (w below a tenth of h, contact well below the ball's radius). InputError
beyond chi = 1. The exact expansion has 1.497 in second place, as Garcia has it, not 1.283.

Sources: Dimitriadis, Horkay, Maresca, Kachar, Chadwick, Biophys. J. 82 (2002) 2798, eq. 12;
Garcia, Garcia, Biophys. J. 114 (2018) 2923, cone and ball on a bonded layer.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records import Floats

CHI_RANGE = (0.0, 1.0)  # range of validity of the series
DIMITRIADIS_BALL = (1.133, 1.283, 0.769, 0.0975)  # coefficients of chi, chi², chi³, chi⁴
GARCIA_BALL = (1.133, 1.497, 1.469, 0.755)  # coefficients of chi, chi², chi³, chi⁴
GARCIA_CONE = (0.721, 0.650, 0.491, 0.225)  # coefficients of the series' powers of chi


def dimitriadis_ball(chi: npt.ArrayLike) -> Floats:
    """Dimitriadis et al. (2002), eq. 12: a ball on a bonded incompressible layer; chi (any shape) in [0, 1]."""
    return _polynomial(chi, DIMITRIADIS_BALL)


def garcia_ball(chi: npt.ArrayLike) -> Floats:
    """Garcia and Garcia (2018) for a ball on a bonded incompressible layer; chi (any shape) in [0, 1]."""
    return _polynomial(chi, GARCIA_BALL)


def garcia_cone(chi: npt.ArrayLike) -> Floats:
    """Garcia and Garcia (2018) for a cone on a bonded incompressible layer; chi (any shape) in [0, 1]."""
    return _polynomial(chi, GARCIA_CONE)


def _polynomial(chi: npt.ArrayLike, terms: tuple[float, ...]) -> Floats:
    numbers = np.asarray(chi, dtype=float)
    if not ((numbers >= CHI_RANGE[0]) & (numbers <= CHI_RANGE[1])).all():
        raise InputError(
            "the thin-layer corrections hold for chi in [0, 1]",
            where="thin_layer",
            value=float(np.max(numbers)),
            remedy="Take mechanics.round_contact.",
        )
    return np.asarray(np.polynomial.polynomial.polyval(numbers, (1.0, *terms)))
