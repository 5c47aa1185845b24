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
_CLEAR = (
    2.0  # stds before a first onset, up to where the picture is taken to be untouched; tests/contact/test_onset
)
_LATE = 0.3  # of the growth seen, from which the picture's change is the template
_MIN_FRAMES = 3  # before the onset, from which a straight course is taken
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

    Of each colour and place the course before the onset, straight in depth, is taken away; what is left long after
    it is the template. So a first onset some deviations off leaves the template as it is. Colours weigh by their
    noise; places do not, since those where a late onset fits best would weigh most. In units of the template: it
    grows with the depth beyond the touch. None where the touch does not show in the colours.
    """
    near = np.asarray(np.abs(s - distance_mm) <= FLANK_MM[1])
    traces = colours[:, near].reshape(len(colours), -1).astype(np.float64)
    seen = np.isfinite(traces).all(axis=0)
    grown = onset.growth(depth_mm - onset.at)
    before, late = depth_mm < onset.at - _CLEAR * onset.std, grown > _LATE * grown.max()
    if before.sum() < _MIN_FRAMES:
        before = depth_mm < onset.at
    if not seen.any() or before.sum() < _MIN_FRAMES or not grown.any():
        return None
    course = np.c_[np.ones_like(depth_mm), depth_mm]
    coefficients, *_ = np.linalg.lstsq(course[before], traces[np.ix_(before, seen)], rcond=None)
    change = np.zeros_like(traces)
    change[:, seen] = traces[:, seen] - course @ coefficients
    template = grown[late] @ change[late] / (grown[late] @ grown[late])
    scatter = change[before].reshape(int(before.sum()), -1, colours.shape[-1])
    noise = np.sqrt((scatter**2).mean(axis=(0, 1))) + 1e-9
    weights = template / np.resize(noise, template.size) ** 2
    strength = float(weights @ template)
    return np.asarray(change @ weights / strength, dtype=np.float64) if strength > 0 else None
