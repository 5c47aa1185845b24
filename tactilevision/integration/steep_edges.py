"""Walls too steep to read: what a flat punch's edge hides of the depth, out of the gel beside it.

Beside the edge of a rigid flat face the gel's surface falls away as wall_law.py says. For two or three pixels it
is steeper than any ball showed, colours saturate, and a quarter of a deep face's height hides there. Slopes
farther out, and those at the foot of the blurred wall inside, are gentle and well read. They fix the law's
unknowns, and the law carries the depth through. On a path tracer's faces of .3 to .6 mm (light passing through the
punch) this brought depths from .77-.98 of the truth to .86-1.04.

What no slope farther out tells is the edge itself: finite strain makes the wall steeper there than the law of
small slopes. By finite elements, shown in the same light, the law carries less than the face's depth w by

    D = EDGE_FALL (w^2/a) sqrt(px/a)        px: mm of a pixel

which is added at the edge: 1.4 for EDGE_FALL where the surface follows the punch's edge, .3 where ink rounds it
over .03 mm. The value here lies between; the deviation holds both (benchmarks/steep_edges.py: neo-Hooke, nu .40 to
.499, a/h .5 to 1, w/h to .2, friction .15 to .6, edges of h/60 to h/30, pixels of .045 to .095 mm). A camera blurs
even a steep wall where it is narrow. So walls are told from half the limit up where nothing of them is steeper and
cast shadows are undone: faces of 3 to 8 % of the thickness else lose 3 to 9 % of their depth.

A cast shadow beside the wall looks like slope, and a law through it may double a face's depth. It bends otherwise
than the law, so walls that the slopes outside do not keep to are left as they are: faces of .3 to .55 mm beside
shadows then read .96 to 1.00 of their depth, where the law made 1.3 to 2.5 of it. Since walls are read too gentle,
a law that makes less of a wall than was read is raised to what was read.

Only round rims with a sharp inner flank are treated so: the slopes of balls, cones and ridges grow gently and are
left alone. Assumes a flat face, at least a third of whose rim is in the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.compiled import compiled
from tactilevision.integration.circular_edges import CircularEdge, find_circular_edges, window_of
from tactilevision.integration.punch_edge import PunchEdge, WallLaw
from tactilevision.integration.wall_law import Law, wall_light
from tactilevision.photometric.illumination.colour_change import Planes
from tactilevision.photometric.windows import Window
from tactilevision.records import Bools, Floats, Pair, SlopeMap

FOOT_PX = 6.0  # px inside the edge from which slopes are read
FAR = (
    0.4  # of the radius outside the edge, to which slopes are read; farther where a wall hides more than its half
)
HIDDEN_SHARE = 0.5  # of that, which a wall may hide: what lies behind more is no longer told by the rest
SLOPE_ERROR = 0.03  # of the mean slope round the edge: its relative deviation
SLOPE_FLOOR = 0.01  # mm/mm: deviation of the mean slope round the edge where it is gentle
# mean square, in stated deviations, that slopes outside may lie off the law, and where the wall hides more than
# half of FAR: punches' own .0 to .2, a path tracer's .35 after shadows were undone; beside shadows .4 to 2
MAX_MISFIT = (0.45, 0.3)
EDGE_FALL = 0.8  # of what the edge adds: benchmarks/steep_edges.py
EDGE_FALL_STD = 1.0  # of it: what ink, frictions and edges differ by
MIN_READ = 8  # bins outside the edge that can be read; with fewer it is not fitted
MIN_FACE = 50  # pixels of a face; with fewer it counts as not known


def find_punch_edges(slopes: SlopeMap, mm_per_px: Pair, *, law: WallLaw) -> list[PunchEdge]:
    """The walls round flat faces in `slopes` (H, W)."""
    edges = [
        fit_edge(circle, law, px=min(mm_per_px))
        for circle in find_circular_edges(slopes, mm_per_px, limit=law.limit, gentlest=law.gentlest)
    ]
    return [edge if law.taught is None else edge.taught_by(law.taught) for edge in edges if edge is not None]


def restore(slopes: SlopeMap, edges: list[PunchEdge], *, mm_per_px: Pair) -> None:
    """Put the law's slopes in place of those (H, W) that the walls hide, in place.

    Along the rim nothing slopes but what the face's own tilt t, gentle and well read, makes of a rigid face:
    slope = -u'(s) (1 + t.x/w) r/|r| + t (1 - u/w).
    """
    half = 0.5 * min(mm_per_px)
    for edge in edges:
        outer, inner = edge.radius_mm + edge.reach_mm, edge.radius_mm + edge.places_mm[0]
        window, x, y = window_of(slopes.dz_dx.shape, edge.centre_mm, mm_per_px=mm_per_px, outer_mm=outer)
        step, lines = edge.places_mm[1] - edge.places_mm[0], _lines(edge, half)
        if compiled() and _writable(slopes.dz_dx) and _writable(slopes.dz_dy):
            from tactilevision.integration.wall_kernels import put

            at = window[0].start, window[1].start, x[0], y[:, 0], max(inner - 2 * half, 0.0), inner, outer
            put(slopes.dz_dx, slopes.dz_dy, *at, MIN_FACE, step, edge.depth_mm, *lines)
            continue
        square = (x * x).astype(np.float32) + (y * y).astype(np.float32)
        p, q = slopes.dz_dx[window], slopes.dz_dy[window]
        face = (square < max(inner - 2 * half, 0.0) ** 2).view(np.uint8)
        known = cv2.countNonZero(face) >= MIN_FACE
        tilt = (cv2.mean(p, face)[0], cv2.mean(q, face)[0]) if known else (0.0, 0.0)
        band = (square >= inner * inner) & (square < outer * outer)
        rows, columns = np.divmod(np.flatnonzero(band).astype(np.int32), np.int32(band.shape[1]))
        x, y, r = x.ravel().take(columns), y.ravel().take(rows), np.sqrt(square[band])
        steep, remaining = _interpolated(lines, (r - inner) / step)
        steep *= (1.0 + (tilt[0] * x + tilt[1] * y) / edge.depth_mm) / r
        p[band] = steep * x + tilt[0] * remaining
        q[band] = steep * y + tilt[1] * remaining


def _lines(edge: PunchEdge, half: float) -> tuple[Floats, Floats]:
    """Mean slope u' within `half` of the wall's places (n,), and 1 - u/w there."""
    below, above = (np.interp(edge.places_mm + d, edge.places_mm, edge.fall_mm) for d in (half, -half))
    return (above - below) / (2 * half), 1.0 - 0.5 * (above + below) / edge.depth_mm


def _interpolated(lines: tuple[Floats, Floats], at: Floats) -> tuple[Floats, Floats]:
    """What two lines (n,) say at `at` (m,), counted in their steps."""
    i = at.astype(np.int32)
    at -= i
    np.minimum(i, len(lines[0]) - 2, out=i)
    steep, remaining = (line.take(i) + at * np.diff(line).take(i) for line in lines)
    return steep, remaining


def _writable(plane: npt.NDArray[Any]) -> bool:
    """Whether kernels may write to a plane (H, W) as it lies."""
    return plane.dtype == np.float32 and plane.flags.c_contiguous and plane.flags.writeable


def restore_windows(
    fine: Sequence[Planes],
    windows: Sequence[Window],
    *,
    valid: Bools,
    mm_per_px: Pair,
    law: WallLaw,
) -> list[PunchEdge]:
    """The walls found and restored, in place, in slopes (2, rows, columns) for each window of a picture."""
    edges = []
    for window, (p, q) in zip(windows, fine, strict=True):
        slopes = SlopeMap(p, q, valid[window])
        restored = find_punch_edges(slopes, mm_per_px, law=law)
        restore(slopes, restored, mm_per_px=mm_per_px)
        top, left = (side.start * step for side, step in zip(window, mm_per_px[::-1], strict=True))
        edges += [
            replace(edge, centre_mm=(edge.centre_mm[0] + left, edge.centre_mm[1] + top)) for edge in restored
        ]
    return edges


def fit_edge(edge: CircularEdge, walls: WallLaw, *, px: float) -> PunchEdge | None:
    """The law through the gentle slopes beside a wall; None where too few of them are seen."""
    mean, s = edge.slopes, edge.places_mm - edge.radius_mm
    known = np.isfinite(mean)
    reaches_limit = edge.highest[known].max(initial=0.0) >= walls.limit
    steep = known & ~(edge.highest < (walls.limit if reaches_limit else walls.gentlest))
    if not steep.any():
        return None
    hidden, usual = float(s[steep].max()), max(FAR * edge.radius_mm, 8 * px)
    far = max(usual, min(hidden / HIDDEN_SHARE, float(s[-1])))
    use = known & ~steep & (s > -FOOT_PX * px) & (s < far)
    if hidden > HIDDEN_SHARE * far or np.count_nonzero(use & (s > 0)) < MIN_READ:
        return None
    std = np.sqrt(SLOPE_FLOOR**2 + (SLOPE_ERROR * mean) ** 2 + edge.std**2)[use]
    law = Law(edge.radius_mm, px, far, wall_light(round(walls.lean, 2)), s[use])
    unknown, covariance, off = law.fitted(mean[use], std)
    if walls.strict and float(np.mean(np.square(off[s[use] > 0]))) > MAX_MISFIT[int(far > usual)]:
        return None
    shift, reach = float(unknown[0]), hidden + px
    falls, fall, rate = law.falls(unknown, reach - shift)
    with_edge = rate @ covariance[:, 0] / covariance[0, 0]  # all else following the edge
    inner = -3.0 * float(np.hypot(*np.exp(unknown[1:3])))
    steps = np.where(known & (s > inner + shift), mean, 0.0) * (s[1] - s[0])  # mm
    within = np.clip((reach - s) / (s[1] - s[0]) + 0.5, 0.0, 1.0)  # a bin across the reach counts by its part
    read, beyond = float(steps @ within), float(steps @ (1.0 - within))
    added = EDGE_FALL * max(fall + beyond, 0.0) ** 2 * px**0.5 / edge.radius_mm**1.5
    falls, fall = falls + added * law.step_at_edge(unknown), fall + added
    if 0.0 < fall < read:  # slopes of walls are read too gentle: a law that takes depth away saw a shadow as gel
        falls, fall = falls * (read / fall), read
    elif fall <= 0.0 < read:
        return None
    table = slice(*np.searchsorted(law.edges, (inner, reach - shift + 2 * px)))
    if len(law.edges[table]) < 2 or not edge.radius_mm + shift > 0:  # the edge ran off the wall: no law of it
        return None
    own = float(np.sqrt(rate @ covariance @ rate + (with_edge * edge.uneven_mm) ** 2))
    return PunchEdge(edge.centre_mm, edge.radius_mm + shift, reach - shift, law.edges[table], falls[table],
                fall + beyond, fall - read, float(np.hypot(own, EDGE_FALL_STD * added)))  # fmt: skip
