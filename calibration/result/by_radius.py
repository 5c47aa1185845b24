"""c and beta of each of several radii: of the line through its own points.

One law for all radii ties their stiffnesses by E, nu and a/h. Friction and a rounded edge, of which it knows
nothing, change them by some per cent, each its own way: what one punch shows is the line of its own presses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.identifiability import bend_of, stiffness_of
from calibration.fit.least_squares import Fit, fit
from calibration.inputs.checks import at_one_depth
from calibration.laws.flat_punch import SILICONE_NU, FlatPunch
from calibration.model.composition import Model
from calibration.repeats.pure_error import allow_for_indenters
from tactilevision.records import Estimate

LEAST = 3  # presses, or samples of a curve, that a line and its scatter need
Line = tuple[float, Estimate, Estimate]


def own_lines(fitted: Fit) -> tuple[Line, ...]:
    """(radius, c, beta) of every radius; by the common law where one has too few points or one depth, and where
    effects are fitted along, since one radius seldom fixes them."""
    return tuple(_line(fitted, float(radius)) for radius in np.unique(fitted.data.presses.radius_mm))


def _line(fitted: Fit, radius: float) -> Line:
    plain = isinstance(fitted.model.law, FlatPunch) and not fitted.model.effects
    alone = line_alone(fitted, radius) if plain else None
    return alone or (radius, stiffness_of(fitted, radius), bend_of(fitted, radius))


def line_alone(fitted: Fit, radius: float) -> Line | None:
    """(radius, c, beta) of the line through this radius' presses; None where they are all or fix none."""
    mine = fitted.data.take(fitted.data.presses.radius_mm == radius)
    if mine.count == fitted.data.count or mine.size < LEAST or at_one_depth(mine):
        return None
    # a line knows no nu: any one serves
    gel = replace(mine.gel, poisson_ratio=SILICONE_NU[0], poisson_ratio_std=0.0)
    alone = allow_for_indenters(fit(Model(FlatPunch()), replace(mine, gel=gel)))
    return radius, stiffness_of(alone, radius), bend_of(alone, radius)
