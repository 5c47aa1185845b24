"""Whether punches of several radii press one gel: stiffness grows with the radius as that of a bonded layer.

    c_b / c_a = (b / a) kappa(nu, b/h) / kappa(nu, a/h),    a < b

kappa grows with a/h, and the faster the larger nu is. So a gel's c/a grows at least as of the least nu that gels
have, and at most as of nu = .5. Source: mechanics/kappa.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.fit.tolerances import TOLERANCES
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory.plausible import LEAST_POISSON_RATIO
from calibration.result.by_radius import Line, line_alone
from calibration.result.poisson_routes import CONTRARY, HIGHEST
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.records import Gel

FLAG = "radii_apart"
ALLOWED = 0.15  # of c: an edge of .1 mm that is not stated takes up to 13 % off (docs/explanation/limits.md)


def radii_apart(fitted: Fit) -> str:
    """A sentence with the pair of radii whose stiffness no one gel has, the worst; else empty.

    Of the flat punch alone: an effect that is fitted along may change c with the radius.
    """
    if not isinstance(fitted.model.law, FlatPunch) or not set(fitted.model.keys) <= set(TOLERANCES):
        return ""
    gel = fitted.data.gel
    alone = (line_alone(fitted, float(radius)) for radius in np.unique(fitted.data.presses.radius_mm))
    worst = max(_contrary([line for line in alone if line], gel), default=None)
    if worst is None:
        return ""
    _, a, b, found, low, high = worst
    return (
        f"from radius_mm = {a:g} to {b:g} the stiffness c grows {found:.3g} times; one gel of thickness_mm = "
        f"{gel.thickness_mm:g} lets it grow {low:.3g} to {high:.3g} times: do not trust E. Check these radii (is "
        "one a diameter?), which presses are of which, the thickness, and whether the rig gives"
    )


def _contrary(lines: list[Line], gel: Gel) -> Iterator[tuple[float, ...]]:
    """How far beyond what theory allows (ln), both radii, the growth of c, its least and its most."""
    for (a, c_a, _), (b, c_b, _) in combinations(lines, 2):
        ratios = np.array([a, b]) / gel.thickness_mm
        inside = A_OVER_H_RANGE[0] <= ratios[0] and ratios[1] <= A_OVER_H_RANGE[1]
        if not inside or not c_a.value or not c_b.value or min(c_a.value, c_b.value) <= 0:
            continue
        low, high = (
            b / a * float(np.divide(*fast_kappa(nu, ratios)[::-1])) for nu in (LEAST_POISSON_RATIO, HIGHEST)
        )
        found = c_b.value / c_a.value
        std = float(np.hypot((c_a.std or 0.0) / c_a.value, (c_b.std or 0.0) / c_b.value))
        beyond = max(np.log(low / found), np.log(found / high)) - max(CONTRARY * std, ALLOWED)
        if beyond > 0:
            yield beyond, a, b, found, low, high
