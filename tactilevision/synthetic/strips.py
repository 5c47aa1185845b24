"""Strip lamps near the gel, and the shadows that the gel casts on itself.

A strip shines from its front with the same radiance in every direction (Lambert). At a place P of the pad it gives
the vector

    e = (1/N) Σ_k w_k d_k        d_k = (L_k - P)/r_k        w_k = max(-f·d_k, 0)/r_k²

over N points L_k along its length; f is the direction that the front faces. How much of point k is seen from P is

    V_k = (t⁺ - h)/(t⁺ - t⁻), held between 0 and 1        h = max_s (z(P + s u) - z(P))/s

with t± the tangents of the elevations at which the strip's two long edges stand over P, u the direction towards
L_k in the plane of the pad, and h the tangent of the horizon that the gel makes there. So a penumbra grows with
the distance from the edge that casts it. The share of the whole strip is Σ V_k w_k d_kz / Σ w_k d_kz.

Assumptions: the horizon is level over the strip's width, and the light falls on a surface that leans little. A
lamp's distance is measured from the untouched gel, so that raised places are not nearer to it. Light that the gel
sends to itself is left out. Beside Mitsuba's direct light on diffuse ink: 1 to 2.5 grey levels rms where a shadow
darkens by more than 5 (python -m benchmarks.rendered --compare).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.synthetic.gel import Grid, Singles, Surface
from tactilevision.synthetic.lights import Light, Shine, Triple, shine_of

SHADOW_STRIP_MM = (12.0, 2.0)  # mm, length and width of a usual lamp of these sensors
_POINTS = 8  # points along a strip: twice as many change shaded places by less than .1 grey level rms
_FINER = 3  # heights for each pixel along either axis, from which horizons are read
_STEP = 3.0  # fine pixels from one height on the way to the lamp to the next
_STEEP = 0.8  # of a lamp's lowest tangent: no gentler slope can cast a shadow


@dataclass(frozen=True, slots=True)
class Strip:
    """A lamp: `centre_mm` and the point `aim_mm` that its front faces, from the pad's centre with z towards the
    camera; its long side is level. `brightness` it gives the brightest place, `colour` it gives the channels."""

    centre_mm: Triple
    aim_mm: Triple
    length_mm: float
    width_mm: float
    brightness: float
    colour: Triple

    @property
    def front(self) -> Floats:
        """Unit vector (3,) of the direction it faces."""
        way = np.subtract(self.aim_mm, self.centre_mm)
        return np.asarray(way / np.linalg.norm(way))

    def points(self) -> tuple[Floats, Floats]:
        """Points (N, 3) mm along its middle, and the vector (3,) mm from there to its upper long edge."""
        front = self.front
        along = np.cross(front, (0.0, 0.0, 1.0))
        along /= np.linalg.norm(along)
        places = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
        upper = np.cross(along, front) * self.width_mm / 2
        return np.asarray(self.centre_mm) + self.length_mm * places[:, None] * along, upper * np.sign(upper[2])


def strip_of(light: Light, size_mm: Pair) -> Strip:
    """A strip of length and width `size_mm` in a point light's place, which faces what the light is aimed at."""
    aim = (light.aim_mm[0], light.aim_mm[1], 0.0)
    return Strip(light.position_mm, aim, *size_mm, brightness=light.brightness, colour=light.colour)


def strip_shine(strip: Strip, grid: Grid, *, reference: Grid) -> Shine:
    """The strip's light (H, W) on a grid; `reference` is the whole pad, on which its brightness is defined."""
    x, y, z = _vector(strip, grid)
    brightest = float(_vector(strip, reference)[2].max())
    return shine_of((x, y, z), np.float32(strip.brightness / brightest), colour=strip.colour)


def visibility(strips: Sequence[Strip], surface: Surface, grid: Grid) -> tuple[Singles, ...]:
    """Share (H, W) of each strip's light that reaches a place of a surface, a ratio; 1 with nothing in its way.

    One number per pixel, of the grid's places; heights are read from a grid three times finer.
    """
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
        """Rows and columns of the coarse grid that a shadow can reach; None where no slope is steep enough."""
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
    """Pixels (H, W) whose light is asked for: places and heights in mm, and where they are in the fine relief."""

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
        """Share (H, W) of the strip's width that is seen at one point of its length."""
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
        """Largest rise over run (H, W) on the way to the lamp."""
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
    """The light's vector (x, y, z), (H, W) each in a unit of its own."""
    total = np.zeros((3, grid.y_mm.size, grid.x_mm.size), np.float32)
    points, _ = strip.points()
    for point in points:
        strength, way = _strength(point, strip.front, grid)
        for axis in range(3):
            total[axis] += strength * way[axis]
    return total[0], total[1], total[2]


def _strength(point: Floats, front: Floats, grid: Grid) -> tuple[Singles, tuple[Singles, Singles, np.float32]]:
    """w/r (H, W) of one point in a unit of its own, and the way (x, y, z) mm to it."""
    x, y = grid.places()
    to_x, to_y, to_z = np.float32(point[0]) - x, np.float32(point[1]) - y, np.float32(point[2])
    squared = to_x * to_x + to_y * to_y + to_z * to_z
    facing = -(np.float32(front[0]) * to_x + np.float32(front[1]) * to_y + np.float32(front[2]) * to_z)
    strength = np.maximum(facing, 0.0) / (squared * squared) * np.float32(1e3)
    return np.asarray(strength, dtype=np.float32), (to_x, to_y, to_z)


def _lowest(points: Floats, upper: Floats, grid: Grid) -> float:
    """Tangent of the lowest elevation at which any place of the grid sees the strip."""
    corners = np.array([(x, y) for x in grid.x_mm[[0, -1]] for y in grid.y_mm[[0, -1]]])
    lower = points - upper
    far = np.linalg.norm(lower[:, None, :2] - corners, axis=-1).max(axis=1)
    return float((lower[:, 2] / far).min())
