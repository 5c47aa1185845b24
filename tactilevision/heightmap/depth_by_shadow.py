"""Estimate the depth of a round flat face from the length of its cast shadows.

The slopes of its wall are too steep to be read; how long a shadow it throws is not. Beside a face of depth w and
radius a the gel is z = w m(r), m from finite elements (mechanics/tables) between two Poisson's ratios. A lamp's
point Q that stands at the tangent t over a place P is hidden as far as

    max over s of (z(P + s u) - z(P))/s > t        u: the direction to Q in the plane of the pad

the edge rounded by h/60 as in the tables, the strip's width a soft limit. With V_l the share of lamp l that is
seen, s_l its light on the raised gel (lamps of `glossy_lamps.py`), e_k what other gel sends there, in light,

    G_k (I_k/I0_k)^g = sum_l m_kl V_l s_l + E e_k

w, the share beta of the two surfaces, gains G, the size E, and the lamps' colours m (shadows show them by how dark
they are) are found by robust least squares from the gel beside the face. Slopes of the wall play no part. How
right it is stands in docs/evidence/rendered.md; the lamps' elevations carry it.
Assumes a rigid flat face, round and alone, in a layer of the stated thickness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.walls import PunchEdge
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.mechanics.tables.punch import A_OVER_H_RANGE, DEEPEST, EDGE_OVER_H, TABULATED
from tactilevision.photometric.illumination.lamps import SOFT, Lamp, Lamps, light_shares
from tactilevision.records.measured import Bools, Floats, Pair

Depth = npt.NDArray[np.floating[Any]]

STEP_PX = 4  # px between the places that are read
BESIDE_MM = (0.3, 0.6, 3.2)  # mm beyond the edge: from; to REACH depths and so much; at most
REACH = 6.0  # depths, beyond which lamps of 10 degrees throw no shadow
FACE = 0.75  # of the radius, within which the face's plane is read
POISSON = (0.42, 0.49)  # of the two surfaces; gels lie between .4 and .5
BEYOND_TABLES = 1.1  # times their widest face: its surface serves so far
FRICTION = 0.3  # of the tables' punch: more changes nothing
OTHER = 0.35  # of the face's depth that the map may lie off the law: beyond, it is another contact
ON_THE_WAY = (0.25, 0.5, 0.75, 0.9, 1.0, 1.15)  # parts of the way to the edge where the horizon is looked for
ROUND_THE_EDGE = (0.3, 0.6, 1.0)  # edge radii behind it
WIDTH_MM = 2.0  # mm, of strips: how soft the limit is, no more
SHARES = (-0.3, 1.14)  # of beta: nu of .40 to .4999
STD = 0.03  # of light: what a place is off by
HEAVY = 2.0  # of the loss HEAVY (sqrt(1 + |off|) - 1): a large error counts by its root
INDEPENDENT = 300  # readings: neighbouring places err alike, so that more of them tell no more
USUAL_SHARE = 0.6  # beta of most gels
START = (0.0, USUAL_SHARE, 0.0, 0.0, 0.0, 0.0)  # of ln w over the map's, beta, ln G and ln E: usual values
SPREAD = (0.3, 0.5, 0.01, 0.01, 0.01, 0.3)  # of the same, as wide as they are usually spread
COLOUR_SPREAD = 0.3  # of ln of what a lamp gives to a channel
MIN_PLACES = 300  # that are read
MIN_DARK = 25  # of them in shadow
DARK = 0.8  # of a lamp's light: less is shadow
MIN_DEPTH_MM = 0.2  # mm: gentler faces throw shadows of three or four readings
LAMPS_STD = 0.03  # of the depth: faces of four sensors of the path tracer about the truth
MORE_STD = 0.06  # of the depth, where more than three lamps were told: 48 faces of six sensors of a ray caster
MIN_WHOLE = 0.9  # of a face that lies in the picture
FARTHEST = 0.35  # of the map's depth: what differs more is no reading of this face


@dataclass(frozen=True, slots=True)
class ShadowDepth:
    """Depth of a face by its shadows and its standard deviation, mm."""

    depth_mm: float
    std_mm: float


def depth_by_shadow(
    edge: PunchEdge,
    depth_mm: Depth,
    *,
    light: Depth,
    usable: Bools,
    reflected: Depth,
    lamps: Lamps,
    mm_per_px: Pair,
    thickness_mm: float,
) -> ShadowDepth | None:
    """Depth of the face within `edge` of a map (H, W) in mm; None where its shadows do not tell it.

    `light` (H, W, 3) of the picture over the untouched one's, known where `usable` (H, W), `reflected` (H, W, 3)
    what other gel adds to it.
    """
    beside = _Beside.of(edge, depth_mm, usable, lamps=lamps, mm_per_px=mm_per_px, thickness_mm=thickness_mm)
    if beside is None:
        return None
    from scipy.optimize import least_squares

    rows, columns = beside.at
    task = _Task(beside, light[rows, columns].T.astype(float), reflected[rows, columns].T.astype(float))
    found = least_squares(
        task.residual, task.start, jac=task.jacobian, bounds=task.bounds, x_scale=task.spread, max_nfev=20
    )
    size = float(np.exp(found.x[0]))
    misfit = 2.0 * found.cost / (3 * INDEPENDENT)
    if not 1.0 - FARTHEST < size < 1.0 / (1.0 - FARTHEST) or task.dark(found.x) < MIN_DARK:
        return None
    jacobian = np.asarray(found.jac)
    own = float(np.linalg.inv(jacobian.T @ jacobian)[0, 0]) * max(1.0, misfit)
    w, of_lamps = beside.depth_mm * size, LAMPS_STD if len(lamps.lamps) == 3 else MORE_STD
    return ShadowDepth(w, w * float(np.sqrt(own + of_lamps**2)))


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """The gel over w at some places: `low` + beta `more`, of any shape, less `drop_mm` of the rounded edge."""

    low: Floats
    more: Floats
    drop_mm: Floats | float = 0.0

    def height_mm(self, w: float, share: float) -> Floats:
        return np.asarray(w * (self.low + share * self.more) - self.drop_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """From places (n,) to the points (K,) of a lamp: `away_mm` (K, J, n), the `surface` there, the `distance_mm`
    (K, n) of the points."""

    lamp: Lamp
    upright: Floats
    distance_mm: Floats
    away_mm: Floats
    surface: _Surface


@dataclass(frozen=True, slots=True, eq=False)
class _Beside:
    """Places `at` (rows, columns) beside a face of about `depth_mm`, the gel there, its slopes, and the lamps."""

    at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]
    x_mm: Floats
    y_mm: Floats
    depth_mm: float
    surface: _Surface
    slopes: tuple[_Surface, _Surface]
    rays: tuple[_Rays, ...]
    shares: Floats

    @classmethod
    def of(
        cls,
        edge: PunchEdge,
        depth: Depth,
        usable: Bools,
        *,
        lamps: Lamps,
        mm_per_px: Pair,
        thickness_mm: float,
    ) -> _Beside | None:
        """None where the picture holds too little of the face or of the gel beside, or no table the face."""
        a, shape = edge.radius_mm, depth.shape
        rows, columns = (axis.ravel() for axis in np.mgrid[: shape[0] : STEP_PX, : shape[1] : STEP_PX])
        x, y = columns * mm_per_px[0] - edge.centre_mm[0], rows * mm_per_px[1] - edge.centre_mm[1]
        r, here = np.hypot(x, y), depth[rows, columns]
        whole = np.pi * (FACE * a) ** 2 / (STEP_PX**2 * mm_per_px[0] * mm_per_px[1])
        if np.count_nonzero(face := r < FACE * a) < max(3.0, MIN_WHOLE * whole):
            return None
        terms = np.stack([np.ones(np.count_nonzero(face)), x[face], y[face]], axis=1)
        (w, *tilt), *_ = np.linalg.lstsq(terms, here[face], rcond=None)
        profile = _Profile.of(a, w, tilt=(tilt[0], tilt[1]), thickness_mm=thickness_mm)
        if profile is None:
            return None
        beyond, near, far = r - a, BESIDE_MM[0], min(BESIDE_MM[2], REACH * w + BESIDE_MM[1])
        use = (beyond > near) & (beyond < far) & usable[rows, columns]
        law = profile.at(x[use], y[use])
        use[use] = np.abs(here[use] - law.height_mm(w, USUAL_SHARE)) < OTHER * w
        if np.count_nonzero(use) < MIN_PLACES:
            return None
        x, y, at = x[use], y[use], (rows[use], columns[use])
        middle = [edge.centre_mm[k] - 0.5 * (n - 1) * mm_per_px[k] for k, n in enumerate(shape[::-1])]
        pad_x, pad_y = x + middle[0], y + middle[1]
        rays = tuple(_rays(lamp, profile, (x, y), (pad_x, pad_y)) for lamp in lamps.lamps)
        shares = light_shares(
            np.array([lamp.colour for lamp in lamps.lamps]).T, np.stack([one.upright for one in rays])
        )
        return cls(at, pad_x, pad_y, float(w), profile.at(x, y), profile.slopes(x, y), rays, shares)

    def light(self, w: float, share: float) -> tuple[Floats, Floats]:
        """V_l s_l and V_l (lamps, n) of a face of depth w mm."""
        z = self.surface.height_mm(w, share)
        normal = np.stack([*(-one.height_mm(w, share) for one in self.slopes), np.ones_like(z)])
        normal /= np.linalg.norm(normal, axis=0)
        shown, seen = zip(*(self._of_lamp(one, z, normal, (w, share)) for one in self.rays), strict=True)
        return np.stack(shown), np.stack(seen)

    def _of_lamp(self, rays: _Rays, z: Floats, normal: Floats, face: Pair) -> tuple[Floats, Floats]:
        horizon = ((rays.surface.height_mm(*face) - z) / rays.away_mm).max(axis=1)
        tangent = (rays.lamp.height_mm - z) / rays.distance_mm
        half = 0.5 * WIDTH_MM / rays.distance_mm * (1.0 + tangent**2)
        seen = np.clip(0.5 + 0.5 * (tangent - horizon) / half, 0.0, 1.0)
        turned = np.einsum("kdn,dn->kn", rays.lamp.lights(self.x_mm, self.y_mm, z), normal) / rays.upright
        shown = np.mean(seen * 0.5 * (turned + np.sqrt(turned**2 + SOFT**2)), axis=0)
        return shown, seen.mean(axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class _Profile:
    """The gel round a face of radius a mm and relative `tilt` (2,) per mm: `low` + beta `more` over r/a."""

    radius_mm: float
    edge_mm: float
    tilt: Pair
    r_over_a: Floats
    low: Floats
    more: Floats

    @classmethod
    def of(cls, radius_mm: float, w: float, *, tilt: Pair, thickness_mm: float) -> _Profile | None:
        a_over_h, w_over_h = radius_mm / thickness_mm, w / thickness_mm
        widest = BEYOND_TABLES * A_OVER_H_RANGE[1]
        if w < MIN_DEPTH_MM or not (A_OVER_H_RANGE[0] < a_over_h < widest and w_over_h < DEEPEST):
            return None
        radii, low, high = _tabled(round(min(a_over_h, A_OVER_H_RANGE[1]), 2), round(w_over_h, 2))
        return cls(radius_mm, EDGE_OVER_H * thickness_mm, (tilt[0] / w, tilt[1] / w), radii, low, high - low)

    def _plane(self, x: Floats, y: Floats, r: Floats) -> Floats:
        return np.asarray(1.0 + (self.tilt[0] * x + self.tilt[1] * y) * np.minimum(1.0, self.radius_mm / r))

    def at(self, x: Floats, y: Floats) -> _Surface:
        """The gel at places (any shape) from the face's middle, mm; within the edge its rounding is taken off."""
        r = np.maximum(np.hypot(x, y), 1e-6)
        low, more = (np.interp(r / self.radius_mm, self.r_over_a, one) for one in (self.low, self.more))
        plane, inside = self._plane(x, y, r), np.clip(r - self.radius_mm + self.edge_mm, 0.0, self.edge_mm)
        drop = np.where(r < self.radius_mm, self.edge_mm - np.sqrt(self.edge_mm**2 - inside**2), 0.0)
        return _Surface(low * plane, more * plane, drop)

    def slopes(self, x: Floats, y: Floats) -> tuple[_Surface, _Surface]:
        """dz/dx and dz/dy over w beside the face; what its tilt adds there is left out."""
        r = np.hypot(x, y)
        rates = [np.gradient(one, self.r_over_a) / self.radius_mm for one in (self.low, self.more)]
        low, more = (np.interp(r / self.radius_mm, self.r_over_a, one) for one in rates)
        return _Surface(low * x / r, more * x / r), _Surface(low * y / r, more * y / r)


@lru_cache(maxsize=64)
def _tabled(a_over_h: float, w_over_h: float) -> tuple[Floats, Floats, Floats]:
    """r/a (n,), and the depth over w there (n,) for both Poisson's ratios."""
    radii = 1.0 + np.linspace(0.0, 1.0, 300) ** 2 * 4.0 / a_over_h
    low, high = (
        -seen_profile(radii, PunchCase(nu, a_over_h, w_over_h, FRICTION), source=TABULATED.source)
        for nu in POISSON
    )
    return radii, low, high


def _rays(lamp: Lamp, profile: _Profile, place: tuple[Floats, Floats], pad: tuple[Floats, Floats]) -> _Rays:
    """The ways from places (n,) beside a face to a lamp; `place` from the face's middle, `pad` from the pad's."""
    x, y = place
    over = lamp.points_mm[:, :2, None] - np.stack(pad)
    distance = np.linalg.norm(over, axis=1)
    towards = over / distance[:, None]
    along = x * towards[:, 0] + y * towards[:, 1]
    inside = profile.radius_mm**2 - (x * x + y * y - along**2)
    entered = (inside > 0) & (along < 0)
    first = np.where(entered, -along - np.sqrt(np.maximum(inside, 0.0)), np.maximum(-along, 0.1))
    behind = profile.edge_mm * np.array(ROUND_THE_EDGE)
    away = np.concatenate(
        [first[:, None] * np.array(ON_THE_WAY)[:, None], first[:, None] + behind[:, None]], axis=1
    )
    surface = profile.at(x + towards[:, :1] * away, y + towards[:, 1:] * away)
    return _Rays(lamp, lamp.light(*pad)[2], distance, away, surface)


class _Task:
    """One fit; its unknowns are those of START, and ln of what each lamp gives to red, to green and to blue."""

    def __init__(self, beside: _Beside, light: Floats, reflected: Floats) -> None:
        self.beside, self.light, self.reflected = beside, light, reflected
        self.weight = np.sqrt(INDEPENDENT / light.size)
        self.lamps = len(beside.rays)
        self.start = np.array([*START, *[0.0] * (3 * self.lamps)])
        self.spread = np.array([*SPREAD, *[COLOUR_SPREAD] * (3 * self.lamps)])
        self.bounds = np.full(self.start.size, -np.inf), np.full(self.start.size, np.inf)
        self.bounds[0][1], self.bounds[1][1] = SHARES

    def residual(self, values: Floats) -> Floats:
        off = self._off(values, self._shown(values))
        loss = np.sign(off) * HEAVY * (np.sqrt(1.0 + np.abs(off)) - 1.0)
        return np.concatenate([self.weight * loss.ravel(), (values - self.start) / self.spread])

    def jacobian(self, values: Floats) -> Floats:
        shown = self._shown(values)
        off, shares = self._off(values, shown), self._shares(values)
        rates = np.zeros((values.size, *off.shape))
        for k in range(2):
            moved = values.copy()
            moved[k] += 1e-3
            rates[k] = -np.einsum("kln,ln->kn", shares, self._shown(moved) - shown) / 1e-3
        rates[0] -= 2.0 * self._reflected(values)
        for k in range(3):
            rates[2 + k, k] = np.exp(values[2 + k]) * self.light[k]
            mean = np.sum(shares[k] * shown, axis=0)
            first = len(START) + self.lamps * k
            rates[first : first + self.lamps, k] = -shares[k] * (shown - mean)
        rates[5] = -self._reflected(values)
        rates *= self.weight / STD * (HEAVY / 2.0) / np.sqrt(1.0 + np.abs(off))
        return np.concatenate([rates.reshape(values.size, -1).T, np.diag(1.0 / self.spread)])

    def dark(self, values: Floats) -> int:
        """How many places lie in a lamp's shadow."""
        _, seen = self.beside.light(self.beside.depth_mm * float(np.exp(values[0])), float(values[1]))
        return int(np.count_nonzero(seen.min(axis=0) < DARK))

    def _shown(self, values: Floats) -> Floats:
        return self.beside.light(self.beside.depth_mm * float(np.exp(values[0])), float(values[1]))[0]

    def _shares(self, values: Floats) -> Floats:
        shares = self.beside.shares * np.exp(values[len(START) :]).reshape(3, -1, 1)
        return np.asarray(shares / shares.sum(axis=1, keepdims=True))

    def _reflected(self, values: Floats) -> Floats:
        return np.asarray(self.reflected * np.exp(2.0 * values[0] + values[5]))

    def _off(self, values: Floats, shown: Floats) -> Floats:
        """How far the light (3, n) lies over the forecast, in deviations."""
        forecast = np.einsum("kln,ln->kn", self._shares(values), shown) + self._reflected(values)
        return np.asarray((np.exp(values[2:5])[:, None] * self.light - forecast) / STD)
