"""Gel surface under a flat punch or ring, from finite elements, with the bevel of the punch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from tactilevision.errors import ConvergenceError
from tactilevision.records.measured import Bools, Floats, Material, Pair
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles, lookup

# The gel under a flat punch as finite elements have it: the truth that simulated pictures and forces show.
#
# A recording's own gel is solved here: neo-Hooke, true contact with a rounded edge and Coulomb's friction on first
# loading, on a disc as wide as the pad. What reads recordings takes none of it: the certificate and the fit of nu
# interpolate a table at an edge and a friction of their own, and calibrate knows neither of the two.
#
# Assumptions: quasi-static; unloading goes back along the loading curve; the rim is as far from every press as
# from the pad's centre, and over the last thickness before it the surface is faded out. Deeper than the last depth
# solved (DEEPEST thicknesses, or where the surface folds at the punch's edge) shape and P/w go on along the
# straight line through the last two depths: .2 % of the force and .003 of the depth off at w/h = .2 where the last
# is .125. Source: mechanics/punch_fem, checked against other programs in docs/evidence/punch_fem.md.

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

    from tactilevision.mechanics.punch_fem.contact import RoundedPunch
    from tactilevision.mechanics.punch_fem.newton import State, equations, march
    from tactilevision.mechanics.punch_fem.press import surface_profile
    from tactilevision.mechanics.punch_fem.problem import PunchProblem, build

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


# The bevel beside an indenter's face: where its body is, when the gel meets it, how the gel gives way.

_SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "top": (0.0, -1.0), "bottom": (0.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Bevel:
    """The body of an indenter beside its face: a plane that starts at a straight edge.

    The edge lies `distance_mm` from the axis towards `side`, `height_mm` behind the face; from there the plane
    falls away by `angle_deg`. It reaches `half_width_mm` to both sides along the edge.
    """

    side: str
    distance_mm: float
    height_mm: float
    angle_deg: float
    half_width_mm: float

    def along(self, x: Floats | Singles, y: Floats | Singles) -> tuple[Floats, Floats]:
        """Distances from the axis towards the bevel, and along its edge; mm, any shape (as x and y)."""
        ex, ey = _SIDES[self.side]
        return np.asarray(ex * x + ey * y), np.asarray(-ey * x + ex * y)

    def area(self, centre_mm: Pair, reach_mm: Pair, *, beside_mm: float) -> Area:
        """The rectangle from before the edge to behind it (`reach_mm`) and `beside_mm` past both of its ends."""
        ex, ey = _SIDES[self.side]
        middle = self.distance_mm + 0.5 * (reach_mm[1] - reach_mm[0])
        half_s, half_t = 0.5 * sum(reach_mm), self.half_width_mm + beside_mm
        half = (half_s, half_t) if ex else (half_t, half_s)
        return Area((centre_mm[0] + ex * middle, centre_mm[1] + ey * middle), half)

    def depth_mm(self, s: Floats, face_mm: float) -> Floats:
        """Depth (any shape, mm) of the bevel's plane with the face at `face_mm`; meant for s >= distance_mm."""
        slope = np.tan(np.deg2rad(self.angle_deg))
        return np.asarray(face_mm - self.height_mm - (s - self.distance_mm) * slope)

    def gap_mm(self, profile: PunchProfile, face_mm: float, *, tilt: Pair = (0.0, 0.0)) -> float:
        """Smallest distance between the bevel and the gel that rises towards it; below 0 they overlap."""
        s = self.distance_mm + np.linspace(0.0, 1.0, 21)
        s, t = np.meshgrid(s, np.linspace(-self.half_width_mm, self.half_width_mm, 41))
        ex, ey = _SIDES[self.side]
        leaning = tilt[0] * (ex * s - ey * t) + tilt[1] * (ey * s + ex * t)
        return float(np.min(profile.depth_at(np.hypot(s, t), face_mm) - self.depth_mm(s, face_mm) - leaning))

    def touch_depth_mm(self, profile: PunchProfile, tilt: Pair = (0.0, 0.0)) -> float:
        """Depth of the face at which the gel first meets the bevel: w + rise = H."""
        from scipy.optimize import brentq

        def gap(w: float) -> float:
            return self.gap_mm(profile, w, tilt=tilt)

        return float(brentq(gap, 0.0, 2.0 * self.height_mm + 0.5, xtol=1e-9))


def bevel_dent(
    surface: Singles, bevel: Bevel, *, places: tuple[Singles, Singles], face_mm: float, tilt: Pair
) -> Singles:
    """What the bevel adds (H, W) mm to the depth of the free surface (H, W) mm.

    A pixel that the bevel's edge crosses is as deep as the edge: else contact would begin only where the plane has
    fallen off to the next pixel's centre, microns too late.
    """
    x, y = places
    pixel_mm = float(abs(x[0, 1] - x[0, 0]))
    s, t = bevel.along(x, y)
    plane = bevel.depth_mm(np.maximum(s, bevel.distance_mm), face_mm) + tilt[0] * x + tilt[1] * y
    under = (s + 0.5 * pixel_mm >= bevel.distance_mm) & (np.abs(t) <= bevel.half_width_mm)
    overlap = np.where(under, plane - surface, 0.0)
    dent = np.maximum(overlap, 0.0)
    if not (dent > 0).any():
        return np.zeros_like(surface)
    return _spread(dent.astype(np.float32), dent > 0, pixel_mm)


def _spread(dent: Singles, touching: Bools, mm_per_px: float) -> Singles:
    """Carry a dent beyond the contact that makes it, decaying with the distance q from the contact."""
    q, nearest = cv2.distanceTransformWithLabels(
        (~touching).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    strength = np.zeros(int(nearest.max()) + 1, np.float32)
    strength[nearest[touching]] = dent[touching]
    length = 0.25
    reach = np.float32(mm_per_px / length) * q
    decay = (2 / np.pi) * np.arcsin(1 / (1 + reach)) * np.exp(-((reach / 8) ** 2))
    return np.asarray(np.where(touching, dent, strength[nearest] * decay), dtype=np.float32)


# Gel under a flat cylinder and its bevel.

MIN_MM = 1e-6  # of depth, below which the surface has the shape that it has there


@dataclass(frozen=True, slots=True)
class PunchPress:
    """Gel under a flat cylinder at `face_mm`, with its bevel where there is one.

    Under the face the depth is the face's plane; outside the profile beside the punch, scaled by the depth of
    the nearest point of the rim (exact without tilt). The sharp rim is rounded over `rounding_mm`, as an edge's
    radius and the ink's thickness do. Where the bevel overlaps the free surface the gel follows the bevel,
    and beside it recovers as beside a half-space's punch, (2/π) asin(1/(1 + q/ℓ)).
    """

    profile: PunchProfile
    face_mm: float
    centre_mm: Pair
    tilt: Pair = (0.0, 0.0)
    bevel: Bevel | None = None
    rounding_mm: float = 0.03

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.profile.punch_radius_mm + 1.0
        wall = Area(self.centre_mm, (half, half))
        return (
            (wall,) if self.bevel is None else (wall, self.bevel.area(self.centre_mm, (0.5, 1.0), beside_mm=0.5))
        )

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W) mm on the grid."""
        depth = self._free(grid)
        if self.bevel is not None and self.face_mm > 0.5 * self.bevel.height_mm:
            part = grid.part(self.bevel.area(self.centre_mm, (2.5, 3.0), beside_mm=2.5))
            window = Grid(grid.x_mm[part[1]], grid.y_mm[part[0]])
            if depth[part].size:
                depth[part] += bevel_dent(
                    depth[part],
                    self.bevel,
                    places=window.places(self.centre_mm),
                    face_mm=self.face_mm,
                    tilt=self.tilt,
                )
        return depth

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Sideways shift (H, W) mm of the ink in x and in y."""
        x, y = grid.places(self.centre_mm)
        r = np.maximum(grid.distance(self.centre_mm), np.float32(1e-6))
        face = max(self.face_mm, 0.0)
        amount = lookup(r, self.profile.seen(face)[0], self.profile.carried(face)) / r
        return (amount * x).astype(np.float32), (amount * y).astype(np.float32)

    def _free(self, grid: Grid) -> Singles:
        r = grid.distance(self.centre_mm)
        deep = max(self.face_mm, MIN_MM)
        places, depths = self.profile.seen(deep)
        unit = lookup(r, places, depths / deep, rounding_mm=self.rounding_mm)
        face = np.full_like(r, self.face_mm)
        if self.tilt != (0.0, 0.0):
            x, y = grid.places(self.centre_mm)
            inward = np.minimum(1.0, self.profile.punch_radius_mm / np.maximum(r, np.float32(1e-6)))
            face += (np.float32(self.tilt[0]) * x + np.float32(self.tilt[1]) * y) * inward
        return np.asarray(np.maximum(face, 0.0) * unit, dtype=np.float32)


# Gel under a flat ring.


@dataclass(frozen=True, slots=True)
class RingPress:
    """A flat ring between two radii, pressed by `face_mm`.

    Outside it the gel lies as beside a full punch of the outer radius r₂; in the hole of radius r₁ it bulges,
    u/w = 1 - κ √(1 - (r/r₁)²), κ = 1 - exp(-r₁/h): the middle of a hole far wider than the layer is untouched.
    A picture of a shape with known edges, not a solution of the contact problem.
    """

    inner_mm: float
    outer_mm: float
    face_mm: float
    thickness_mm: float
    poisson_ratio: float
    centre_mm: Pair
    rounding_mm: float = 0.03

    @property
    def steep(self) -> tuple[Area, ...]:
        half = self.outer_mm + 1.0
        return (Area(self.centre_mm, (half, half)),)

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W) mm on the grid."""
        full_punch = punch_profile(self.poisson_ratio, self.outer_mm, self.thickness_mm)
        places, depths = full_punch.seen(self.face_mm)
        recovery = 1 - np.exp(-self.inner_mm / self.thickness_mm)
        hole = np.linspace(0.0, self.inner_mm, 200)
        floor = self.face_mm * (1 - recovery * np.sqrt(np.maximum(1 - (hole / self.inner_mm) ** 2, 0.0)))
        all_places, all_depths = np.concatenate([hole, places]), np.concatenate([floor, depths])
        return lookup(grid.distance(self.centre_mm), all_places, all_depths, rounding_mm=self.rounding_mm)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Sideways shift (H, W) mm of the ink in x and in y."""
        return Flat().shift_mm(grid)
