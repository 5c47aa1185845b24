"""By how much a ball or a cone reads a gel too soft when the gel sticks to it.

At small strain a round body hardly feels friction; at large strain the gel that would slide outward is held, and

    P_stick/P_free - 1 = k(nu) (w/h)^2 R/h,     k = .10 .47 1.0 1.45 at nu = .40 .45 .48 .4999

From finite elements of balls with R = 1 to 3 h (punch_fem: an edge as round as the punch is wide makes a ball) to
w/h = .2, within a third of the surplus. A cone counts as the ball that would touch as far out as deep. The law's
free beta takes up part of it and tilts E the other way, so that E is found too low.
"""

from __future__ import annotations

import numpy as np

from calibration.fit.least_squares import Fit
from tactilevision.records import Floats, Indenter

NU = (0.40, 0.45, 0.48, 0.4999)  # at which SURPLUS was computed
SURPLUS = (0.10, 0.47, 1.00, 1.45)  # k(nu) of the equation above, by finite elements


def stuck_surplus(poisson_ratio: float, radius_over_h: Floats | float, w_over_h: Floats) -> Floats:
    """P_stick/P_free - 1 of a ball, any shape."""
    return np.asarray(np.interp(poisson_ratio, NU, SURPLUS) * np.square(w_over_h) * radius_over_h)


def stuck_shift(fitted: Fit) -> float:
    """The share by which E is found off where the gel sticks: what the fit of E and beta makes of the surplus.

    beta keeps its prior; all samples count alike.
    """
    data, e, k = fitted.data, fitted.index("youngs_modulus_MPa"), fitted.index("beta")
    strain = np.maximum(data.depth_mm, 0) / data.gel.thickness_mm
    radius = np.array(
        [
            ball_radius_mm(data.indenters[i], w)
            for i, w in zip(data.presses.indenter[data.press], data.depth_mm, strict=True)
        ]
    )
    nu = float(fitted.values[fitted.index("poisson_ratio")])
    surplus = fitted.force_N * stuck_surplus(nu, radius / data.gel.thickness_mm, strain)
    prior = fitted.parameters[k].prior
    held = 0.0 if prior is None else fitted.rms_error_N / prior.std
    matrix = np.vstack([fitted.jacobian[:, [e, k]], [0.0, held]])
    return float(np.linalg.lstsq(matrix, np.append(surplus, 0.0), rcond=None)[0][0] / fitted.values[e])


def ball_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """The ball's; for a cone of the ball that touches as far out at this depth, a^2/w with a = (2/pi) w tan."""
    if indenter.half_angle_deg is None:
        return indenter.radius_mm
    return float((2 / np.pi * np.tan(np.radians(indenter.half_angle_deg))) ** 2 * max(depth_mm, 0.0))
