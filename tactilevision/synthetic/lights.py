"""Lights over the gel: point lights, strip lamps with cast shadows, and the slope response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Floats, Pair
from tactilevision.synthetic.gel import Grid, Singles, Surface

# Three near-field coloured lights over a gel. At a place x on the pad a light at position L (z towards the camera)
# gives the vector e = I B (L - x)/|L - x|³, B a Gaussian beam around its aim. A surface of depth slope (p, q) with
# normal n = (-p, -q, 1)/sqrt(1 + p² + q²) returns
#
#     s(n·e)  +  gloss |e| (n·m)^16        s(v) = (v + sqrt(v² + (2δ|e|)²))/2
#
# with m half-way between light and camera. s makes walls steeper than the elevation of the light dark over the
# soft edge δ of an extended light.

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Shine:
    """One light on one grid: its vector (ex, ey, ez), (H, W) each, and its half-way direction."""

    vector: tuple[Singles, Singles, Singles]
    strength: Singles
    half_way: tuple[Singles, Singles, Singles]
    colour: Triple


@dataclass(frozen=True, slots=True)
class Light:
    """One lamp: `position_mm` from the centre of the pad, `aim_mm` and `beam_mm` (per axis) of its Gaussian beam.

    `brightness` at the brightest place of the pad, `colour` its share in the channels.
    """

    position_mm: Triple
    aim_mm: Pair
    beam_mm: Pair
    brightness: float
    colour: Triple

    def shine(self, grid: Grid, *, reference: Grid) -> Shine:
        """Return the light on a grid; `reference` is the whole pad, on which its brightness is defined."""
        x, y, z, strength = _rays(self, grid)
        _, _, z_all, strength_all = _rays(self, reference)
        strength = strength * np.float32(self.brightness / float((strength_all * z_all).max()))
        vector = _single(strength * x), _single(strength * y), _single(strength * z)
        return Shine(vector, strength, _half_way(x, y, z), self.colour)

    def strip(self, size_mm: Pair) -> Strip:
        """Return a strip of length and width `size_mm` with the same position and aim."""
        aim = (self.aim_mm[0], self.aim_mm[1], 0.0)
        return Strip(self.position_mm, aim, *size_mm, brightness=self.brightness, colour=self.colour)


@dataclass(frozen=True, slots=True)
class Finish:
    """Reflection of the ink: `gloss` of its highlight, `soft_edge` δ of attached shadows."""

    gloss: float = 0.03
    soft_edge: float = 0.06


def _half_way(x: Singles, y: Singles, z: Singles) -> tuple[Singles, Singles, Singles]:
    """Return the unit vector half-way between a light's direction and the camera's."""
    norm = np.sqrt(x * x + y * y + (z + 1) ** 2)
    return _single(x / norm), _single(y / norm), _single((z + 1) / norm)


def _single(values: npt.NDArray[Any]) -> Singles:
    return np.asarray(values, dtype=np.float32)


def _rays(light: Light, grid: Grid) -> tuple[Singles, Singles, Singles, Singles]:
    """Return the unit direction to the light and its unscaled strength, (H, W) each."""
    px, py = grid.places()
    dx, dy, dz = light.position_mm[0] - px, light.position_mm[1] - py, np.float32(light.position_mm[2])
    squared = dx * dx + dy * dy + dz * dz
    root = np.sqrt(squared)
    ax, ay = (px - light.aim_mm[0]) / light.beam_mm[0], (py - light.aim_mm[1]) / light.beam_mm[1]
    beam = np.exp(-0.5 * (ax * ax + ay * ay)).astype(np.float32)
    return _single(dx / root), _single(dy / root), _single(dz / root), _single(beam / squared)


def reflect(
    shines: tuple[Shine, ...],
    gains: Floats,
    *,
    slopes: tuple[Singles, Singles],
    finish: Finish,
    shares: tuple[Singles, ...] | None = None,
) -> Singles:
    """Return linear light (H, W, 3) at the camera from slopes dz/dx, dz/dy, each lamp times its gain.

    `shares`: visible share (H, W) of each lamp; None: all.
    """
    p, q = slopes
    up = 1 / np.sqrt(1 + p * p + q * q)
    light = np.zeros((*p.shape, 3), np.float32)
    for i, (lamp, gain) in enumerate(zip(shines, gains, strict=True)):
        ex, ey, ez = lamp.vector
        v = (ez - p * ex - q * ey) * up
        soft = np.float32(2 * finish.soft_edge) * lamp.strength
        back = 0.5 * (v + np.sqrt(v * v + soft * soft))
        if finish.gloss > 0:
            mx, my, mz = lamp.half_way
            shiny = np.maximum((mz - p * mx - q * my) * up, 0.0)
            for _ in range(4):
                shiny = shiny * shiny
            back = back + np.float32(finish.gloss) * lamp.strength * shiny
        if shares is not None:
            back = back * shares[i]
        for channel, share in enumerate(lamp.colour):
            if share > 0:
                light[..., channel] += np.float32(share * gain) * back
    return light


def gelslim_lights() -> tuple[Light, ...]:
    """Return the lights of GelSlim 3.0: blue from the top, green from the left, red from the lower right."""
    return (
        Light((4.6, 11, 8.1), (-1.2, 4.2), (8, 8), 0.82, (1, 0, 0.12)),
        Light((-19.4, 3.1, 5), (14, -0.7), (21.7, 14), 2.09, (0, 1, 0.7)),
        Light((8.4, -12.4, 8.9), (-6.2, 11), (12, 17.3), 1.21, (0, 0.17, 1)),
    )


def random_lights(rng: np.random.Generator) -> tuple[Light, ...]:
    """Return three lights at about 120 degrees, of random elevations, distances, beams, colours and order."""
    start, hand = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
    lights = []
    for i, main in enumerate(rng.permutation(3)):
        angle = start + hand * (i * 2 * np.pi / 3 + rng.uniform(-0.35, 0.35))
        out, height = rng.uniform(14, 24), rng.uniform(9, 20)
        direction = np.array([np.cos(angle), np.sin(angle)])
        aim = direction * rng.uniform(0, 7) + rng.uniform(-2, 2, 2)
        beam = rng.uniform(10, 22, 2)
        colour = rng.uniform(0.02, 0.30, 3)
        colour[main] = 1.0
        x, y = direction * out
        lights.append(
            Light(
                (float(x), float(y), float(height)),
                (float(aim[0]), float(aim[1])),
                (float(beam[0]), float(beam[1])),
                float(rng.uniform(0.45, 0.75)),
                (float(colour[0]), float(colour[1]), float(colour[2])),
            )
        )
    return tuple(lights)


# Strip lamps near the gel and the shadows that the gel casts. A strip radiates from its front with the same
# radiance in every direction (Lambert). At a place P of the pad it gives the vector
#
#     e = (1/N) Σ_k w_k d_k        d_k = (L_k - P)/r_k        w_k = max(-f·d_k, 0)/r_k²
#
# over N points L_k along its length, f the direction of the front. The visible share of point k is
#
#     V_k = (t⁺ - h)/(t⁺ - t⁻), clipped to 0 to 1        h = max_s (z(P + s u) - z(P))/s
#
# with t± the tangents of the elevations of the strip's two long edges over P, u the direction towards L_k in the
# plane of the pad, and h the tangent of the horizon of the gel. The share of the whole strip is Σ V_k w_k d_kz / Σ
# w_k d_kz.
#
# Assumptions: the horizon is level over the strip's width, and the lit surface slopes little; distances to lamps
# are from the untouched gel; no light from gel to gel. Compared with Mitsuba's direct light on diffuse ink: 1 to
# 2.5 grey levels rms where a shadow darkens by more than 5 (python -m benchmarks.rendered --compare).

SHADOW_STRIP_MM = (12, 2)  # mm, length and width of a usual lamp of these sensors
_POINTS = 8  # points along a strip: twice as many change shaded places by less than .1 grey level rms
_FINER = 3  # heights per pixel along either axis for horizons
_STEP = 3  # fine pixels between heights on the way to the lamp
_STEEP = 0.8  # of a lamp's lowest tangent: gentler slopes cast no shadow


@dataclass(frozen=True, slots=True)
class Strip:
    """A strip lamp: `centre_mm` and the point `aim_mm` that its front faces, from the centre of the pad.

    z is towards the camera; the long side is level. `brightness` and `colour` as of a `Light`.
    """

    centre_mm: Triple
    aim_mm: Triple
    length_mm: float
    width_mm: float
    brightness: float
    colour: Triple

    @property
    def front(self) -> Floats:
        """Unit vector (3,) of the direction of its front."""
        way = np.subtract(self.aim_mm, self.centre_mm)
        return np.asarray(way / np.linalg.norm(way))

    def points(self) -> tuple[Floats, Floats]:
        """Return points (N, 3) mm along its middle, and the vector (3,) mm from there to its upper long edge."""
        front = self.front
        along = np.cross(front, (0.0, 0.0, 1.0))
        along /= np.linalg.norm(along)
        places = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
        upper = np.cross(along, front) * self.width_mm / 2
        return np.asarray(self.centre_mm) + self.length_mm * places[:, None] * along, upper * np.sign(upper[2])

    def shine(self, grid: Grid, *, reference: Grid) -> Shine:
        """Return its light on a grid; `reference` is the whole pad, on which its brightness is defined."""
        vector = _vector(self, grid)
        scale = np.float32(self.brightness / float(_vector(self, reference)[2].max()))
        strength = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
        half_way = _half_way(*(axis / strength for axis in vector))
        scaled = _single(vector[0] * scale), _single(vector[1] * scale), _single(vector[2] * scale)
        return Shine(scaled, _single(strength * scale), half_way, self.colour)

    def strip(self, size_mm: Pair) -> Strip:
        """Return itself, whatever `size_mm`."""
        return self


def visibility(strips: Sequence[Strip], surface: Surface, grid: Grid) -> tuple[Singles, ...]:
    """Return the visible share (H, W) of each strip over a surface, by heights on a grid three times finer."""
    fine = grid.finer((slice(None), slice(None)), _FINER)
    relief = _Relief.of(surface.depth_mm(fine), fine)
    return tuple(_share(strip, relief, grid) for strip in strips)


def _share(strip: Strip, relief: _Relief, grid: Grid) -> Singles:
    share = np.ones((grid.y_mm.size, grid.x_mm.size), np.float32)
    points, upper = strip.points()
    part = relief.reached(_lowest(points, upper, grid))
    if part is None:
        return share
    window = Grid(grid.x_mm[part[1]], grid.y_mm[part[0]])
    lit, whole = np.zeros((2, window.y_mm.size, window.x_mm.size), np.float32)
    place = _Place.at(window, relief)
    for point in points:
        weight = point[2] * _strength(point, strip.front, window)[0]
        lit += weight * place.seen(point, upper)
        whole += weight
    share[part] = lit / np.maximum(whole, np.float32(1e-12))
    return share


@dataclass(frozen=True, slots=True, eq=False)
class _Relief:
    """Heights (H, W) mm on the `fine` grid, the slope (H - 1, W - 1) there, and their range in mm."""

    fine: Grid
    heights: Singles
    slope: Singles
    lowest_mm: float
    highest_mm: float

    @classmethod
    def of(cls, heights: Singles, fine: Grid) -> _Relief:
        step_x, step_y = (np.float32(step) for step in fine.spacing_mm)
        p = np.abs(np.diff(heights, axis=1))[:-1] / step_x
        q = np.abs(np.diff(heights, axis=0))[:, :-1] / step_y
        slope = np.asarray(np.maximum(p, q), dtype=np.float32)
        return cls(fine, heights, slope, float(heights.min()), float(heights.max()))

    def reached(self, tangent: float) -> tuple[slice, slice] | None:
        """Return rows and columns of the coarse grid that a shadow can reach; None without steep slopes."""
        steep = self.slope > _STEEP * tangent / np.sqrt(2)
        rows, columns = np.flatnonzero(steep.any(axis=1)), np.flatnonzero(steep.any(axis=0))
        if not rows.size:
            return None
        reach = int(np.ceil((self.highest_mm - self.lowest_mm) / tangent / min(self.fine.spacing_mm))) + _FINER
        spans = []
        for places, count in zip((rows, columns), self.heights.shape, strict=True):
            first, last = max(int(places[0]) - reach, 0), min(int(places[-1]) + reach, count)
            spans.append(slice(first // _FINER, -(-last // _FINER)))
        return spans[0], spans[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Pixels (H, W) to light: places and heights in mm, and their column and row in the fine relief."""

    x_mm: Singles
    y_mm: Singles
    z_mm: Singles
    column: Singles
    row: Singles
    relief: _Relief

    @classmethod
    def at(cls, window: Grid, relief: _Relief) -> _Place:
        x, y = window.places()
        step_x, step_y = relief.fine.spacing_mm
        column = (x - np.float32(relief.fine.x_mm[0])) / np.float32(step_x)
        row = (y - np.float32(relief.fine.y_mm[0])) / np.float32(step_y)
        return cls(x, y, cv2.remap(relief.heights, column, row, cv2.INTER_LINEAR), column, row, relief)

    def seen(self, point: Floats, upper: Floats) -> Singles:
        """Return the visible share (H, W) of the strip's width at one point of its length."""
        to_x, to_y = np.float32(point[0]) - self.x_mm, np.float32(point[1]) - self.y_mm
        distance = np.hypot(to_x, to_y)
        top, bottom = (self._tangent(point + sign * upper) for sign in (1, -1))
        horizon = self._horizon(to_x / distance, to_y / distance, float(bottom.min()))
        share = (top - horizon) / np.maximum(top - bottom, np.float32(1e-4))
        return np.asarray(np.clip(share, 0.0, 1.0), dtype=np.float32)

    def _tangent(self, point: Floats) -> Singles:
        distance = np.hypot(np.float32(point[0]) - self.x_mm, np.float32(point[1]) - self.y_mm)
        return np.asarray((np.float32(point[2]) - self.z_mm) / distance, dtype=np.float32)

    def _horizon(self, along_x: Singles, along_y: Singles, lowest: float) -> Singles:
        """Return the largest rise over run (H, W) on the way to the lamp."""
        horizon = np.zeros_like(self.z_mm)
        fine_mm, fine_y_mm = self.relief.fine.spacing_mm
        aspect = np.float32(fine_mm / fine_y_mm)
        reach_mm = (self.relief.highest_mm - self.relief.lowest_mm) / lowest
        for step in range(1, int(reach_mm / (_STEP * fine_mm)) + 2):
            run = np.float32(_STEP * step)
            ahead = cv2.remap(
                self.relief.heights,
                self.column + run * along_x,
                self.row + run * aspect * along_y,
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
            np.maximum(horizon, (ahead - self.z_mm) * np.float32(1 / (run * fine_mm)), out=horizon)
        return horizon


def _vector(strip: Strip, grid: Grid) -> tuple[Singles, Singles, Singles]:
    """Return the vector (x, y, z) of a strip's light, (H, W) each, unscaled."""
    total = np.zeros((3, grid.y_mm.size, grid.x_mm.size), np.float32)
    points, _ = strip.points()
    for point in points:
        strength, way = _strength(point, strip.front, grid)
        for axis in range(3):
            total[axis] += strength * way[axis]
    return total[0], total[1], total[2]


def _strength(point: Floats, front: Floats, grid: Grid) -> tuple[Singles, tuple[Singles, Singles, np.float32]]:
    """Return w/r (H, W) of one point, unscaled, and the vector (x, y, z) mm to it."""
    x, y = grid.places()
    to_x, to_y, to_z = np.float32(point[0]) - x, np.float32(point[1]) - y, np.float32(point[2])
    squared = to_x * to_x + to_y * to_y + to_z * to_z
    facing = -(np.float32(front[0]) * to_x + np.float32(front[1]) * to_y + np.float32(front[2]) * to_z)
    strength = np.maximum(facing, 0.0) / (squared * squared) * np.float32(1000)
    return np.asarray(strength, dtype=np.float32), (to_x, to_y, to_z)


def _lowest(points: Floats, upper: Floats, grid: Grid) -> float:
    """Return the tangent of the lowest elevation of the strip over any place of the grid."""
    corners = np.array([(x, y) for x in grid.x_mm[[0, -1]] for y in grid.y_mm[[0, -1]]])
    lower = points - upper
    far = np.linalg.norm(lower[:, None, :2] - corners, axis=-1).max(axis=1)
    return float((lower[:, 2] / far).min())


# Slope response: change of the light's response to slope after the reference pictures.
#
#     shown = S tanh(g s/S) s/|s|,    g = 1 + gain + drift t/T
#
# s the slope (its size |s|), t the time and T the end of the recording. A clouded gel scatters light before it
# reaches the ink, so that brightness follows slopes less: g below 1. Worn ink or clipped exposure saturates at S.


@dataclass(frozen=True, slots=True)
class SlopeResponse:
    """`gain` and `drift` as shares of every slope; `steepest` S; `end_s` T on the camera's clock."""

    gain: float = 0.0
    drift: float = 0.0
    steepest: float = float("inf")
    end_s: float = 1.0

    def shown(self, slopes: tuple[Singles, Singles], time_s: float) -> tuple[Singles, Singles]:
        """Return the slopes dz/dx, dz/dy (H, W) that the light shows; the same arrays without any change."""
        factor = 1 + self.gain + self.drift * time_s / self.end_s
        if factor == 1 and np.isinf(self.steepest):
            return slopes
        p, q = slopes
        share: Singles | np.float32 = np.float32(factor)
        if np.isfinite(self.steepest):
            x = np.maximum(np.hypot(p, q) * share / np.float32(self.steepest), np.float32(MICRO))
            share = np.asarray(share * np.tanh(x) / x, dtype=np.float32)
        return p * share, q * share


SOUND = SlopeResponse()
