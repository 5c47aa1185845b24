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

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.lamps import shading
from tactilevision.records import Bytes, Floats, Pair

REFLECTANCE = 0.5  # of the ink, a share, as cells show it: nu is right for inks of .6 (docs/evidence/rendered.md)
CELL_MM = 0.25  # mm, side of the cells that light is exchanged between
STEEP = 0.2  # slope from which a cell counts as one that shines on others: gentler ones give a hundredth
CHUNK = 32  # steep cells whose light is worked out at once: more do not fit the cache
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

    def coarse(plane: npt.NDArray[np.floating]) -> Floats:
        return np.asarray(cv2.resize(np.float32(plane), (columns, rows), interpolation=cv2.INTER_AREA), np.float64)

    z = coarse(depth_mm)
    q, p = (np.asarray(one) for one in np.gradient(z, step[1], step[0]))
    leans = np.stack([np.stack([coarse(one) for one in lamp]) for lamp in field.leans])
    light = np.asarray(shading(leans, p, q), np.float64)
    received = reflectance * _received(z, (p, q), light, step)
    shares = np.stack([np.stack([coarse(one) for one in channel]) for channel in field.shares])
    plain = np.maximum(np.einsum("klhw,lhw->khw", shares, light), FAINT)
    factor = 1.0 + np.einsum("klhw,lhw->khw", shares, received) / plain
    fine = [cv2.resize(np.float32(one), (width, height), interpolation=cv2.INTER_LINEAR) for one in factor]
    return np.asarray(np.stack(fine, axis=-1) ** np.float32(1.0 / field.lamps.power))


def without(rgb: Bytes, factor: Picture) -> Bytes:
    """The picture (H, W, 3) less what raised it by `factor` (H, W, 3), in grey levels.

    A factor of some thousandths is lost where each pixel is rounded alike: thresholds are spread evenly instead.
    """
    rows, columns = np.indices(rgb.shape[:2], dtype=np.float32)
    threshold = np.asarray((SPREAD[0] * columns + SPREAD[1] * rows) % 1.0, np.float32)
    return np.asarray(np.clip(np.floor(rgb / factor + threshold[..., None]), 0, 255).astype(np.uint8))


def _received(z: Floats, slopes: tuple[Floats, Floats], light: Floats, step: Pair) -> Floats:
    """sum_Q of the equation above over pi (3, h, w), from heights (h, w) mm, their slopes and the light there."""
    p, q = (slope.ravel() for slope in slopes)
    rows, columns = (at.ravel() * mm for at, mm in zip(np.indices(z.shape), step[::-1], strict=True))
    places, one = np.stack([columns, rows, z.ravel()]), np.ones(z.size)  # mm
    normals = np.stack([-p, -q, one])
    along, far = np.sum(normals * places, axis=0), np.sum(places**2, axis=0)
    total, every = np.zeros((len(light), z.size)), light.reshape(len(light), -1)
    steep = np.flatnonzero(np.hypot(p, q) > STEEP)
    for start in range(0, len(steep), CHUNK):
        own = steep[start : start + CHUNK]
        here = places[:, own].T @ normals - along
        there = normals[:, own].T @ places - along[own, None]
        square = far[own, None] - 2.0 * (places[:, own].T @ places) + far
        square[np.arange(len(own)), own] = np.inf
        kernel = np.maximum(here, 0.0) * np.maximum(there, 0.0)
        kernel /= square * square
        total += every[:, own] @ kernel
    return total.reshape(light.shape) * (step[0] * step[1] / np.pi)
