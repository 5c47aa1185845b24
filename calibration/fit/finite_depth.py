"""Stiffness at finite depth and with a rounded edge, compared with finite elements.

    F(nu) = E by the law / E of the elements,    P_elements = E_law k(w) w (1 + beta w/h)

k is the law's stiffness at E = 1: Hayes' for a frictionless punch at small depth, with the stated edge. A dry
punch has friction and an edge, and the elements' P/w is not a straight line: at h = 3 mm, a/h = .83 and depths of
.15 to .6 mm the law's E is 3.2 % low at nu = .40, .5 % low at .48, and 1.9 % high at .4999. So E is divided by F,
at the presses' own depths, for a neo-Hookean gel under a usual dry punch; other frictions and a sharp edge bound
it. Range: dry presses with one radius, at nu, a/h and depths of the tables of mechanics. Source: mechanics/tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory import beta_outside_theory, punch_stiffness
from calibration.model.stages import EDGE, STICKING
from tactilevision.errors import InputError
from tactilevision.mechanics.filleted_punch import rounded_contact
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.blocks import hayes_stiffness
from tactilevision.mechanics.tables.punch import EDGE_OVER_H, POISSON_RANGE, force_ratio
from tactilevision.records.measured import Estimate, Floats, Material, Pair


def stated_edge_mm(fitted: Fit, radius_mm: float) -> float | None:
    """Return the largest stated edge radius of this radius's indenters; None where one is not stated."""
    edges = [i.edge_radius_mm for i in fitted.data.indenters if i.radius_mm == radius_mm]
    known = [edge for edge in edges if edge is not None]
    return max(known) if edges and len(known) == len(edges) else None


def straight_line(fitted: Fit, radius_mm: float, *, edge_mm: float, poisson_ratio: float, beta: float) -> Pair:
    """Return the intercept over the sharp punch's c, and slope over intercept, of the line through P/w.

    A rounded edge lowers P/w at small depth, so c becomes smaller and beta larger than the sharp punch's.
    """
    h = fitted.data.gel.thickness_mm
    depth = fitted.data.depth_mm[(fitted.data.radius_mm == radius_mm) & (fitted.data.depth_mm > 0)]
    if edge_mm <= 0 or np.ptp(depth) <= 0:
        return 1.0, beta
    gel = {"thickness_mm": h, "poisson_ratio": poisson_ratio, "sticking": float(not fitted.data.lubricated)}
    rounded, sharp = (_law(depth, radius_mm, edge_mm=edge, **gel) for edge in (edge_mm, 0.0))
    share = rounded / sharp
    ones, strain = np.ones(depth.size), depth / h
    start, slope = np.linalg.lstsq(np.column_stack([ones, strain]), share * (1 + beta * strain), rcond=None)[0]
    return float(start), float(slope / start)


def usual_softening(fitted: Fit, radius_mm: float, *, poisson_ratio: float) -> float:
    """Return the share by which E may be higher because an edge that is not stated is rounded as usual."""
    if not isinstance(fitted.model.law, FlatPunch) or stated_edge_mm(fitted, radius_mm) is not None:
        return 0.0
    edge = EDGE_OVER_H * fitted.data.gel.thickness_mm
    start, _ = straight_line(fitted, radius_mm, edge_mm=edge, poisson_ratio=poisson_ratio, beta=0.0)
    return max(1 / start - 1, 0.0)


SMALLEST_MM = 1e-4  # mm: smaller depths round to 0
USUAL_FRICTION = 0.3  # Coulomb's coefficient of gel on a dry face; above it hardly anything changes
FRICTIONS = (0.1, 0.2, 0.6, np.inf)  # other coefficients that a dry face may have
DEPTHS = 12  # quantiles of the presses' depths at which the elements are evaluated
MIN_DEPTHS = 4  # of these, that the table must contain
NODES = (*(np.arange(30, 50) / 100).tolist(), 0.495, POISSON_RANGE[1])  # nu of F's table


@dataclass(frozen=True, slots=True, eq=False)
class FiniteDepth:
    """F at the NODES of nu for a usual dry punch, with the least and the largest for other dry ones; (n,) each.

    `edge_mm`: the edge radius, and whether it was stated.
    """

    usual: Floats
    least: Floats
    largest: Floats
    edge_mm: float
    stated: bool

    def share(self, poisson_ratio: Floats | float) -> Floats:
        """Return F at these nu, of any shape."""
        return np.asarray(np.interp(poisson_ratio, NODES, self.usual))

    def room(self, poisson_ratio: float) -> Pair:
        """Return the shares by which E may be lower and higher for another friction or a sharp edge."""
        usual, least, largest = (
            float(np.interp(poisson_ratio, NODES, one)) for one in (self.usual, self.least, self.largest)
        )
        return largest / usual - 1, usual / least - 1

    def words(self, poisson_ratio: float) -> str:
        """Return the assumption behind E, as a sentence."""
        more = 100 * (1 / float(self.share(poisson_ratio)) - 1)
        lower, higher = self.room(poisson_ratio)
        return (
            f"friction is unknown: E is that of finite elements at these depths with friction {USUAL_FRICTION:g} "
            f"and an edge of {self.edge_mm:.2g} mm, {more:+.1f} % from kappa of small depth at nu = "
            f"{poisson_ratio:.3f}; it may be lower by up to {100 * lower:.1f} %, higher by {100 * higher:.1f} % "
            f"for other frictions{'' if self.stated else ' or a sharp edge'}, which its interval includes"
        )


def finite_depth(fitted: Fit, nu: Estimate, *, radius_mm: float) -> FiniteDepth | None:
    """Return F at the depths of these presses.

    None for lubricated presses, several radii, a beta outside the range of contact laws, and outside the tables.
    """
    law, data = fitted.model.law, fitted.data
    plain = isinstance(law, FlatPunch) and law.sticking == 0 and not law.one_depth and not law.bent
    own = {effect.condition for effect in fitted.model.effects}
    if not plain or data.lubricated or own & {EDGE, STICKING} or np.unique(data.presses.radius_mm).size > 1:
        return None
    if beta_outside_theory(fitted.estimate("beta"), nu, a_over_h=radius_mm / data.gel.thickness_mm):
        return None
    depth = data.depth_mm[data.depth_mm > SMALLEST_MM]
    asked = np.unique(np.quantile(depth, np.linspace(0, 1, DEPTHS)).round(4)) if depth.size else depth
    return _of(radius_mm, data.gel.thickness_mm, stated_edge_mm(fitted, radius_mm), tuple(asked.tolist()))


@lru_cache(maxsize=16)
def _of(
    radius_mm: float, thickness_mm: float, edge_mm: float | None, depths_mm: tuple[float, ...]
) -> FiniteDepth | None:
    usual = EDGE_OVER_H * thickness_mm if edge_mm is None else edge_mm
    edges = (0.0, usual) if edge_mm is None else (usual,)
    depth = np.array(depths_mm)

    def over_nu(friction: float, edge: float) -> Floats:
        contact = FlatContact(radius_mm, edge, thickness_mm, friction)
        return np.array([_one(nu, contact, depth, stated=edge_mm) for nu in NODES])

    try:
        middle = over_nu(USUAL_FRICTION, usual)
        others = np.array([middle, *(over_nu(mu, edge) for mu in (USUAL_FRICTION, *FRICTIONS) for edge in edges)])
    except InputError:  # outside the tables in radius, thickness or edge
        return None
    known = np.isfinite(middle)
    if not known.all():
        return None
    least, largest = np.nanmin(others, axis=0), np.nanmax(others, axis=0)
    return FiniteDepth(middle, least, largest, usual, edge_mm is not None)


def _one(poisson_ratio: float, contact: FlatContact, depth_mm: Floats, *, stated: float | None) -> float:
    """Return F of one gel under one punch; NaN where the table contains too few of the depths."""
    ratio, known = force_ratio(depth_mm, contact, material=Material(1.0, poisson_ratio))
    depth = depth_mm[known]
    if depth.size < MIN_DEPTHS or np.ptp(depth) <= 0:
        return float("nan")
    h = contact.thickness_mm
    per_depth = (
        ratio[known] * h * hayes_stiffness(poisson_ratio, contact.a_over_h, edge_over_h=contact.edge_over_h)
    )
    gel = {"thickness_mm": h, "poisson_ratio": poisson_ratio, "sticking": 1.0}
    law = _law(depth, contact.radius_mm, edge_mm=stated or 0.0, **gel)
    weight = 1 / np.hypot(TYPICAL_GAIN, TYPICAL_ZERO_MM / depth)
    share, strain = weight * per_depth / law, depth / h
    return float(np.linalg.lstsq(np.stack([weight, weight * strain], axis=1), share, rcond=None)[0][0])


def _law(depth_mm: Floats, radius_mm: float, *, edge_mm: float, **gel: float) -> Floats:
    """Return the law's P/w (n,) at E = 1 MPa, without beta; `gel`: thickness_mm, poisson_ratio, sticking."""
    met, share = rounded_contact(depth_mm, radius_mm, edge_mm=edge_mm, **gel)
    return share * punch_stiffness(1.0, gel["poisson_ratio"], radius_mm=met, thickness_mm=gel["thickness_mm"])
