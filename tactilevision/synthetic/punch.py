"""Gel surface under a flat punch from finite elements, with the bevel of the punch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from tactilevision.errors import ConvergenceError
from tactilevision.files.cache import kept_record
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.measured import Bools, Floats, Material, Pair
from tactilevision.synthetic.gel import Area, Grid, Singles, Surface, lookup, smooth_step

# Gel under a flat punch by finite elements: neo-Hookean, contact with a rounded edge and Coulomb friction on first
# loading, on a disc of the pad's radius. What evaluates recordings uses tables of another edge and friction.
#
# Assumptions: quasi-static; unloading follows the loading curve; the rim is as far from every press as from the
# pad's centre, and over the last thickness before it the surface fades out. Beyond the last solved depth (DEEPEST
# thicknesses, or where the surface folds at the edge) shape and P/w are extrapolated linearly from the last two
# depths: errors of .2 % of the force and .003 of the depth at w/h = .2 if the last is .125. Source:
# mechanics/punch_fem.

FRICTION = 0.3  # Coulomb's coefficient of gel on a dry face
EDGE_RADIUS_MM = 0.05  # mm, rounding of a machined edge
PAD_RADIUS_MM = 15.0  # mm, radius of a round pad
DEEPEST = 0.22  # w/h of the deepest simulated press
# w/h at which a press is solved; shape and P/w are linear between them
_DEPTHS = (0.004, 0.015, 0.03, *(n / 40 for n in range(2, 9)), DEEPEST)
_LINE = np.linspace(1 / 20, 1 / 5, 16)  # w/h over which c and beta are fitted, as for the published punches
_FINER = 5  # places per node of the surface


@dataclass(frozen=True, slots=True, eq=False)
class PunchProfile:
    """One gel under one punch at the solved depths `depths_mm` (m,).

    `radius_mm` (n,) material radii; `depth`, `shift` (m, n) depth of the surface (negative where the gel rises)
    and outward displacement, over the depth of the punch; `area_mm` (m,) P/(E w).
    """

    punch_radius_mm: float
    thickness_mm: float
    radius_mm: Floats
    depths_mm: Floats
    depth: Floats
    shift: Floats
    area_mm: Floats

    def carried(self, depth_mm: float) -> Floats:
        """Return the outward displacement (n,) of the surface, mm."""
        return depth_mm * self._at(self.shift, depth_mm)

    def seen(self, depth_mm: float) -> tuple[Floats, Floats]:
        """Return the places r + u_r (R,) mm in the picture, non-decreasing, and the depth (R,) mm there."""
        places = np.maximum.accumulate(self.radius_mm + self.carried(depth_mm))
        return places, depth_mm * self._at(self.depth, depth_mm)

    def depth_at(self, place_mm: Floats | float, depth_mm: float) -> Floats:
        """Return the depth (any shape, mm) of the surface at places in the picture, mm from the axis."""
        places, depths = self.seen(depth_mm)
        return np.asarray(np.interp(place_mm, places, depths, right=0.0), dtype=np.float64)

    def force_per_modulus(self, depth_mm: Floats | float) -> Floats:
        """Return P/E (mm²) at depths of any shape; 0 in the air."""
        w = np.maximum(np.asarray(depth_mm, dtype=np.float64), 0.0)
        last, before = self.area_mm[-1], self.area_mm[-2]
        slope = (last - before) / (self.depths_mm[-1] - self.depths_mm[-2])
        beyond = np.maximum(w - self.depths_mm[-1], 0.0)
        return np.asarray(w * (np.interp(w, self.depths_mm, self.area_mm) + slope * beyond))

    def line(self) -> Pair:
        """Return c/E (mm) and β of the line through P/w against w/h, w/h from a twentieth to a fifth."""
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
    """Solve a punch on a layer, in some seconds, or read it from the cache.

    Raises ConvergenceError where not even two depths are solved.
    """
    problem = (poisson_ratio, radius_mm, thickness_mm, friction, edge_radius_mm, pad_radius_mm)
    return kept_record("punch", problem, make=lambda: _solved(*problem))


def _solved(
    poisson_ratio: float,
    radius_mm: float,
    thickness_mm: float,
    friction: float,
    edge_radius_mm: float,
    pad_radius_mm: float,
) -> PunchProfile:
    from scipy.interpolate import CubicSpline

    from tactilevision.mechanics.punch_fem.contact import RoundedPunch
    from tactilevision.mechanics.punch_fem.newton import State, reached
    from tactilevision.mechanics.punch_fem.press import surface_profile
    from tactilevision.mechanics.punch_fem.problem import PunchProblem, build

    punch = RoundedPunch(radius_mm, edge_radius_mm, friction)
    model = build(PunchProblem(Material(1.0, poisson_ratio), punch, thickness_mm, pad_radius_mm))
    steps: list[State | str] = []
    states = reached(model, [thickness_mm * share for share in _DEPTHS], log=steps)
    if len(states) < 2:
        raise ConvergenceError(f"the punch's press ends: {steps[-1]}")
    depths = np.array([state.depth_mm for state in states])
    nodes, _ = surface_profile(model, states[0])
    moved = np.array([surface_profile(model, state)[1] for state in states]) / depths[:, None, None]
    number = np.arange(nodes.size)
    radii = np.interp(np.linspace(0, number[-1], _FINER * number[-1] + 1), number, nodes)
    shift, rise = np.moveaxis(CubicSpline(nodes, moved, axis=2)(radii), 1, 0)
    end = smooth_step((pad_radius_mm - radii) / thickness_mm)
    depth = np.where(radii <= radius_mm - edge_radius_mm, 1.0, -rise)
    return PunchProfile(radius_mm, thickness_mm, radii, depths, depth * end, shift * end,
                        np.array([state.force_N for state in states]) / depths)  # fmt: skip


# Bevel next to the face of an indenter.

SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "top": (0.0, -1.0), "bottom": (0.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Bevel:
    """A plane next to the face that starts at a straight edge.

    The edge is `distance_mm` from the axis towards `side`, `height_mm` behind the face; from there the plane falls
    by `angle_deg`. It extends `half_width_mm` to both sides along the edge.
    """

    side: str
    distance_mm: float
    height_mm: float
    angle_deg: float
    half_width_mm: float

    def along(self, x: Floats | Singles, y: Floats | Singles) -> tuple[Floats, Floats]:
        """Return distances from the axis towards the bevel, and along its edge; mm, of the shape of x and y."""
        ex, ey = SIDES[self.side]
        return np.asarray(ex * x + ey * y), np.asarray(-ey * x + ex * y)

    def area(self, centre_mm: Pair, reach_mm: Pair, *, margin_mm: float) -> Area:
        """Return the rectangle `reach_mm` before and behind the edge and `margin_mm` past both of its ends."""
        ex, ey = SIDES[self.side]
        middle = self.distance_mm + 0.5 * (reach_mm[1] - reach_mm[0])
        half_s, half_t = 0.5 * sum(reach_mm), self.half_width_mm + margin_mm
        half = (half_s, half_t) if ex else (half_t, half_s)
        return Area((centre_mm[0] + ex * middle, centre_mm[1] + ey * middle), half)

    def depth_mm(self, s: Floats, face_mm: float) -> Floats:
        """Return the depth (mm) of the bevel's plane with the face at `face_mm`, for s >= distance_mm."""
        slope = np.tan(np.deg2rad(self.angle_deg))
        return np.asarray(face_mm - self.height_mm - (s - self.distance_mm) * slope)

    def gap_mm(self, profile: PunchProfile, face_mm: float, *, tilt: Pair = (0.0, 0.0)) -> float:
        """Return the smallest distance between the bevel and the gel; below 0 they overlap."""
        s = self.distance_mm + np.linspace(0.0, 1.0, 21)
        s, t = np.meshgrid(s, np.linspace(-self.half_width_mm, self.half_width_mm, 41))
        ex, ey = SIDES[self.side]
        tilted = tilt[0] * (ex * s - ey * t) + tilt[1] * (ey * s + ex * t)
        return float(np.min(profile.depth_at(np.hypot(s, t), face_mm) - self.depth_mm(s, face_mm) - tilted))

    def touch_depth_mm(self, profile: PunchProfile, tilt: Pair = (0.0, 0.0)) -> float:
        """Return the depth of the face at which the gel first touches the bevel: w + rise = H."""
        from scipy.optimize import brentq

        deepest_mm = 2.0 * self.height_mm + 0.5
        return float(brentq(lambda w: self.gap_mm(profile, w, tilt=tilt), 0.0, deepest_mm, xtol=TINY))

    def dent(self, surface: Singles, places: tuple[Singles, Singles], *, face_mm: float, tilt: Pair) -> Singles:
        """Return the depth (H, W) mm that the bevel adds to the free surface (H, W) mm.

        Pixels that the bevel's edge crosses are as deep as the edge: else contact would begin microns too late.
        """
        x, y = places
        pixel_mm = float(abs(x[0, 1] - x[0, 0]))
        s, t = self.along(x, y)
        plane = self.depth_mm(np.maximum(s, self.distance_mm), face_mm) + tilt[0] * x + tilt[1] * y
        under = (s + 0.5 * pixel_mm >= self.distance_mm) & (np.abs(t) <= self.half_width_mm)
        overlap = np.where(under, plane - surface, 0.0)
        dent = np.maximum(overlap, 0.0)
        if not (dent > 0).any():
            return np.zeros_like(surface)
        return _spread(dent.astype(np.float32), dent > 0, pixel_mm)

    def force_N(self, profile: PunchProfile, depths_mm: Floats, *, reduced_modulus_MPa: float) -> Floats:
        """Return the force (T,) N on the bevel at depths (T,) mm of the face."""
        along = np.linspace(-self.half_width_mm, self.half_width_mm, 81)
        distance = np.hypot(self.distance_mm, along)
        table = np.linspace(0.0, max(float(np.max(depths_mm, initial=0.0)), MICRO), 60)
        overlap = [np.maximum(w - self.height_mm - profile.depth_at(distance, w), 0.0) for w in table]
        force = 0.5 * reduced_modulus_MPa * np.trapezoid(overlap, along, axis=1)
        return np.asarray(np.interp(depths_mm, table, force, left=0.0), dtype=np.float64)


def _spread(dent: Singles, touching: Bools, mm_per_px: float) -> Singles:
    """Extend a dent beyond its contact, decaying with the distance q from it."""
    q, nearest = cv2.distanceTransformWithLabels(
        (~touching).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    strength = np.zeros(int(nearest.max()) + 1, np.float32)
    strength[nearest[touching]] = dent[touching]
    length_mm = 0.25
    reach = np.float32(mm_per_px / length_mm) * q
    decay = (2 / np.pi) * np.arcsin(1 / (1 + reach)) * np.exp(-((reach / 8) ** 2))
    return np.asarray(np.where(touching, dent, strength[nearest] * decay), dtype=np.float32)


# Gel under a flat cylinder and its bevel.

MIN_MM = MICRO  # depth below which the shape of the surface stays


@dataclass(frozen=True)
class PunchPress(Surface):
    """Gel under a flat cylinder at `face_mm`, with its bevel where there is one.

    Under the face the depth is the plane of the face; outside it is the profile, scaled by the depth of the
    nearest point of the rim (exact without tilt). The rim is rounded over `rounding_mm`, as by an edge radius and
    the thickness of the ink. Where the bevel overlaps the free surface the gel follows the bevel, and around it
    recovers as around a punch on a half-space, (2/π) asin(1/(1 + q/ℓ)).
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
            (wall,) if self.bevel is None else (wall, self.bevel.area(self.centre_mm, (0.5, 1.0), margin_mm=0.5))
        )

    def depth_mm(self, grid: Grid) -> Singles:
        """Return the depth (H, W) mm on the grid."""
        depth = self._free(grid)
        if self.bevel is not None and self.face_mm > 0.5 * self.bevel.height_mm:
            part = grid.part(self.bevel.area(self.centre_mm, (2.5, 3), margin_mm=2.5))
            window = Grid(grid.x_mm[part[1]], grid.y_mm[part[0]])
            if depth[part].size:
                places = window.places(self.centre_mm)
                depth[part] += self.bevel.dent(depth[part], places, face_mm=self.face_mm, tilt=self.tilt)
        return depth

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """Return the sideways shift (H, W) mm of the ink in x and in y."""
        x, y = grid.places(self.centre_mm)
        r = np.maximum(grid.distance(self.centre_mm), np.float32(MICRO))
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
            inward = np.minimum(1.0, self.profile.punch_radius_mm / np.maximum(r, np.float32(MICRO)))
            face += (np.float32(self.tilt[0]) * x + np.float32(self.tilt[1]) * y) * inward
        return np.asarray(np.maximum(face, 0.0) * unit, dtype=np.float32)
