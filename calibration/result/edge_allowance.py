"""What a rounded edge of which nothing is stated leaves open of E.

    E -> E (1 + s),    r = h/60

s is what a rounding r takes off the line through P/w (edges.py). A punch whose edge is rounded touches with its
flat part first and is softer than a sharp one; taken for sharp, it makes the gel look softer than it is. r is what
finite elements are tabulated with, .05 mm on 3 mm of gel: as sharp as turned edges usually are. Friction makes up
for part of it (sticking_range). E keeps its value; its 95 % interval reaches up by s beside what it has otherwise,
as the root of the sum of squares: the two do not know of each other. Where E is the elements' at finite depth it
is that of the usual edge already, and s stands for one twice as round.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.finite_depth import finite_depth
from calibration.fit.identifiability import main_radius
from calibration.fit.rounded_edge import usual_softening
from calibration.laws.flat_punch import SILICONE_NU
from calibration.result.result import CalibrationResult
from tactilevision.mechanics.tables.profile import EDGE_OVER_H
from tactilevision.records import Estimate


def allow_for_edge(result: CalibrationResult) -> CalibrationResult:
    """The result with E's upper end moved, and said so; as it is where the edge is stated."""
    data, radius, nu = result.fitted.data, main_radius(result.fitted), result.poisson_ratio.value
    stated = [i.edge_radius_mm for i in data.indenters if i.radius_mm == radius]
    if all(edge is not None for edge in stated):
        return result
    share = usual_softening(result.fitted, radius, poisson_ratio=SILICONE_NU[1] if nu is None else nu)
    edge = data.gel.thickness_mm * EDGE_OVER_H
    said = (
        f"no edge radius is stated: E is that of one rounded by {edge:.2g} mm, and one rounded twice as much "
        f"would raise it by some {100 * share:.1f} %; E's interval reaches up by that beside the rest"
        if finite_depth(result.fitted, result.poisson_ratio, radius_mm=radius) is not None
        else f"no edge radius is stated: E may be higher by up to {100 * share:.1f} % where the punch's edge is "
        f"rounded by {edge:.2g} mm; E's interval reaches up by that beside the rest"
    )
    return replace(
        result,
        youngs_modulus=_reaching(result.youngs_modulus, share),
        reduced_modulus=_reaching(result.reduced_modulus, share),
        assumptions=(*result.assumptions, said),
    )


def _reaching(modulus: Estimate, share: float) -> Estimate:
    if modulus.interval95 is None:
        return modulus
    low, high = modulus.interval95
    value = high if modulus.value is None else modulus.value
    return replace(modulus, interval95=(low, value + float(np.hypot(high - value, share * value))))
