"""Do lamps cast shadows beside the punch? The fall of the gel over the depth tells, without knowing any lamp.

    f = (z at .5 to .9 mm beyond the edge - z at 1.3 to 1.8 mm) / depth

is nearly one number for all depths: finite elements and pictures without shadows have it grow by an eighth from
.14 to .56 mm. The wall of a pressed face throws the shadow of low lamps onto just that gel, the farther the deeper
it stands; slopes read there are too steep, and f grows by a half and more. A line through f against depth, with
the scatter of the presses about it, decides.

What it does to Poisson's ratio when nothing is done: too low by .02 to .04, and Young's modulus 5 to 20 % too high
(renderings of others and a path tracer's). Read from the places alone that all lamps reach, without the light that
the wall sends there, nu was .0025 off (rms) on seven sets of the path tracer, up to .0062 in single frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.records import Floats

FLAG = "cast_shadow"
NEAR_MM = (0.5, 0.9)  # mm beyond the edge, where walls and their blur end
FAR_MM = (1.3, 1.8)  # mm beyond the edge, where shadows of gentle presses end
MIN_GROWTH = 0.25  # of f from the gentlest press to the deepest: twice what depth itself does to it
MIN_SIGMA = 4.0  # deviations of the growth, by the scatter of the presses
MIN_PRESSES = 4  # fewer tell no scatter
MIN_SPAN = 1.5  # deepest over gentlest: less shows no growth
MIN_COUNT = 20  # squares of gel in either ring
LIT_NU_STD = 0.003  # of nu, read where all lamps reach: .0025 rms on sets of `train`; docs/evidence/rendered.md
NU_STD = 0.03  # of nu, where shadows are seen and cannot be left out; by the renderings above


def fall_growth(views: Sequence[SurfaceView]) -> tuple[float, float]:
    """By what part of itself f grows from the gentlest press to the deepest, and its standard deviation.

    NaN where too few presses show it. Depths (h, w) of the views in mm.
    """
    pairs = [(view.certified_depth_mm, _fall_mm(view) / view.certified_depth_mm) for view in views]
    depth, fall = np.array([pair for pair in pairs if np.isfinite(pair).all()]).reshape(-1, 2).T
    if len(depth) < MIN_PRESSES or depth.max() < MIN_SPAN * depth.min():
        return np.nan, np.nan
    design = np.stack([np.ones_like(depth), depth - depth.min()], axis=1)
    (start, slope), *_ = np.linalg.lstsq(design, fall, rcond=None)
    scatter = np.sum((fall - design @ (start, slope)) ** 2) / (len(depth) - 2)
    span = float(np.ptp(depth))
    std = span * float(np.sqrt(scatter * np.linalg.inv(design.T @ design)[1, 1]))
    return span * float(slope) / abs(float(start)), std / abs(float(start))


def shows_shadow(growth: float, std: float) -> bool:
    """Whether a growth of f, and its deviation, are more than depth itself and the presses' scatter make."""
    return bool(growth > MIN_GROWTH and growth > MIN_SIGMA * std)


def _fall_mm(view: SurfaceView) -> float:
    rows, columns = view.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * view.mm_per_px[0] - view.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * view.mm_per_px[1] - view.centre_mm[1]
    beyond = np.hypot(x[None, :], y[:, None]) - view.radius_mm
    near, far = (_ring(view, beyond, limits) for limits in (NEAR_MM, FAR_MM))
    return near - far


def _ring(view: SurfaceView, beyond: Floats, limits: tuple[float, float]) -> float:
    inside = view.valid & (beyond > limits[0]) & (beyond < limits[1])
    return float(view.depth_mm[inside].mean()) if np.count_nonzero(inside) >= MIN_COUNT else np.nan
