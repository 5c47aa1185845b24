"""How far the gel falls away beside a face while the bevel touches, as the picture reads it: slopes, by place.

A face is reached over walls too steep to be read, the gel beside it over slopes as gentle as those of the balls
that the light was made from. Per quarter of directions and ring: the depth at its inner edge less that at its
outer one (mm), less what the free gel shows there; from frames of about the touch's depth, each carried to it in
proportion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactilevision.certificate.depth.slope_gain import ball_slope, ring_gain_std
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.certificate.touch.press_track import GRID_MM, PressTrack
from tactilevision.contact.bevel import SIDES
from tactilevision.records import EdgeDrop, EdgeProfile, Floats

RINGS = 4  # between the nearest and the farthest distance
NEAREST_MM = 0.4  # mm beside the edge: nearer is the wall, its ink and the blur
NEAREST_PX = 4.0  # pixels beside the edge: nearer is the wall, its ink and the blur
NEAREST = 0.16  # of the radius, beside the edge, where the first ring begins
FARTHEST = 0.5  # of the radius, beside the edge, where the last ring ends
BEFORE_BEVEL_MM = 0.5  # mm before the bevel's edge that are left out, lest the bevel's dent be read
NEAR = 0.15  # of the event's depth: frames this near to it are read
FREE = 0.05  # of the event's depth: shallower frames show the free gel
MIN_RATIO = 2.0  # outer over inner edge: fewer leave no rings to part


def edge_profile(
    track: PressTrack, touch: ContactEvent, *, bevel_distance_mm: float | None, method: object = None
) -> EdgeProfile | None:
    """Drops by quarter and ring, with what the photometric `method` states of slopes; None where none is seen."""
    edges, levels = ring_edges(track), _levels(track, touch)
    if edges is None or levels is None:
        return None
    radius = track.indenter.radius_mm
    at_edges = [np.interp(radius + edges, track.r_mm, level) for level in levels]
    drops = []
    for azimuth, towards, level in zip(_azimuths(track.side), (True, False, False, False), at_edges, strict=True):
        for k in range(RINGS):
            fall, reach = level[k] - level[k + 1], radius + edges[k + 1] + BEFORE_BEVEL_MM
            if np.isfinite(fall) and not (towards and bevel_distance_mm is not None and reach > bevel_distance_mm):
                place = (round(float(edges[k]), 2), round(float(edges[k + 1]), 2))
                drops.append(EdgeDrop(float(azimuth), *place, float(fall)))
    return EdgeProfile(tuple(drops), ring_gain_std(method), ball_slope(method)) if drops else None


def ring_edges(track: PressTrack) -> Floats | None:
    """Where rings begin and end beside the face (RINGS + 1,), mm; None where the face is too small to have any."""
    radius = track.indenter.radius_mm
    pixel = max(*track.face_map.mm_per_px, GRID_MM)
    first, last = max(NEAREST_MM, NEAREST_PX * pixel, NEAREST * radius), FARTHEST * radius
    if last < MIN_RATIO * first or track.r_mm.size < 2 or track.r_mm[-1] < radius + last:
        return None
    return np.asarray(np.geomspace(first, last, RINGS + 1))


def _levels(track: PressTrack, touch: ContactEvent) -> Floats | None:
    """Depth (4, R) at the touch less the free gel's; None where no frame is near it."""
    seen, depth = touch.depth_seen_mm, track.depth_mm
    top = track.time_s[track.deepest]
    near = (np.abs(depth / seen - 1) < NEAR) & (track.time_s <= top) if seen > 0 else np.zeros(depth.size, bool)
    if not near.any():
        return None
    free = (np.abs(depth) < FREE * seen) & (track.time_s < touch.time_s)
    rest = track.rings[free].mean(axis=0) if free.any() else 0.0
    carried = (track.rings[near] - rest) * (seen / depth[near])[:, None, None]
    return np.asarray(carried.mean(axis=0))


def _azimuths(side: str) -> Iterator[int]:
    """Of the quarters of `Watch.rings`, degrees: towards the bevel, away from it, and across."""
    along = round(float(np.degrees(np.arctan2(SIDES[side][1], SIDES[side][0]))))
    return ((along + turn) % 360 for turn in (0, 180, 90, 270))
