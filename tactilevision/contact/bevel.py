"""The gel along the line from the punch's axis to its bevel, and the signal that tells when the bevel touches.

A strip is the mean of a field over the width of that line, against the distance s from the axis: s > 0 on the
bevel's side, s < 0 on the mirrored one. The height map's signal is the dent along the bevel's edge, less the
same on the mirrored side: the rise beside the punch, the gain and a drifting light are alike on both and
cancel. The picture's signal is the change of its colours there, along the change that the touch itself makes.
Distances in mm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel_onset import Onset
from tactilevision.contact.edge import sample
from tactilevision.records import Floats, Pair

SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "bottom": (0.0, 1.0), "top": (0.0, -1.0)}
STEP_MM = 0.1  # mm between the places of a strip, about a pixel
HALF_WIDTH_MM = 1.5  # along a straight edge at twice the radius the gel rises alike within that
EDGE_MM = 0.15  # to both sides of the bevel's edge: the dent is some pixels wide while it is shallow
FLANK_MM = (0.6, 1.2)  # from the edge: near enough to share its long-waved noise, far enough to be off the dent
_WALL_MM = 0.4  # beyond the punch's edge, where its wall is still steep


def mean_distance_mm(distance_mm: float) -> float:
    """Distance from the axis, in the mean over the strip's width, of an edge `distance_mm` off at its nearest."""
    return float(np.hypot(distance_mm, HALF_WIDTH_MM / np.sqrt(3)))


def strip_places(reach_mm: float) -> Floats:
    """Distances s (n,) of a strip in mm, symmetric about the axis, out to `reach_mm`."""
    count = int(np.floor(reach_mm / STEP_MM))
    return np.linspace(-count, count, 2 * count + 1) * STEP_MM


def strip(field: npt.NDArray[Any], centre_px: Pair, *, px_per_mm: Pair, side: str, reach_mm: float) -> Floats:
    """Mean of `field` (H, W[, C]) over the strip's width at strip_places(reach_mm), (S[, C]); NaN out of view."""
    s, t = np.meshgrid(strip_places(reach_mm), np.arange(-HALF_WIDTH_MM, HALF_WIDTH_MM + 1e-9, STEP_MM))
    along, across = SIDES[side], (-SIDES[side][1], SIDES[side][0])
    x = centre_px[0] + (along[0] * s + across[0] * t) * px_per_mm[0]
    y = centre_px[1] + (along[1] * s + across[1] * t) * px_per_mm[1]
    values = sample(field, np.stack([x, y], axis=-1))
    seen = np.isfinite(values)
    enough = seen.mean(axis=0) > 0.5
    mean = np.where(seen, values, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return np.where(enough, mean, np.nan)


def height_signal(strips: Floats, s: Floats, *, distance_mm: float, radius_mm: float) -> Floats | None:
    """Depth (N,) at the bevel's edge less that of its surroundings, less the same on the mirrored side.

    The noise of a height map is long-waved (slopes are integrated), the dent of a touching edge is short: the
    surroundings take the one away and leave the other. None where the edge is out of view.
    """
    here = _dent(strips, s, distance_mm, radius_mm)
    if here is None:
        return None
    mirrored = _dent(strips, -s, distance_mm, radius_mm)
    return here if mirrored is None else here - mirrored


def _dent(strips: Floats, s: Floats, distance_mm: float, radius_mm: float) -> Floats | None:
    edge = _mean(strips, s, distance_mm - EDGE_MM, distance_mm + EDGE_MM)
    outer = _mean(strips, s, distance_mm + FLANK_MM[0], distance_mm + FLANK_MM[1])
    first = max(distance_mm - FLANK_MM[1], radius_mm + _WALL_MM)
    inner = _mean(strips, s, first, distance_mm - FLANK_MM[0])
    flanks = [flank for flank in (inner, outer) if flank is not None]
    if edge is None or not flanks:
        return None
    return np.asarray(edge - np.mean(flanks, axis=0), dtype=np.float64)


def _mean(strips: Floats, s: Floats, first: float, last: float) -> Floats | None:
    chosen = strips[:, (s >= first - 1e-6) & (s <= last + 1e-6)]
    if chosen.shape[1] == 0 or not np.isfinite(chosen).all():
        return None
    return np.asarray(chosen.mean(axis=1), dtype=np.float64)


def picture_signal(
    colours: Floats, s: Floats, *, depth_mm: Floats, distance_mm: float, onset: Onset
) -> Floats | None:
    """Change of the colours (N, S, 3) beside the bevel's edge, along the change that follows a first onset.

    Each colour and place is freed of its smooth course in depth; what it does after the onset is the template,
    weighed by its own noise. In units of the template: it grows with the depth beyond the touch. None
    where the touch does not show in the colours.
    """
    near = np.asarray(np.abs(s - distance_mm) <= FLANK_MM[1])
    traces = colours[:, near].reshape(len(colours), -1)
    traces = traces[:, np.isfinite(traces).all(axis=0)]
    after = onset.growth(depth_mm - onset.at)
    basis = np.c_[np.ones_like(depth_mm), depth_mm, depth_mm**2, after]
    if traces.shape[1] == 0 or (after > 0).sum() < 3 or np.linalg.matrix_rank(basis) < 4:
        return None
    coefficients, *_ = np.linalg.lstsq(basis, traces, rcond=None)
    noise = (traces - basis @ coefficients).std(axis=0) + 1e-9
    template = coefficients[3]
    strength = (template / noise) ** 2
    if not strength.sum() > 0:
        return None
    free = traces - basis[:, :3] @ coefficients[:3]
    return np.asarray((free * template / noise**2).sum(axis=1) / strength.sum(), dtype=np.float64)
