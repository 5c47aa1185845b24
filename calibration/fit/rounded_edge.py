"""What a rounded edge makes of the line through P/w: less at small depth, so a smaller c and a larger beta.

The law knows the edge where it is stated, and its E and beta are the sharp punch's. c and beta are reported as the
line through the measurements has them; where no edge is stated, E may be higher by what the usual one takes away.
"""

from __future__ import annotations

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory.stiffness import punch_stiffness
from tactilevision.mechanics.filleted_punch import rounded_contact
from tactilevision.mechanics.tables.profile import EDGE_OVER_H
from tactilevision.records import Floats, Pair


def stated_edge_mm(fitted: Fit, radius_mm: float) -> float | None:
    """The rounding of this radius's indenters, the largest where they differ; None where one is not stated."""
    edges = [i.edge_radius_mm for i in fitted.data.indenters if i.radius_mm == radius_mm]
    known = [edge for edge in edges if edge is not None]
    return max(known) if edges and len(known) == len(edges) else None


def straight_line(fitted: Fit, radius_mm: float, *, edge_mm: float, poisson_ratio: float, beta: float) -> Pair:
    """Intercept over the sharp punch's c, and slope over intercept, of the line through P/w at this radius."""
    h = fitted.data.gel.thickness_mm
    depth = fitted.data.depth_mm[(fitted.data.radius_mm == radius_mm) & (fitted.data.depth_mm > 0)]
    if edge_mm <= 0 or np.ptp(depth) <= 0:
        return 1.0, beta
    met, share = rounded_contact(
        depth,
        radius_mm,
        edge_mm=edge_mm,
        thickness_mm=h,
        poisson_ratio=poisson_ratio,
        sticking=float(not fitted.data.lubricated),
    )
    share = share * _stiffness(poisson_ratio, met, h) / _stiffness(poisson_ratio, np.array([radius_mm]), h)
    ones, strain = np.ones(depth.size), depth / h
    start, slope = np.linalg.lstsq(np.column_stack([ones, strain]), share * (1 + beta * strain), rcond=None)[0]
    return float(start), float(slope / start)


def usual_softening(fitted: Fit, radius_mm: float, *, poisson_ratio: float) -> float:
    """By what share E may be higher because an edge that is not stated is rounded as machined ones are."""
    if not isinstance(fitted.model.law, FlatPunch) or stated_edge_mm(fitted, radius_mm) is not None:
        return 0.0
    edge = EDGE_OVER_H * fitted.data.gel.thickness_mm
    start, _ = straight_line(fitted, radius_mm, edge_mm=edge, poisson_ratio=poisson_ratio, beta=0.0)
    return max(1 / start - 1, 0.0)


def _stiffness(poisson_ratio: float, radius_mm: Floats, thickness_mm: float) -> Floats:
    return punch_stiffness(
        1.0, poisson_ratio, radius_mm=radius_mm, thickness_mm=np.full(radius_mm.size, thickness_mm)
    )
