"""Measure pile-up and edge profile next to the punch, and the depth that the bevel certifies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.contact.bevel import EDGE_MM, SIDES, mean_distance_mm
from tactilevision.heightmap.deviation_terms import gain_std
from tactilevision.mechanics.tables.punch import profile_model
from tactilevision.mechanics.touch import touch_depth
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.method import as_referenced
from tactilevision.press.bevel_contact import DETECTION_CHI2, ContactEvent
from tactilevision.press.contact_times import ContactTimes
from tactilevision.press.track import GRID_MM, PressTrack
from tactilevision.records.certified import EdgeDrop, EdgeProfile
from tactilevision.records.measured import Bools, Floats, Pair
from tactilevision.records.rig import Gel, Indenter

# What the slopes behind a depth may be off by, as the photometric method's card states it.

UNKNOWN_GAIN = 0.1  # relative std of slopes where no card states it
MIN_GAIN = 0.01  # relative std that no ring of slopes undercuts; benchmarks.nu_from_frames
RING_SHARE = 0.25  # of the picture, and so of the balls, that a ring averages
BALL_SLOPE = 0.3  # mm/mm, a slope that most light calibrations hold


def ring_gain_std(method: object) -> float:
    """Relative std of slopes averaged over a ring: the balls' scatter over the balls that such a ring averages."""
    card = _card(method)
    if card.balls is None:
        return UNKNOWN_GAIN
    single = _relative_error(method) if card.held_out_gain_std is None else card.held_out_gain_std
    return max(MIN_GAIN, single / float(np.sqrt(max(RING_SHARE * float(card.balls), 1.0))))


def ball_slope(method: object) -> float:
    """Steepest slope (mm/mm) that the light was calibrated with."""
    steepest = _card(method).steepest_slope
    return BALL_SLOPE if steepest is None else steepest


def shared_depth_std(track: PressTrack, method: object) -> float:
    """Relative std of a face's reconstructed depth that all presses share; NaN where no map states one.

    The height map's std counts the scale of a single ball as unsure. What all presses share is the scale's mean
    over the balls that it was made from.
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
    referenced = as_referenced(method)
    return MethodCard() if referenced is None else referenced.card


def _relative_error(method: object) -> float:
    return float(getattr(method, "relative_error", UNKNOWN_GAIN))


# How far the gel falls away beside a face while the bevel touches, as the picture reads it: slopes, by place.
#
# A face is reached over walls too steep to be read, the gel beside it over slopes as gentle as those of the balls
# that the light was made from. Per quarter of directions and ring: the depth at its inner edge less that at its
# outer one (mm), less what the free gel shows there; from frames of about the touch's depth, each carried to it in
# proportion.

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


# How far the gel rises where the bevel meets it, and the depth that the bevel then certifies.
#
#     touch:  w + u_z(r_bevel, w) = H        rho = u_z / w  (positive out of the gel)      w = H / (1 + rho)
#
# Seen: rho is the slope of the rise against the depth of the face over the frames before the touch. The rise comes
# from the height map, the depth from the force, in the scale that the bevels certify. A slope is free of the zero
# plane. Without tilt the rise is the same all round, so the mean over a ring is taken. Its uncertainty holds the
# scatter of the ring's quarters, the error of the map's depth scale on the faces, and the map's own error at the
# ring. Computed: the profile beside a flat punch on a bonded layer, for what is known of the gel's Poisson ratio.
#
# The two are checked against each other and combined by their variances. Where the bevel's place is neither given
# nor seen, w = H is kept with what that may be wrong. Source:
# docs/explanation/physics.md, "The bevel touches early".

_HALF_RING_MM = 0.3  # mm, half the width of the ring in which the rise is read; benchmarks.certificate
_SOFT_GEL = (0.45, 0.4999)  # Poisson's ratio of silicones and the like, where nothing is said of the gel
_SINKS = 1.4  # of the radius, within which the gel sinks in
_SUNK = 1.5  # of the height, the depth at touch where the gel sinks in
_STATED_STD = 0.01  # of a Poisson's ratio stated without one
_UNKNOWN = (0.0, 0.13)  # the rise over the depth anywhere beyond 1.3 radii, for any such gel


@dataclass(frozen=True, slots=True)
class PileUp:
    """rho at the bevel's edge and its std, and what it rests on: seen and computed (ratio, std), None if not
    known.
    """

    ratio: float
    std: float
    seen: tuple[float, float] | None = None
    computed: tuple[float, float] | None = None

    @property
    def disagreement(self) -> float:
        """Sigmas between what is seen and what is computed."""
        if self.seen is None or self.computed is None:
            return 0.0
        return abs(self.seen[0] - self.computed[0]) / float(np.hypot(self.seen[1], self.computed[1]))


def unknown_pile_up() -> PileUp:
    """Nothing is known of the bevel's place: w = H, and how far that may be off."""
    return PileUp(0.0, (_UNKNOWN[1] - _UNKNOWN[0]) / float(np.sqrt(3)))


def press_pile_up(
    track: PressTrack, depth_mm: Floats, *, before: Bools, distance_mm: float
) -> tuple[Floats, Floats] | None:
    """rho (4,) of the quarters of the ring and its std, from one press; `depth_mm` (N,), `before` the touch
    (N,).
    """
    ring = np.abs(track.r_mm - distance_mm) <= _HALF_RING_MM
    use = before & np.isfinite(depth_mm)
    if use.sum() < 4 or not ring.any() or np.ptp(depth_mm[use]) <= 0:
        return None
    depth = depth_mm[use]
    level = track.rings[use][:, :, ring].mean(axis=2)
    unseen = ~np.isfinite(level).all(axis=0)
    level = np.where(np.isfinite(level), level, 0.0)
    design = np.c_[np.ones_like(depth), depth]
    answer, *_ = np.linalg.lstsq(design, level, rcond=None)
    spread = (level - design @ answer).std(axis=0) / np.sqrt(((depth - depth.mean()) ** 2).sum())
    return np.where(unseen, np.nan, -answer[1]), np.where(unseen, np.nan, spread)


def map_error(track: PressTrack, depth_mm: Floats, *, distance_mm: float) -> float:
    """What the deepest height map may be off by all round the ring, over the depth `depth_mm` (N,) there; NaN
    where the map does not say.

    A colour law that misreads gentle slopes does so all round and in every press: no scatter shows it.
    """
    height, face, deepest = track.face_map, track.footprint, float(depth_mm[track.deepest])
    if height.std_mm is None or face is None or not deepest > 0:
        return float("nan")
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0] - face.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * height.mm_per_px[1] - face.centre_mm[1]
    ring = np.abs(np.hypot(x[None, :], y[:, None]) - distance_mm) <= _HALF_RING_MM
    std = np.asarray(height.std_mm, dtype=np.float64)[ring & height.valid]
    std = std[np.isfinite(std)]
    return float(std.mean()) / deepest if std.size else float("nan")


def seen_ratio(
    found: Sequence[tuple[Floats, Floats]], *, scale_std: float, map_std: float = 0.0
) -> tuple[float, float] | None:
    """One rho and its std from ratios (4,) and stds (4,) of many presses.

    `scale_std` is the relative uncertainty of the height map's scale, `map_std` what its rise may be off by over
    the depth.
    """
    if not found:
        return None
    ratios, stds = np.array([f[0] for f in found]), np.array([f[1] for f in found])
    weights = np.where(np.isfinite(ratios), 1 / np.maximum(stds, 1e-4) ** 2, 0.0)
    total = weights.sum(axis=0)
    seen = total > 0
    if seen.sum() < 2:
        return None
    quarters = (np.where(np.isfinite(ratios), ratios, 0.0) * weights).sum(axis=0)[seen] / total[seen]
    value = float(quarters.mean())
    # the quarters err by what the method has wrong in each direction, which more presses do not mend
    spread = float(quarters.std(ddof=1) / np.sqrt(seen.sum()))
    return value, float(np.sqrt(spread**2 + 1 / total[seen].sum() + (scale_std * value) ** 2 + map_std**2))


def computed_ratio(gel: Gel | None, indenter: Indenter, *, distance_mm: float) -> tuple[float, float] | None:
    """rho and its std from the layer's profile and what is known of Poisson's ratio."""
    if gel is None or indenter.height_mm is None or not distance_mm > indenter.radius_mm:
        return None
    nu, nu_std = gel.poisson_ratio, gel.poisson_ratio_std or _STATED_STD
    if nu is None:
        nu, nu_std = 0.5 * sum(_SOFT_GEL), (_SOFT_GEL[1] - _SOFT_GEL[0]) / float(np.sqrt(12))
    if not 0 < indenter.height_mm < 0.25 * gel.thickness_mm:
        return None
    nu, h = min(nu, 0.4999), gel.thickness_mm
    # near a punch, which the gel sinks in with, the depth at touch may exceed the height
    deepest = indenter.height_mm * (_SUNK if distance_mm < _SINKS * indenter.radius_mm else 1.0)
    model = profile_model(nu, indenter.radius_mm / h, deepest=deepest / h)
    touch = touch_depth(
        replace(indenter, bevel_distance_mm=distance_mm),
        thickness_mm=h,
        poisson_ratio=nu,
        poisson_ratio_std=nu_std,
        model=model,
    )
    return touch.rise_over_depth, touch.rise_over_depth_std


def blur_place(pile_up: PileUp, gel: Gel | None, *, indenter: Indenter, distance_mm: float) -> PileUp:
    """The rise with what it may be off by where the bevel's place was found, to about its window."""
    near, far = (computed_ratio(gel, indenter, distance_mm=distance_mm + sign * EDGE_MM) for sign in (-1, 1))
    if near is None or far is None:
        return pile_up
    return replace(pile_up, std=float(np.hypot(pile_up.std, 0.5 * (near[0] - far[0]))))


def combine(seen: tuple[float, float] | None, computed: tuple[float, float] | None) -> PileUp:
    """By inverse variance; where they contradict each other the std grows until they do not."""
    if seen is None or computed is None:
        known = seen or computed
        return unknown_pile_up() if known is None else PileUp(known[0], known[1], seen, computed)
    weights = np.array([1 / seen[1] ** 2, 1 / computed[1] ** 2])
    value = float(np.average([seen[0], computed[0]], weights=weights))
    apart = abs(seen[0] - computed[0]) / float(np.hypot(seen[1], computed[1]))
    return PileUp(value, float(max(apart, 1.0) / np.sqrt(weights.sum())), seen, computed)


def depth_std(
    depth_mm: float,
    pile_up: PileUp,
    *,
    height_std_mm: float,
    scale_std: float | None = None,
    tilt_std_mm: float = 0.0,
) -> float:
    """Std (mm) of a certified depth from machined height, pile-up and tilt.

    On a travel scale `scale_std`, its relative std, takes the place of height and tilt.
    """
    from_pile_up = depth_mm * pile_up.std / (1 + pile_up.ratio)
    if scale_std is not None:
        return float(np.hypot(from_pile_up, depth_mm * scale_std))
    return float(np.linalg.norm([height_std_mm / (1 + pile_up.ratio), from_pile_up, tilt_std_mm]))


# Pile-up at the bevel's edge for every press: seen in all presses of its bevel, computed for its own depth.

_MAX_GROWTH = 1.25  # of the rise over the depth, between depths up to a quarter of the gel; mechanics.touch
UNKNOWN_SCALE_STD = 0.25  # relative std of the map's scale where no event tells it


def press_pile_ups(events: Mapping[str, ContactTimes], gel: Gel | None) -> dict[str, PileUp]:
    """Pile-up of each press that was searched, by label.

    The rise over the depth changes with the depth. Beside a punch of 2.5 mm with its bevel at 5 mm on 3 mm of gel
    it grows by 8 to 9 % of itself from .15 to .6 mm; elsewhere by less, or it falls. What presses of one radius
    show together is carried to the depth of each by the computed ratio.
    """
    computed = {name: _computed(one, gel) for name, one in events.items()}
    seen, scale_std, map_std = _seen(events)
    pile_ups = {}
    for name, one in events.items():
        distance, indenter = one.bevel_contact.distance_mm, one.bevel_contact.press_signal.track.indenter
        if distance is None or not indenter.height_mm:
            pile_ups[name] = unknown_pile_up()
            continue
        at_depth = [
            (ratio * _growth(computed[name], computed[other]), std)
            for other, (ratio, std) in seen.get((distance, indenter.radius_mm), {}).items()
        ]
        pile_up = combine(seen_ratio(at_depth, scale_std=scale_std, map_std=map_std), computed[name])
        given, beside = one.bevel_contact.distance_given, mean_distance_mm(distance)
        pile_ups[name] = pile_up if given else blur_place(pile_up, gel, indenter=indenter, distance_mm=beside)
    return pile_ups


def _computed(one: ContactTimes, gel: Gel | None) -> Pair | None:
    """The computed rise over the depth of a press and its std; None where the gel or the bevel is not known."""
    distance = one.bevel_contact.distance_mm
    if distance is None:
        return None
    indenter = one.bevel_contact.press_signal.track.indenter
    return computed_ratio(gel, indenter, distance_mm=mean_distance_mm(distance))


def _growth(here: Pair | None, there: Pair | None) -> float:
    """The rise over the depth of one press over another's, as computed; 1 where that is not known.

    A ratio beyond _MAX_GROWTH is of two models, or lies near the place where the gel neither rises nor sinks: it
    tells nothing, and 1 is taken.
    """
    if here is None or there is None or there[0] == 0:
        return 1.0
    growth = here[0] / there[0]
    return growth if 1 / _MAX_GROWTH <= growth <= _MAX_GROWTH else 1.0


def _seen(
    events: Mapping[str, ContactTimes],
) -> tuple[dict[Pair, dict[str, tuple[Floats, Floats]]], float, float]:
    """Ratios (4,) and stds (4,) of single presses by the bevel's distance and the punch's radius (mm) and by
    label, std of the scale, error of the map.
    """
    ratios: dict[Pair, dict[str, tuple[Floats, Floats]]] = {}
    scales, errors = [], []
    for name, one in events.items():
        distance, press_signal = one.bevel_contact.distance_mm, one.bevel_contact.press_signal
        if one.touch is None or one.touch.onset.gain <= DETECTION_CHI2 or distance is None:
            continue
        indenter = press_signal.track.indenter
        scales += [one.touch.depth_seen_mm / indenter.height_mm] if indenter.height_mm else []
        beside = mean_distance_mm(distance)
        before = press_signal.use & (press_signal.drive < one.touch.onset.at)
        single = press_pile_up(press_signal.track, press_signal.drive, before=before, distance_mm=beside)
        if single is not None:
            ratios.setdefault((distance, indenter.radius_mm), {})[name] = single
            errors.append(map_error(press_signal.track, press_signal.drive, distance_mm=beside))
    scale_std = float(np.sqrt(np.mean((np.array(scales) - 1) ** 2))) if scales else UNKNOWN_SCALE_STD
    known = [error for error in errors if np.isfinite(error)]
    return ratios, scale_std, float(np.median(known)) if known else 0.0
