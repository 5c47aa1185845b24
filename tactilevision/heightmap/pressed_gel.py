"""The theoretical gel surface outside a round flat face.

What is read in shadow is too deep beside a face, and a forecast from such a surface ends too early. Round each
flat face whose wall was found (heightmap/walls.py), or at least its rim (circular_edges.py), the surface
is, w the face's depth and t its tilt,

    z = (w + t.x min(1, a/r)) m(r)     m = 1 for r < a,  m_1 + beta (m_2 - m_1) beside it

m_1, m_2: depth over w in a layer of two Poisson's ratios (mechanics/profile.py), the share beta by least squares
from the map itself where all lamps reach. Where the map is another surface (a bevel's dent, a hole in the face, a
neighbour) it stays as it is. No depth is taken from theory: it only tells which places lie in shadow.
Assumes a layer of the stated thickness, of USUAL_THICKNESS_MM where none is.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.circular_edges import CircularEdge
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.records.measured import Bools, Floats, Pair

Depth = npt.NDArray[np.floating]

POISSON = (0.42, 0.49)  # of the two profiles; elastomers lie between .4 and .5
SHARES = (-0.3, 1.14)  # of the way from one to the other: nu of .40 to .4999
USUAL_SHARE = 0.6  # of that way, where too little of the gel is lit to tell
FACE = 0.75  # of the radius, within which the face's plane is read: beyond, walls are blurred
LIT_MM = (0.4, 2.5)  # mm beyond the edge, between which the map tells beta
HANDED_OVER_MM = (2.0, 3.5)  # mm beyond the edge, between which the map takes over: there shadows end
ALIKE = (0.15, 0.3)  # of the face's depth that the map may lie off the law, wholly and at all: shadows make .27
# the same beside a rim whose wall could not be fitted, since shadows reach too far: they make .45 there
ALIKE_UNFITTED = (0.5, 0.7)
MIN_COUNT = 200  # pixels of gel that tell beta, and pixels of a face: fewer tell neither
MIN_FACE_MM = 0.08  # mm: gentler faces cast no shadow that matters
ROUNDED = 0.005  # of a/h: cases so near share a profile, which changes by less than .001 w


def with_faces(
    depth_mm: Depth,
    edges: Sequence[PunchEdge | CircularEdge],
    *,
    lit: Bools | None,
    mm_per_px: Pair,
    thickness_mm: float,
) -> Depth:
    """A depth map (H, W) in mm with the surface of theory round the faces of `edges`; itself where there are none.

    `lit` (H, W): where all lamps reach, None where it is not known yet.
    """
    for edge in edges:
        if A_OVER_H_RANGE[0] < edge.radius_mm / thickness_mm < A_OVER_H_RANGE[1]:
            depth_mm = _with_face(depth_mm, edge, lit=lit, mm_per_px=mm_per_px, thickness_mm=thickness_mm)
    return depth_mm


def _with_face(
    depth: Depth, edge: PunchEdge | CircularEdge, *, lit: Bools | None, mm_per_px: Pair, thickness_mm: float
) -> Depth:
    a, reach = edge.radius_mm, edge.radius_mm + HANDED_OVER_MM[1]
    x, y = (np.arange(n) * mm - at for n, mm, at in zip(depth.shape[::-1], mm_per_px, edge.centre_mm, strict=True))
    box = (_within(y, reach), _within(x, reach))
    whole, depth, lit = depth, depth[box], None if lit is None else lit[box]
    x, y = x[None, box[1]], y[box[0], None]
    r = np.hypot(x, y)
    beyond, face = r - a, r < FACE * a
    if np.count_nonzero(face) < MIN_COUNT:
        return whole
    terms = np.stack([np.ones_like(r), x + 0.0 * y, y + 0.0 * x])
    (w, *tilt), *_ = np.linalg.lstsq(terms[:, face].T, depth[face], rcond=None)
    if w < MIN_FACE_MM:
        return whole
    plane = w + (tilt[0] * x + tilt[1] * y) * np.minimum(1.0, a / np.maximum(r, FACE * a))
    low, high = (
        plane * np.interp(r / a, *_profile(nu, round(a / thickness_mm / ROUNDED) * ROUNDED)) for nu in POISSON
    )
    told = (beyond > LIT_MM[0]) & (beyond < LIT_MM[1]) & (False if lit is None else lit)
    share = USUAL_SHARE
    if np.count_nonzero(told) >= MIN_COUNT:
        between = (high - low)[told]
        share = float(np.clip(between @ (depth - low)[told] / (between @ between), *SHARES))
    surface = low + share * (high - low)
    off = np.abs(depth - surface) / w
    weight = _falling(beyond, *HANDED_OVER_MM) * _falling(
        off, *(ALIKE if isinstance(edge, PunchEdge) else ALIKE_UNFITTED)
    )
    found = whole.copy()
    found[box] = depth + weight * (surface - depth)
    return found


def _within(places: Floats, reach: float) -> slice:
    """Where rising places (n,) lie no farther than `reach` from 0."""
    return slice(*np.searchsorted(places, (-reach, reach)).tolist())


def _falling(value: Floats, start: float, end: float) -> Floats:
    """1 up to `start`, 0 from `end` on, linear in between."""
    return np.clip((end - value) / (end - start), 0.0, 1.0)


@lru_cache(maxsize=64)
def _profile(poisson_ratio: float, a_over_h: float) -> tuple[Floats, Floats]:
    """Radii over a (n,), and depth over w there (n,)."""
    radii = 1.0 + np.linspace(0.0, 1.0, 200) ** 2 * 4.0 / a_over_h
    return radii, -seen_profile(radii, PunchCase(poisson_ratio, a_over_h))
