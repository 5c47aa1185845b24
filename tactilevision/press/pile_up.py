"""Measure pile-up and edge profile next to the punch, and the depth that the bevel certifies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.contact.bevel import EDGE_MM, SIDES, mean_distance_mm
from tactilevision.heightmap.deviation import gain_std
from tactilevision.mechanics.profile import touch_depth
from tactilevision.mechanics.tables.punch import profile_model
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.press.bevel_contact import ContactEvent
from tactilevision.press.contact_times import ContactTimes
from tactilevision.press.track import GRID_MM, PressTrack
from tactilevision.records.certified import EdgeDrop, EdgeProfile
from tactilevision.records.constants import NU_MAX, NU_SILICONE
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter

# Errors of the slopes that determine a depth, as stated by the photometric method's card.

UNKNOWN_GAIN = 0.1  # relative std of slopes where no card states it
MIN_GAIN = 0.01  # lower bound on the relative std of a ring's slopes; benchmarks.nu_from_frames
RING_SHARE = 0.25  # of the picture, and so of the balls, that a ring averages
BALL_SLOPE = 0.3  # mm/mm, a slope that most light calibrations hold


def ring_gain_std(method: object) -> float:
    """Return the relative std of slopes averaged over a ring: the scatter of as many balls as it averages."""
    card = _card(method)
    if card.balls is None:
        return UNKNOWN_GAIN
    single = _relative_error(method) if card.held_out_gain_std is None else card.held_out_gain_std
    return max(MIN_GAIN, single / float(np.sqrt(max(RING_SHARE * float(card.balls), 1.0))))


def ball_slope(method: object) -> float:
    """Return the steepest slope (mm/mm) with which the light was calibrated."""
    steepest = _card(method).steepest_slope
    return BALL_SLOPE if steepest is None else steepest


def shared_depth_std(track: PressTrack, method: object) -> float:
    """Return the common relative std of a face's reconstructed depth in all presses; NaN where no map states one.

    The height map's std includes the scale's scatter of a single ball. The common error is that of the mean scale
    over
    the calibration's balls.
    """
    face, height = track.footprint, track.face_map
    if face is None or height.std_mm is None:
        return float("nan")
    inside = face.mask & height.valid & (height.depth_mm > 0)
    if not inside.any():
        return float("nan")
    whole = float(np.median(height.std_mm[inside] / height.depth_mm[inside]))
    card = _card(method)
    single, balls = gain_std(card, 0.0), max(float(card.balls or 1), 1.0)
    rest = max(whole**2 - single**2, 0.0)
    return float(np.sqrt(rest + single**2 / balls))


def _card(method: object) -> MethodCard:
    return method.card if isinstance(method, CalibratedMethod) else MethodCard()


def _relative_error(method: object) -> float:
    return float(getattr(method, "relative_error", UNKNOWN_GAIN))


# The fall of the gel outside a face while the bevel touches, as the picture shows it: slopes, by place.
#
# Walls around a face are too steep to be read, the gel outside has slopes as gentle as those of the calibration's
# balls. Per quarter of directions and ring: the depth at its inner edge minus that at its outer one (mm), minus
# that of the free gel; from frames near the touch's depth, each scaled to it in proportion.

RINGS = 6  # between the nearest and the farthest distance
NEAREST_MM = 0.4  # mm outside the edge: nearer is the wall, its ink and the blur
NEAREST_PX = 4.0  # pixels outside the edge: nearer is the wall, its ink and the blur
NEAREST = 0.16  # of the radius, outside the edge, where the first ring begins
FARTHEST = 1.0  # of the radius, outside the edge, where the last ring ends
BEFORE_BEVEL_MM = 0.5  # mm before the bevel's edge that are excluded because of the bevel's dent
NEAR = 0.15  # of the event's depth: frames this near to it are read
FREE = 0.05  # of the event's depth: shallower frames show the free gel
MIN_RATIO = 2.0  # outer over inner edge: a smaller ratio is too narrow for rings


def edge_profile(
    track: PressTrack, touch: ContactEvent, *, bevel_distance_mm: float | None, method: object = None
) -> EdgeProfile | None:
    """Return drops by quarter and ring, with the slope data of `method`'s card; None where none is readable."""
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
    """Return the limits of the rings outside the face (RINGS + 1,), mm; None where the face is too small."""
    radius = track.indenter.radius_mm
    pixel = max(*track.face_map.mm_per_px, GRID_MM)
    first, last = max(NEAREST_MM, NEAREST_PX * pixel, NEAREST * radius), FARTHEST * radius
    if last < MIN_RATIO * first or track.r_mm.size < 2 or track.r_mm[-1] < radius + last:
        return None
    return np.asarray(np.geomspace(first, last, RINGS + 1))


def _levels(track: PressTrack, touch: ContactEvent) -> Floats | None:
    """Return depth (4, R) at the touch minus the free gel's; None where no frame is near it."""
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
    """Return the azimuths of the quarters of `Watch.rings`, degrees: towards the bevel, away, and across."""
    along = round(float(np.degrees(np.arctan2(SIDES[side][1], SIDES[side][0]))))
    return ((along + turn) % 360 for turn in (0, 180, 90, 270))


# The gel's rise where the bevel meets it, and the depth that the bevel then certifies.
#
#     touch:  w + u_z(r_bevel, w) = H        rho = u_z / w  (positive out of the gel)      w = H / (1 + rho)
#
# By the profile around a flat punch on a bonded layer, for the known range of the gel's Poisson ratio. Where the
# bevel's place is unknown, or the gel is not described, w = H with the corresponding deviation.
# Source: docs/explanation/physics.md, "The bevel touches early".

_SINKS = 1.4  # of the radius, within which the gel sinks in
_SUNK = 1.5  # of the height, the depth at touch where the gel sinks in
SILICONE_STD = (NU_SILICONE[1] - NU_SILICONE[0]) / math.sqrt(12)  # of their Poisson's ratios
_STATED_STD = 0.01  # of a Poisson's ratio stated without one
_UNKNOWN = (0.0, 0.13)  # the rise over the depth anywhere beyond 1.3 radii, for any such gel


@dataclass(frozen=True, slots=True)
class PileUp:
    """rho at the bevel's edge and its std."""

    ratio: float
    std: float


def unknown_pile_up() -> PileUp:
    """Return w = H for an unknown bevel place, with its deviation."""
    return PileUp(0.0, (_UNKNOWN[1] - _UNKNOWN[0]) / float(np.sqrt(3)))


def computed_pile_up(gel: Gel | None, indenter: Indenter, *, distance_mm: float) -> PileUp | None:
    """Return the rise by the layer's profile and the known Poisson's ratio."""
    if gel is None or indenter.height_mm is None or not distance_mm > indenter.radius_mm:
        return None
    nu, nu_std = gel.poisson_ratio, gel.poisson_ratio_std or _STATED_STD
    if nu is None:
        nu, nu_std = 0.5 * sum(NU_SILICONE), SILICONE_STD
    if not 0 < indenter.height_mm < 0.25 * gel.thickness_mm:
        return None
    nu, h = min(nu, NU_MAX), gel.thickness_mm
    # near a punch, where the gel sinks in, the depth at touch may exceed the height
    deepest = indenter.height_mm * (_SUNK if distance_mm < _SINKS * indenter.radius_mm else 1.0)
    model = profile_model(nu, indenter.radius_mm / h, deepest=deepest / h)
    touch = touch_depth(
        replace(indenter, bevel_distance_mm=distance_mm),
        thickness_mm=h,
        poisson_ratio=nu,
        poisson_ratio_std=nu_std,
        model=model,
    )
    return PileUp(touch.rise_over_depth, touch.rise_over_depth_std)


def pile_up_at_bevel(gel: Gel | None, indenter: Indenter, found_mm: float | None) -> PileUp | None:
    """Return the rise at a bevel of stated distance, else at `found_mm`: then known to about its window."""
    if indenter.bevel_distance_mm is not None:
        return computed_pile_up(gel, indenter, distance_mm=mean_distance_mm(indenter.bevel_distance_mm))
    if found_mm is None:
        return None
    near, pile_up, far = (
        computed_pile_up(gel, indenter, distance_mm=mean_distance_mm(found_mm) + off)
        for off in (-EDGE_MM, 0.0, EDGE_MM)
    )
    if near is None or pile_up is None or far is None:
        return pile_up
    return replace(pile_up, std=float(np.hypot(pile_up.std, 0.5 * (near.ratio - far.ratio))))


def depth_std(
    depth_mm: float,
    pile_up: PileUp,
    *,
    height_std_mm: float,
    scale_std: float | None = None,
    tilt_std_mm: float = 0.0,
) -> float:
    """Return the std (mm) of a certified depth from machined height, pile-up and tilt.

    On a travel scale its relative std `scale_std` replaces height and tilt.
    """
    from_pile_up = depth_mm * pile_up.std / (1 + pile_up.ratio)
    if scale_std is not None:
        return float(np.hypot(from_pile_up, depth_mm * scale_std))
    return float(np.linalg.norm([height_std_mm / (1 + pile_up.ratio), from_pile_up, tilt_std_mm]))


def press_pile_ups(events: Mapping[str, ContactTimes], gel: Gel | None) -> dict[str, PileUp]:
    """Return the pile-up at the bevel's edge of each press that was searched, by label."""
    return {
        name: pile_up_at_bevel(gel, one.bevel_contact.press_signal.track.indenter, one.bevel_contact.distance_mm)
        or unknown_pile_up()
        for name, one in events.items()
    }
