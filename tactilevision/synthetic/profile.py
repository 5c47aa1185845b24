"""The gel under a flat punch as finite elements have it: the truth that simulated pictures and forces show.

A recording's own gel is solved here: neo-Hooke, true contact with a rounded edge and Coulomb's friction on first
loading, on a disc as wide as the pad. What reads recordings takes none of it: the certificate and the fit of nu
interpolate a table at an edge and a friction of their own, and calibrate knows neither of the two.

Assumptions: quasi-static; unloading goes back along the loading curve; the rim is as far from every press as from
the pad's centre, and over the last thickness before it the surface is faded out. Deeper than the last depth solved
(DEEPEST thicknesses, or where the surface folds at the punch's edge) shape and P/w go on along the straight line
through the last two depths: .2 % of the force and .003 of the depth off at w/h = .2 where the last is .125.
Source: mechanics/punch_fem, checked against other programs in docs/evidence/punch_fem.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.errors import ConvergenceError
from tactilevision.records import Floats, Material, Pair

FRICTION = 0.3  # Coulomb's coefficient of gel on a dry face
EDGE_RADIUS_MM = 0.05  # mm, rounding of a machined edge
PAD_RADIUS_MM = 15.0  # mm, radius of a round pad
DEEPEST = 0.22  # w/h of the deepest simulated press
# w/h at which a press is solved; shape and P/w are linear between them
_DEPTHS = (0.004, 0.015, 0.03, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, DEEPEST)
_LINE = np.linspace(0.05, 0.2, 16)  # thicknesses over which c and beta are read, as the published punches span
_FINER = 5  # places for each node of the surface


@dataclass(frozen=True, slots=True, eq=False)
class PunchProfile:
    """One gel under one punch at the solved depths `depths_mm` (m,).

    `radius_mm` (n,) material radii from the axis outwards; `depth`, `shift` (m, n) the surface's depth (negative
    where the gel rises) and outward displacement over the punch's depth; `area_mm` (m,) P/(E w).
    """

    punch_radius_mm: float
    thickness_mm: float
    radius_mm: Floats
    depths_mm: Floats
    depth: Floats
    shift: Floats
    area_mm: Floats

    def carried(self, depth_mm: float) -> Floats:
        """How far (n,) the surface has moved outwards, mm."""
        return depth_mm * self._at(self.shift, depth_mm)

    def seen(self, depth_mm: float) -> tuple[Floats, Floats]:
        """Places r + u_r (R,) mm that the camera sees, never falling, and the depth (R,) mm there."""
        places = np.maximum.accumulate(self.radius_mm + self.carried(depth_mm))
        return places, depth_mm * self._at(self.depth, depth_mm)

    def depth_at(self, place_mm: Floats | float, depth_mm: float) -> Floats:
        """Depth (any shape, mm) of the surface at places (mm from the axis) as the camera sees them."""
        places, depths = self.seen(depth_mm)
        return np.asarray(np.interp(place_mm, places, depths, right=0.0), dtype=np.float64)

    def force_per_modulus(self, depth_mm: Floats | float) -> Floats:
        """P/E (mm²) at depths of any shape; 0 in the air."""
        w = np.maximum(np.asarray(depth_mm, dtype=np.float64), 0.0)
        last, before = self.area_mm[-1], self.area_mm[-2]
        slope = (last - before) / (self.depths_mm[-1] - self.depths_mm[-2])
        beyond = np.maximum(w - self.depths_mm[-1], 0.0)
        return np.asarray(w * (np.interp(w, self.depths_mm, self.area_mm) + slope * beyond))

    def line(self) -> Pair:
        """c/E (mm) and β of the straight line through P/w against w/h, w from a twentieth to a fifth of h."""
        w = _LINE * self.thickness_mm
        slope, start = np.polyfit(_LINE, self.force_per_modulus(w) / w, 1)
        return float(start), float(slope / start)

    def _at(self, values: Floats, depth_mm: float) -> Floats:
        low = int(np.clip(np.searchsorted(self.depths_mm, depth_mm) - 1, 0, self.depths_mm.size - 2))
        step = self.depths_mm[low + 1] - self.depths_mm[low]
        share = max((depth_mm - self.depths_mm[low]) / step, 0.0)
        return np.asarray((1 - share) * values[low] + share * values[low + 1])


@lru_cache(maxsize=32)
def punch_profile(
    poisson_ratio: float,
    radius_mm: float,
    thickness_mm: float,
    *,
    friction: float = FRICTION,
    edge_radius_mm: float = EDGE_RADIUS_MM,
    pad_radius_mm: float = PAD_RADIUS_MM,
) -> PunchProfile:
    """Solve a punch on a layer; some seconds. Raises ConvergenceError where not even the first touch is found."""
    from scipy.interpolate import CubicSpline

    from tactilevision.mechanics.punch_fem import PunchProblem, RoundedPunch
    from tactilevision.mechanics.punch_fem.march import march
    from tactilevision.mechanics.punch_fem.newton import State, equations
    from tactilevision.mechanics.punch_fem.problem import build
    from tactilevision.mechanics.punch_fem.results import surface_profile

    punch = RoundedPunch(radius_mm, edge_radius_mm, friction)
    model = build(PunchProblem(Material(1.0, poisson_ratio), punch, thickness_mm, pad_radius_mm))
    states: list[State] = []
    try:
        for state in march(equations(model, by_force=False), [thickness_mm * share for share in _DEPTHS], log=[]):
            states.append(state)  # noqa: PERF402 - what was reached before an error is kept
    except ConvergenceError:
        if len(states) < 2:
            raise
    depths = np.array([state.depth_mm for state in states])
    nodes, _ = surface_profile(model, states[0])
    moved = np.array([surface_profile(model, state)[1] for state in states]) / depths[:, None, None]
    number = np.arange(nodes.size)
    radii = np.interp(np.linspace(0, number[-1], _FINER * number[-1] + 1), number, nodes)
    shift, rise = np.moveaxis(CubicSpline(nodes, moved, axis=2)(radii), 1, 0)
    remaining = np.clip((pad_radius_mm - radii) / thickness_mm, 0.0, 1.0)
    end = remaining * remaining * (3.0 - 2.0 * remaining)
    depth = np.where(radii <= radius_mm - edge_radius_mm, 1.0, -rise)
    return PunchProfile(radius_mm, thickness_mm, radii, depths, depth * end, shift * end,
                        np.array([state.force_N for state in states]) / depths)  # fmt: skip
