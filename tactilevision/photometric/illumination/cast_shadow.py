"""Which places a lamp reaches, forecast from a height map and the lamps' places.

A pressed face stands out towards camera and lamps, and its wall keeps the light of low lamps from the gel beside
it. Of a point Q of lamp l, from a place P of height z (towards the camera) only so much is hidden as stands higher
than the way to it:

    V_l(P) = share of the points Q with  max over s of (z(P + s u) - z(P))/s < Q_z/|Q - P|

u the direction to Q in the plane of the pad. In light, unshadowed = 1, channel k then shows

    D_k = sum_l m_kl V_l s_l(p, q) / sum_l m_kl s_l(p, q)        s_l the lamp's light on slopes p, q (lamps.py)

so a picture divided by D_k^(1/g) is the one without cast shadows. Light that the gel sends to itself is left out.

Whether a picture has such shadows is told without them. Weights a_k of channels with sum a_k = 1 and
sum a_k m_kl lean_l = 0 make, of the light D_k s_k that is seen and w_l = sum_k a_k m_kl,

    T = sum_k a_k I_k/I0_k - 1/sqrt(1 + p^2 + q^2) = -sum_l w_l (1 - V_l) s_l

which is 0 for any slope where all lamps reach, and about -1/3 where one does not. The share of the forecast that
is seen is the slope of a line through T against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.drift import SOFTENING_GREY
from tactilevision.photometric.illumination.lamps import Lamps, light_shares, shading
from tactilevision.records.measured import Bools, Bytes, Pair

CELL_MM = 0.125  # side of the cells that are forecast: a fifth of the shortest shadow that matters
STEP = 0.75  # cells from a place to the first height on the way to a lamp
GROWTH = 1.15  # from one such step to the next: what stands farther off is seen less finely
LONGEST = 2.5  # cells, the longest step
LIT = 0.97  # of a lamp's light: less is shadow
STANDS_OUT_MM = 0.03  # mm over the level gel: less throws no shadow of a cell's length
MIN_TANGENT = 0.1  # of a lamp's elevation: lower lamps would shade all of the pad

FAINTEST = 0.2  # of a channel's light that is left in shadow: darker is not believed
SMOOTH_PX = 1.0  # px, sigma: as the camera blurs the shadow's edge, about
EVIDENCE_CELL_MM = 0.25  # mm, side of the squares in which shadows are looked for
LEVEL = 0.25  # slope up to which squares count: the wall's own light is another matter
# root of the sum of squares of light forecast to be missing, over all squares: as of 25 that miss .08. Less tells
# nothing. Five sensors of another ray caster have .5 to 1.8, and without shadows show shares of -.17 to .12
MIN_SHADE = 0.4

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class LightField:
    """Lamps over a picture (H, W): `leans` (lamps, 2, H, W) of the light, `shares` m (channels, lamps, H, W)."""

    lamps: Lamps
    leans: Picture
    shares: Picture
    mm_per_px: Pair

    @classmethod
    def of(cls, lamps: Lamps, shape: tuple[int, int], mm_per_px: Pair) -> LightField:
        """The field over a picture of this (H, W) shape; mm_per_px (x, y) in mm."""
        y, x = ((np.arange(n) - (n - 1) / 2) * mm for n, mm in zip(shape, mm_per_px[::-1], strict=True))
        vectors = np.stack([lamp.light(*np.meshgrid(x, y)) for lamp in lamps.lamps])
        shares = light_shares(np.array([lamp.colour for lamp in lamps.lamps]).T, vectors[:, 2])
        leans = vectors[:, :2] / vectors[:, 2:]
        return cls(lamps, leans.astype(np.float32), shares.astype(np.float32), mm_per_px)

    @property
    def unrefined(self) -> LightField:
        """The same without refined lamps: faces are then as deep as their walls alone have them."""
        return replace(self, lamps=replace(self.lamps, refined=None))


def dimming(field: LightField, depth_mm: npt.NDArray[np.floating], seen: Picture | None = None) -> Picture:
    """Factor (H, W, 3) by which cast shadows change grey levels, from a depth map (H, W) in mm.

    `seen` (lamps, H, W): the map's `visibility`, where it is known already.
    """
    light = _of_lamps(field, depth_mm)
    seen = visibility(field.lamps, depth_mm, field.mm_per_px) if seen is None else seen
    part = [np.sum(m * seen * light, axis=0) / np.maximum(np.sum(m * light, axis=0), 1e-3) for m in field.shares]
    soft = [cv2.GaussianBlur(np.clip(one, FAINTEST, 1.0), (0, 0), SMOOTH_PX) for one in part]
    return np.asarray(np.stack(soft, axis=-1) ** np.float32(1.0 / field.lamps.power))


def shadow_share(
    field: LightField,
    pictures: Sequence[tuple[Bytes, npt.NDArray[np.floating]]],
    *,
    reference: npt.NDArray[np.floating],
) -> float:
    """What share of the forecast shadows is seen in pictures (H, W, 3), each with its depth map (H, W) in mm,
    beside their reference (H, W, 3), in grey levels.

    About 1 where lamps cast shadows, 0 where the light passes through what stands in its way; NaN where all depth
    maps together are forecast to be hardly darkened (`MIN_SHADE`).
    """
    seen = [_shade_and_missing(field, rgb, reference=reference, depth_mm=depth) for rgb, depth in pictures]
    shade, missing = (np.concatenate(part) for part in zip(*seen, strict=True))
    if np.linalg.norm(shade) < MIN_SHADE:
        return float("nan")
    return float(np.polyfit(shade, missing, 1)[0])


def _shade_and_missing(
    field: LightField, rgb: Bytes, *, reference: npt.NDArray[np.floating], depth_mm: npt.NDArray[np.floating]
) -> tuple[Picture, Picture]:
    """Of the level squares of one picture, the light forecast to be lost, and the light missing; (n,) each."""
    height, width = depth_mm.shape
    size = tuple(
        max(2, round(n * mm / EVIDENCE_CELL_MM)) for n, mm in zip((width, height), field.mm_per_px, strict=True)
    )
    light = _of_lamps(field, depth_mm)
    away = 1.0 - visibility(field.lamps, depth_mm, field.mm_per_px)
    now, before = (np.asarray(one, np.float32) + SOFTENING_GREY for one in (rgb, reference))
    ratio = now / before
    change = [ratio[..., k] ** np.float32(field.lamps.power) for k in range(3)]
    p, q = slopes_of(depth_mm, field.mm_per_px)
    planes = [*change, *(light * away), p, q, np.hypot(p, q)]
    cells = np.stack([cv2.resize(np.float32(one), size, interpolation=cv2.INTER_AREA) for one in planes])
    of_channels, of_lamps = _weights(field, size)
    shade = -np.sum(of_lamps * cells[3:-3], axis=0)
    missing = np.sum(of_channels * cells[:3], axis=0) - 1.0 / np.hypot(1.0, np.hypot(*cells[-3:-1]))
    counts = cells[-1] < LEVEL
    return shade[counts], missing[counts]


def _weights(field: LightField, size: tuple[int, ...]) -> tuple[Picture, Picture]:
    """a of the channels (3, h, w) and w of the lamps (lamps, h, w), on squares."""
    many = len(field.leans)
    leans, shares = (
        np.stack([cv2.resize(one, size[:2], interpolation=cv2.INTER_AREA) for one in planes.reshape(-1, *shape)])
        for planes, shape in ((field.leans, field.leans.shape[2:]), (field.shares, field.shares.shape[2:]))
    )
    lean, share = leans.reshape(many, 2, *leans.shape[1:]), shares.reshape(3, many, *leans.shape[1:])
    system = np.concatenate([np.ones_like(share[None, :, 0]), np.einsum("klhw,lchw->ckhw", share, lean)])
    wanted = np.broadcast_to(np.array([1.0, 0.0, 0.0])[:, None], (*leans.shape[1:], 3, 1))
    channels = np.linalg.solve(np.moveaxis(system, (0, 1), (-2, -1)), wanted)[..., 0]
    of_channels = np.moveaxis(channels, -1, 0)
    return of_channels, np.einsum("khw,klhw->lhw", of_channels, share)


def _of_lamps(field: LightField, depth_mm: npt.NDArray[np.floating]) -> Picture:
    p, q = slopes_of(depth_mm, field.mm_per_px)
    return np.asarray(shading(field.leans, p, q), np.float32)


def slopes_of(depth_mm: npt.NDArray[np.floating], mm_per_px: Pair) -> tuple[Picture, Picture]:
    """dz/dx and dz/dy (H, W) of a depth map (H, W) in mm."""
    smooth = cv2.GaussianBlur(np.asarray(depth_mm, np.float32), (0, 0), SMOOTH_PX)
    q, p = np.gradient(smooth, mm_per_px[1], mm_per_px[0])
    return p, q


def visibility(lamps: Lamps, depth_mm: npt.NDArray[np.floating], mm_per_px: Pair) -> Picture:
    """Share (lamps, H, W), from 0 to 1, of each lamp's points that reach the places of a depth map (H, W) mm."""
    height, width = depth_mm.shape
    rows, columns = (
        max(2, round(n * mm / CELL_MM)) for n, mm in zip(depth_mm.shape, mm_per_px[::-1], strict=True)
    )
    coarse = cv2.resize(np.asarray(depth_mm, np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    cell = (width * mm_per_px[0] / columns, height * mm_per_px[1] / rows)
    x = ((np.arange(columns) - (columns - 1) / 2) * cell[0])[None, :].astype(np.float32)
    y = ((np.arange(rows) - (rows - 1) / 2) * cell[1])[:, None].astype(np.float32)
    seen = np.ones((len(lamps.lamps), rows, columns), np.float32)
    if (box := _box(lamps, coarse, cell)) is not None:
        part = coarse[box], (x[:, box[1]], y[box[0]])
        for one, lamp in zip(seen, lamps.lamps, strict=True):
            one[box] = np.mean([_reached(point, *part, cell) for point in lamp.points_mm], axis=0)
    return np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) for one in seen])


def lit(lamps: Lamps, depth_mm: npt.NDArray[np.floating], mm_per_px: Pair) -> Bools:
    """Mask (H, W) of the places of a depth map (H, W), mm, that all lamps reach."""
    return reached_by_all(visibility(lamps, depth_mm, mm_per_px))


def reached_by_all(seen: Picture) -> Bools:
    """Mask (H, W) of the places that all lamps reach, by their visibility (lamps, H, W)."""
    return np.asarray(seen.min(axis=0) > LIT)


def _box(lamps: Lamps, heights: Picture, cell: Pair) -> tuple[slice, slice] | None:
    """Rows and columns of the cells that something which stands out may shade; None where nothing does."""
    level = float(np.median(heights))
    raised = heights > level + STANDS_OUT_MM
    if not raised.any():
        return None
    tangent = min(lamp.height_mm / (lamp.distance_mm + lamp.length_mm) for lamp in lamps.lamps)
    reach = (float(heights.max()) - level) / max(tangent, MIN_TANGENT)
    found = []
    for axis, mm in ((1, cell[1]), (0, cell[0])):
        where = np.flatnonzero(raised.any(axis=axis))
        extra = int(reach / mm) + 2
        found.append(slice(max(int(where[0]) - extra, 0), int(where[-1]) + extra + 1))
    return found[0], found[1]


def _reached(
    point: npt.NDArray[np.float64], heights: Picture, places: tuple[Picture, Picture], cell: Pair
) -> Picture:
    """1 where a point of a lamp is seen from the cells (h, w), 0 where something stands in its way."""
    over_x, over_y = point[0] - places[0], point[1] - places[1]
    distance = np.hypot(over_x, over_y)
    towards_x, towards_y = over_x / distance, over_y / distance
    tangent = np.maximum(point[2] / distance, MIN_TANGENT).astype(np.float32)
    column = np.arange(heights.shape[1], dtype=np.float32)[None, :]
    row = np.arange(heights.shape[0], dtype=np.float32)[:, None]
    towards_x, towards_y = ((a / b).astype(np.float32) for a, b in zip((towards_x, towards_y), cell, strict=True))
    seen = np.ones(heights.shape, np.float32)
    farthest = (float(heights.max()) - float(heights.min())) / float(tangent.min())
    step = away = STEP * min(cell)
    while away < farthest + step:
        far = np.float32(away)
        there = cv2.remap(
            heights,
            column + towards_x * far,
            row + towards_y * far,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        seen[there - heights > tangent * far] = 0.0
        step = min(GROWTH * step, LONGEST * min(cell))
        away += step
    return seen
