"""Light that the gel sends to itself: the wall of a pressed face shines on the gel beside it.

The gel at P gets, of lamp l and over what level gel gets of it,

    e_l(P) = rho/pi sum_Q s_l(Q) (n_P.d) (n_Q.-d) / |d|^4 A_Q,      d = Q - P,  both sides facing each other

s_l the lamp's light on the slope at Q (lamps.py), n = (-dz/dx, -dz/dy, 1) of the surface, A_Q the cell in the
plane of the pad, rho the ink's reflectance. The wall towards a lamp is the brightest place of the picture and
shines on gel that tilts away from that lamp: it is read too level, as the square of the depth, and its rise too
low. Channel k then shows 1 + sum_l m_kl e_l / sum_l m_kl s_l times its light. One reflection, diffuse; nothing in
its way. The cells blur the wall: beside a long one .45, .7, .75 of the exact light comes out at 1.6, 4, 6 heights.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.lamps import shading
from tactilevision.records.measured import Bytes, Floats, Pair

REFLECTANCE = 0.5  # of the ink, a share, as cells show it: nu is right for inks of .6 (docs/evidence/rendered.md)
CELL_MM = 0.25  # mm, side of the cells that light is exchanged between
STEEP = 0.2  # slope from which a cell counts as one that shines on others: gentler ones give a hundredth
CHUNK = 8  # steep cells whose light is worked out at once: more do not fit the cache of a core
FAINT = 0.2  # of a channel's light, the least that the reflected one is held against, as in cast_shadow.py
SPREAD = (0.7548776662, 0.5698402910)  # steps of a low-discrepancy grid (Roberts 2018), of a grey level a pixel

Picture = npt.NDArray[np.float32]


def reflected(
    field: LightField, depth_mm: npt.NDArray[np.floating], *, reflectance: float = REFLECTANCE
) -> Picture:
    """Factor (H, W, 3) by which light from other gel raises grey levels, from a depth map (H, W) in mm."""
    height, width = depth_mm.shape
    columns, rows = (
        max(2, round(n * mm / CELL_MM)) for n, mm in zip((width, height), field.mm_per_px, strict=True)
    )
    step = (width * field.mm_per_px[0] / columns, height * field.mm_per_px[1] / rows)

    z = _coarse(depth_mm, (columns, rows))
    q, p = (np.asarray(one) for one in np.gradient(z, step[1], step[0]))
    leans, shares = _coarse_field(field, (columns, rows))
    light = np.asarray(shading(leans, p, q), np.float64)
    received = reflectance * _received(z, (p, q), light, step)
    plain = np.maximum(np.einsum("klhw,lhw->khw", shares, light), FAINT)
    factor = 1.0 + np.einsum("klhw,lhw->khw", shares, received) / plain
    fine = [cv2.resize(np.float32(one), (width, height), interpolation=cv2.INTER_LINEAR) for one in factor]
    return np.asarray(np.stack(fine, axis=-1) ** np.float32(1.0 / field.lamps.power))


def _coarse(plane: npt.NDArray[np.floating], size: tuple[int, int]) -> Floats:
    return np.asarray(cv2.resize(np.float32(plane), size, interpolation=cv2.INTER_AREA), np.float64)


@lru_cache(maxsize=4)  # fields, of which each frame asks several times
def _coarse_field(field: LightField, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """A field's leans and shares on cells, `size` (columns, rows) of them."""
    leans, shares = (
        np.stack([np.stack([_coarse(one, size) for one in planes]) for planes in part])
        for part in (field.leans, field.shares)
    )
    return leans, shares


def without(rgb: Bytes, factor: Picture) -> Bytes:
    """The picture (H, W, 3) less what raised it by `factor` (H, W, 3), in grey levels.

    A factor of some thousandths is lost where each pixel is rounded alike: thresholds are spread evenly instead.
    """
    return np.asarray(np.clip(np.floor(rgb / factor + _thresholds(*rgb.shape[:2])), 0, 255).astype(np.uint8))


@lru_cache(maxsize=4)
def _thresholds(height: int, width: int) -> Picture:
    """Of rounding (H, W, 1), spread evenly from 0 to 1 grey level."""
    rows, columns = np.indices((height, width), dtype=np.float32)
    return np.asarray((SPREAD[0] * columns + SPREAD[1] * rows) % 1.0, np.float32)[..., None]


def _received(z: Floats, slopes: tuple[Floats, Floats], light: Floats, step: Pair) -> Floats:
    """sum_Q of the equation above over pi (3, h, w), from heights (h, w) mm, their slopes and the light there."""
    p, q = (slope.ravel() for slope in slopes)
    rows, columns = (at.ravel() * mm for at, mm in zip(np.indices(z.shape), step[::-1], strict=True))
    places, one = np.stack([columns, rows, z.ravel()]), np.ones(z.size)  # mm
    normals, far = np.stack([-p, -q, one]), np.sum(places**2, axis=0)
    planes = np.vstack([normals, -np.sum(normals * places, axis=0)])  # n.x - n.P: 0 on the tangent plane at P
    points = np.vstack([places, one])
    total, every = np.zeros((len(light), z.size)), light.reshape(len(light), -1)
    steep = np.flatnonzero(np.hypot(p, q) > STEEP)
    for start in range(0, len(steep), CHUNK):
        own = steep[start : start + CHUNK]
        kernel, there = points[:, own].T @ planes, planes[:, own].T @ points
        np.maximum(kernel, 0.0, out=kernel)
        kernel *= np.maximum(there, 0.0, out=there)
        square = np.vstack([-2.0 * places[:, own], one[own], far[own]]).T @ np.vstack([places, far, one])
        square[np.arange(len(own)), own] = np.inf
        square *= square
        kernel /= square
        total += every[:, own] @ kernel
    return total.reshape(light.shape) * (step[0] * step[1] / np.pi)
