"""Reject presses that cannot be trusted, each with its reason and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactilevision.contact.bevel import SIDES, Onset
from tactilevision.contact.footprint import relief_mm, ring_outside, shared_ring, unevenness_mm
from tactilevision.press.bevel_contact import DETECTION_CHI2, ContactEvent
from tactilevision.press.event_force import EventForce
from tactilevision.press.force_readings import ForceWindow, Phases, find_phases
from tactilevision.press.track import PressTrack, deep_tilts, face_tilt
from tactilevision.records.measured import Bools, Floats, ForceSeries
from tactilevision.records.rig import Press
from tactilevision.robust import mad_std

# The increase of a face's depth over some frames, where the reading of its wall alternates between two values.

_MAX_PACE = 3.0  # times the ramp's median pace: limit on a face's speed between two frames
_BOTH_WAYS = 4  # minimum number of frames within which both readings of such a wall occur
_BOTH_WAYS_S = 0.25  # s, likewise: most of a hold of half a second remains
_MOVING = 0.2  # of the pace of all but the fastest tenth of a ramp: slower frames are stops


def moved_mm(track: PressTrack, after: int, *, until: int, phases: Phases) -> float:
    """Return the largest increase of the face's depth (mm) from frame `after` to `until`.

    A face moves at its rig's pace: jumps are alternating readings of a wall. Both readings grow with the face, so
    the shallower one, of the frames that follow, is sufficient. A single frame that reads shallower than both its
    neighbours is no valid start.
    """
    seconds = np.diff(track.time_s)
    paces = (np.abs(np.diff(of_three(track.depth_mm))) / seconds)[phases.onset : phases.hold]
    paces = paces[np.isfinite(paces)]
    moving = paces[paces > _MOVING * np.quantile(paces, 0.9)] if paces.size else paces
    pace = float(np.median(moving)) if moving.size else np.inf  # no ramp in view determines the pace
    moved = []
    for depth_mm in (track.depth_mm, of_three(track.depth_mm)):
        with np.errstate(invalid="ignore"):  # where no frame in a row is readable
            steps = np.diff(_shallower(depth_mm, float(np.median(seconds))))
        jumps = np.abs(steps) > _MAX_PACE * pace * seconds + 5 * phases.noise
        moves = np.where(jumps | ~np.isfinite(steps), 0.0, steps)[after : until - 1]
        moved.append(float(np.cumsum(moves).max(initial=0.0)))
    return min(moved)


def of_three(depth_mm: Floats) -> Floats:
    """Return the median of each depth (T,), mm, and its neighbours: one frame may misread a wall."""
    if depth_mm.size < 3:
        return depth_mm
    inner = np.median([depth_mm[:-2], depth_mm[1:-1], depth_mm[2:]], axis=0)
    return np.concatenate([depth_mm[:1], inner, depth_mm[-1:]])


def _shallower(depth_mm: Floats, interval_s: float) -> Floats:
    """Return the least of each depth (T,), mm, and of those that follow it for _BOTH_WAYS_S."""
    count = max(_BOTH_WAYS, int(np.ceil(_BOTH_WAYS_S / interval_s)))
    padded = np.concatenate([np.nan_to_num(depth_mm, nan=np.inf), np.full(count - 1, np.inf)])
    return np.asarray(sliding_window_view(padded, count).min(axis=1))


# Whether a press can be trusted: each check returns its reason with figures, or nothing.
#
# Limits come from the scatter of the figures over the recording, or from the effect of an error on the certified
# depth and force; with both, the larger one counts. Of several reasons, the first in ORDER is the press' main
# reason: obvious faults that spoil other checks come first.

TANGENTIAL = 0.1  # of the normal force: a share of 1/10 tilts the resultant by six degrees
TILT_SHARE = 0.05  # of the depth: shift of the bevel by a tilt; benchmarks.certificate
TILT_READ = 0.005  # rad that a map right to 1 % may tilt a flat face by; benchmarks.certificate
RADIUS_SHARE = 0.06  # of the radius, three times the footprint's own error; benchmarks.certificate
# of the depth, on the face or outside it: the gel there dips and rises by a third of it, all round
UNEVEN_SHARE = 0.05
FORCE_SHARE = 0.005  # of the force: uncertainty by a gap between frames
FAINT_CHI2 = 4 * DETECTION_CHI2  # ten sigma, below which light that drifts may pass for a touch
ELSEWHERE_SHARE = 0.05  # of the depth of touch: more than heights and gels differ by from press to press
FAR_SHARE = 0.2  # of it: more than a gel softens by, over several presses, or a height is ground off
ZERO_MM = 0.015  # mm: largest difference between the zeros of presses' depths
_MAX_GAP = 2.5  # of the median interval at the event: one lost frame and jitter are no gap; benchmarks.certificate
_TILTED = 0.75  # of a face's deep frames, in which it must be tilted: walls may be misread in half of them
_MIN_REST = 0.5  # of the median rest: minimum before a press


@dataclass(frozen=True, slots=True)
class Finding:
    """A reason (one of records.REASONS) against a press, in one sentence with its figures."""

    reason: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class PressEvidence:
    """Measurements of one press. `event_s` (camera): its touch, or its expected touch."""

    track: PressTrack
    force: ForceWindow | None
    touch: ContactEvent | None
    event: EventForce | None
    event_s: float
    depth_mm: float
    distance_mm: float | None
    rest_s: float
    offset_s: float


@dataclass(frozen=True, slots=True, eq=False)
class RecordingStatistics:
    """Medians and scatter of this recording: radius over nominal by indenter, tilt (2,) and its scatter, the frame
    interval at the event, the rest, the chance that two readings of the free gel are equal, the unevenness of the
    gel outside the face, the face's deviation from flat, and, by indenter, the common profile of the gel around
    the other indenters (180,). `touch_share`, by radius in mm: depth of touch, by the force, over the height, NaN
    where unknown.
    """

    radius: dict[str, float]
    tilt: Floats
    tilt_scatter: float
    interval_s: float
    rest_s: float
    equal: float
    uneven_mm: float
    relief_mm: float
    light: dict[str, Floats]
    touch_share: dict[float, float]


def rejection_reasons(
    evidence: PressEvidence, statistics: RecordingStatistics, *, forces: ForceSeries
) -> tuple[Finding, ...]:
    """Return all reasons against a press, the main reason first."""
    findings = [check(evidence, statistics, forces) for check in ORDER]
    return tuple(finding for finding in findings if finding is not None)


def _border(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    face, map_ = evidence.track.footprint, evidence.track.face_map
    if face is None:
        return None
    half = [0.5 * n * s for n, s in zip(map_.depth_mm.shape[::-1], map_.mm_per_px, strict=True)]
    room = min(h - abs(c) - face.radius_mm for h, c in zip(half, face.centre_mm, strict=True))
    if room < 0:
        return Finding("border", f"the face reaches {_mm(-room)} mm beyond the view's border")
    if room < 2 * max(map_.mm_per_px):
        return Finding("border", f"the face comes within {_mm(room)} mm of the view's border")
    if evidence.distance_mm is not None:
        edge = [
            c + evidence.distance_mm * e for c, e in zip(face.centre_mm, SIDES[evidence.track.side], strict=True)
        ]
        out = max(abs(place) - h for place, h in zip(edge, half, strict=True))
        if out > 0:
            return Finding("border", f"the bevel's edge lies {_mm(out)} mm outside the view")
    return None


def _mm(length: float) -> str:
    """Return a length (mm) with two decimals, and one below .1 with two digits: 0.00 only for zero."""
    return f"{length:.2f}" if length >= 0.1 else f"{length:.2g}"


def _footprint(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    face, nominal = evidence.track.footprint, evidence.track.indenter.radius_mm
    if face is None:
        return Finding("footprint", "no round face is to be seen")
    if face.residual_mm > RADIUS_SHARE * face.radius_mm:
        return Finding("footprint", f"the face is not round: its edge is {face.residual_mm:.2f} mm off a circle")
    # a sliding face leaves the circle of its shallow frames, and drags gel along
    dragged = _tangential(evidence, statistics, forces) is not None
    ring = ring_outside(evidence.track.face_map, face, away_from=SIDES[evidence.track.side])
    uneven = unevenness_mm(ring, statistics.light[evidence.track.indenter.name])
    if uneven > max(UNEVEN_SHARE * face.depth_mm, 4 * statistics.uneven_mm) and not dragged:
        return Finding(
            "footprint", f"next to the face the gel is uneven by {1e3 * uneven:.0f} µm: it is no plain disc"
        )
    flatness = (
        relief_mm(evidence.track.face_map, face) if evidence.track.indenter.shape == "flat_cylinder" else 0.0
    )
    if flatness > max(UNEVEN_SHARE * face.depth_mm, 4 * statistics.relief_mm) and not dragged:
        return Finding(
            "footprint", f"the face is not flat: {1e3 * flatness:.0f} µm rms off a plane; is it chipped?"
        )
    if not np.isfinite(nominal) or evidence.track.indenter.shape != "flat_cylinder":  # a ball's contact is smaller
        return None
    ratio = face.radius_mm / nominal / statistics.radius.get(evidence.track.indenter.name, 1.0)
    limit = max(
        RADIUS_SHARE, 3 * face.radius_std_mm / nominal, 3 * evidence.track.indenter.radius_std_mm / nominal
    )
    if abs(ratio - 1) > limit:
        text = f"the face has a radius of {face.radius_mm:.2f} mm, the indenter {nominal:.2f} mm"
        return Finding("footprint", f"{text} ({100 * (ratio - 1):+.0f} % compared with the other presses)")
    return None


def _tilt(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.track.footprint is None or not np.nanmax(evidence.track.depth_mm) > 0:
        return None
    tilts = np.hypot(*(deep_tilts(evidence.track) - statistics.tilt).T)
    tilt = float(np.nanquantile(tilts, 1 - _TILTED))
    lever = evidence.distance_mm or 2 * evidence.track.footprint.radius_mm
    limit = max(TILT_SHARE * evidence.depth_mm / lever, 5 * statistics.tilt_scatter, TILT_READ)
    if tilt > limit:
        return Finding(
            "tilt", f"the face is tilted by {np.degrees(tilt):.2f} degrees (limit {np.degrees(limit):.2f})"
        )
    return None


def _tangential(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.event is not None:
        force, std = evidence.event.force_N, evidence.event.std_N
    elif evidence.force is not None and evidence.force.phases is not None:
        phases = evidence.force.phases
        held = evidence.force.force_N[phases.hold : phases.release + 1]
        force, std = held.mean(axis=0), held.std(axis=0) / np.sqrt(max(len(held), 1))
    else:
        return None
    sideways, normal = float(np.hypot(force[0], force[1])), float(force[2])
    if normal > 0 and sideways - 3 * float(np.hypot(std[0], std[1])) > TANGENTIAL * normal:
        return Finding("tangential", f"the tangential force is {100 * sideways / normal:.0f} % of the normal one")
    return None


def _saturated(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.force is None:
        return None
    raw = evidence.force.force_N + evidence.force.tare.at(evidence.force.time_s)
    for axis, name in enumerate(("fx", "fy", "fz")):
        reading = np.abs(raw[:, axis])
        top = float(np.nanmax(reading))
        if top < 20 * forces.std_N[axis]:
            continue
        run = _longest(reading >= top * (1 - 1e-9))
        if run >= 10 and statistics.equal**run < 1e-6:
            return Finding("saturated", f"{name} stands at {top:.3f} N for {run} readings")
    return _force_stopped(evidence, evidence.force)


def _force_stopped(evidence: PressEvidence, force: ForceWindow) -> Finding | None:
    """Return a finding where the force has stopped growing while the camera still sees the face go deeper.

    Frames count until the force falls again: during unloading no face goes deeper, but walls may be misread.
    """
    seen = find_phases(evidence.track.depth_mm)
    if force.phases is None or seen is None or seen.hold == 0:
        return None
    ends = [force.phases.hold, min(force.phases.release, force.time_s.size - 1)]
    still_s, falls_s = force.time_s[ends] - evidence.offset_s
    depth = evidence.track.depth_mm
    # frames taken since: none is interpolated in a gap
    after, until = (int(k) for k in np.searchsorted(evidence.track.time_s, (still_s, falls_s)))
    if until <= after:
        return None
    deepest = float(np.nanmax(of_three(depth)[after:until]))
    if moved_mm(evidence.track, after, until=until, phases=seen) > max(5 * seen.noise, 0.15 * deepest):
        return Finding(
            "saturated", f"the force stays at {force.smooth_N.max():.2f} N while the face still goes deeper"
        )
    return None


def _longest(run: Bools) -> int:
    edges = np.flatnonzero(np.diff(np.r_[0, run.astype(np.int8), 0]))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def interval_at(time_s: Floats, event_s: float) -> float:
    """Return the interval (s) of the frames, at times (N,) s, around an event; inf outside them."""
    after = int(np.searchsorted(time_s, event_s))
    if not 0 < after < time_s.size:
        return float("inf")
    return float(time_s[after] - time_s[after - 1])


def _dropped(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.force is None:
        return Finding("dropped_frames", "there are no force readings to go with the frames of this press")
    if not np.isfinite(evidence.event_s):
        return None
    times = evidence.track.time_s
    gap = interval_at(times, evidence.event_s)
    if evidence.touch is not None and np.isfinite(evidence.touch.seen_s):  # moved by the travel scale since
        gap = min(gap, interval_at(times, evidence.touch.seen_s))
    moved = min(gap, _moving_s(evidence, evidence.force))
    if moved <= _MAX_GAP * statistics.interval_s:
        return None
    if evidence.event is not None and np.isfinite(moved):
        open_N = evidence.force.ramp_N_s * moved / np.sqrt(12)
        if open_N < FORCE_SHARE * float(evidence.event.force_N[2]):
            return None
    text = f"{1e3 * gap:.0f} ms without a frame at the event, {1e3 * statistics.interval_s:.0f} ms are usual"
    return Finding("dropped_frames", text)


def _moving_s(evidence: PressEvidence, force: ForceWindow) -> float:
    """Return the rig's motion time (s) between the frames about the event: a dwell is no gap."""
    after = int(np.searchsorted(evidence.track.time_s, evidence.event_s))
    if not 0 < after < evidence.track.time_s.size or not force.ramp_N_s > 0:
        return float("inf")
    there = force.at(evidence.track.time_s[after - 1 : after + 1] + evidence.offset_s)
    grown = abs(float(there[1] - there[0]))
    return grown / force.ramp_N_s if np.isfinite(grown) else float("inf")


def _not_touched(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    indenter = evidence.track.indenter
    if indenter.height_mm is None or indenter.bevel is None:
        return Finding("bevel_not_touched", f"indenter {indenter.name} has no bevel of known height")
    if evidence.touch is None:
        return Finding("bevel_not_touched", "no touch of the bevel is to be seen")
    if evidence.touch.onset.gain < DETECTION_CHI2:
        sigma = np.sqrt(max(evidence.touch.onset.gain, 0.0))
        return Finding("bevel_not_touched", f"the touch of the bevel is significant by {sigma:.1f} sigma only")
    usual = statistics.touch_share.get(indenter.radius_mm, float("nan"))
    return _elsewhere(evidence.touch.onset, indenter.height_mm, usual=usual)


def _elsewhere(onset: Onset, height_mm: float, *, usual: float) -> Finding | None:
    """Return a finding for a touch far from the others, caused by light; stricter for a faint one."""
    away = onset.at / height_mm / usual - 1
    share = ELSEWHERE_SHARE if onset.gain <= FAINT_CHI2 else FAR_SHARE
    if not abs(away) > max(share, 5 * onset.std / height_mm / usual, ZERO_MM / height_mm):
        return None
    return Finding(
        "bevel_not_touched",
        f"a signal of {np.sqrt(onset.gain):.1f} sigma appears {100 * away:+.0f} % off the depth at which "
        "the other presses touch: light that changes there, or another height than stated",
    )


def _short_rest(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.rest_s < _MIN_REST * statistics.rest_s:
        return Finding(
            "short_rest", f"the gel had rested {evidence.rest_s:.1f} s, {statistics.rest_s:.1f} s are usual"
        )
    return None


def rests(presses: Sequence[Press]) -> list[float]:
    """Return the rest before each press: as recorded, else the time since the end of the previous one."""
    found = []
    for k, press in enumerate(presses):
        earlier = [p.end_s for p in presses[:k] if p.end_s <= press.start_s]
        since = press.start_s - max(earlier) if earlier else float("nan")
        found.append(press.rest_s if np.isfinite(press.rest_s) else since)
    return found


ORDER: tuple[Callable[[PressEvidence, RecordingStatistics, ForceSeries], Finding | None], ...] = (
    _border,
    _footprint,
    _saturated,
    _tilt,
    _tangential,
    _dropped,
    _not_touched,
    _short_rest,
)


# Statistics of a recording's presses, with which the checks compare each of them.

_DEFAULT_TILT_STD = 0.002  # rad, where too few presses determine the tilts' scatter
_MIN_REPEATS = 2  # repeated presses from which the scatter of tilts is taken; benchmarks.certificate
_MAX_RADIUS_OFF = 0.1  # of 1: a larger common error of radii is not the footprint's


def recording_statistics(presses: Mapping[str, PressEvidence]) -> RecordingStatistics:
    """Return medians over the presses, and the scatter of their tilts."""
    seen = [evidence for evidence in presses.values() if evidence.track.footprint is not None]
    tilts = np.array([face_tilt(evidence.track) for evidence in seen]).reshape(-1, 2)
    tilts = tilts[np.isfinite(tilts).all(axis=1)]
    tilt, scatter = np.zeros(2), _DEFAULT_TILT_STD
    if len(tilts) >= 3:
        tilt = np.median(tilts, axis=0)
        scatter = mad_std(np.hypot(*(tilts - tilt).T), centre=0.0) / np.sqrt(2)
    intervals = [
        interval_at(evidence.track.time_s, evidence.event_s)
        for evidence in presses.values()
        if np.isfinite(evidence.event_s)
    ]
    finite = [gap for gap in intervals if np.isfinite(gap)]
    faces = [(evidence.track, face) for evidence in seen if (face := evidence.track.footprint) is not None]
    rings = [
        (track.indenter.name, ring_outside(track.face_map, face, away_from=SIDES[track.side]))
        for track, face in faces
    ]
    names = {name for name, _ in rings}
    light = {name: shared_ring([ring for other, ring in rings if other != name]) for name in names}
    uneven = [unevenness_mm(ring, light[name]) for name, ring in rings]
    flatness = [relief_mm(track.face_map, face) for track, face in faces]
    rest = [evidence.rest_s for evidence in presses.values() if np.isfinite(evidence.rest_s)]
    return RecordingStatistics(
        radius=_radius_ratios(seen),
        tilt=np.asarray(tilt),
        tilt_scatter=scatter,
        interval_s=float(np.median(finite)) if finite else float("inf"),
        rest_s=float(np.median(rest)) if rest else 0.0,
        equal=_equal(presses),
        uneven_mm=_median(uneven),
        light=light,
        touch_share=_touch_shares(presses.values()),
        relief_mm=_median(flatness),
    )


def _touch_shares(presses: Iterable[PressEvidence]) -> dict[float, float]:
    """Return the median over the presses of a radius that touched; NaN where fewer than three did at all.

    The gel's rise at the bevel depends on the radius; with fewer than three of one, the median is of all radii.
    """
    shares: dict[float, list[float]] = {}
    for evidence in presses:
        indenter, touch = evidence.track.indenter, evidence.touch
        if touch is not None and indenter.height_mm and touch.onset.gain > DETECTION_CHI2:
            shares.setdefault(indenter.radius_mm, []).append(touch.onset.at / indenter.height_mm)
    everything = [share for found in shares.values() for share in found]
    common = float(np.median(everything)) if len(everything) >= 3 else float("nan")
    return {radius: float(np.median(found)) if len(found) >= 3 else common for radius, found in shares.items()}


def _median(values: Sequence[float]) -> float:
    """Return the median of the known values; 0 where fewer than three are known."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if len(known) >= 3 else 0.0


def _radius_ratios(seen: list[PressEvidence]) -> dict[str, float]:
    """Return radius over nominal, by indenter where it has three presses, else of all."""
    by_name: dict[str, list[float]] = {}
    for evidence in seen:
        face, indenter = evidence.track.footprint, evidence.track.indenter
        if face is not None and np.isfinite(indenter.radius_mm) and indenter.shape == "flat_cylinder":
            by_name.setdefault(indenter.name, []).append(face.radius_mm / indenter.radius_mm)
    everything = [ratio for ratios in by_name.values() for ratio in ratios]
    common = float(np.median(everything)) if len(everything) >= 3 else 1.0
    medians = {name: float(np.median(r)) if len(r) >= 3 else common for name, r in by_name.items()}
    return {name: ratio if abs(ratio - 1) < _MAX_RADIUS_OFF else 1.0 for name, ratio in medians.items()}


def _equal(presses: Mapping[str, PressEvidence]) -> float:
    """Return the chance that two consecutive readings of the free gel are the same number."""
    shares: list[float] = []
    for evidence in presses.values():
        if evidence.force is None or evidence.force.phases is None:
            continue
        free: Floats = evidence.force.force_N[: evidence.force.phases.onset] + evidence.force.tare.at(
            evidence.force.time_s[: evidence.force.phases.onset]
        )
        if len(free) > 20:
            shares += [float((np.abs(np.diff(free, axis=0)) < 1e-9).mean(axis=0).max())]
    return float(np.clip(np.median(shares), 0.05, 0.9)) if shares else 0.6


def tilt_scatter_to_bevel(presses: Sequence[PressEvidence], medians: RecordingStatistics) -> float:
    """Return the scatter (rad) of the faces' tilt towards the bevel between repeated presses of each indenter.

    Over all presses where none is repeated: misread walls make the tilt depend on depth.
    """
    tilts: dict[str, list[float]] = {}
    for evidence in presses:
        tilt = float(face_tilt(evidence.track) @ np.array(SIDES[evidence.track.side]))
        if evidence.track.footprint is not None and np.isfinite(tilt):
            tilts.setdefault(evidence.track.indenter.name, []).append(tilt)
    freedom = sum(len(group) - 1 for group in tilts.values())
    if freedom < _MIN_REPEATS:
        return medians.tilt_scatter
    return float(np.sqrt(sum(np.var(group) * len(group) for group in tilts.values()) / freedom))


# Is the indenter tilted in its mount? All faces then have the same tilt, at any depth.
#
#     tilt = t0 + k w      t0 (2,) rad: the mount; k: a map that misreads walls tilts a face in proportion to depth
#
# A tilted indenter tilts its bevel as well, so that certified depths have a similar error in each press, as by
# another depth zero. No press differs from the others, so that none is rejected.

MIN_SPREAD = 1.5  # deepest press over the shallowest: a smaller ratio does not separate mount and map
SIGMA = 5.0  # of the tilt's own std: minimum significant tilt


def mount_tilt(tilts: Floats, depth_mm: Floats) -> Floats | None:
    """Return t0 (2,) in rad of tilts (n, 2) in rad of faces at these depths (n,) in mm; None where undetermined.

    Range: any n; fewer than four presses, or depths of less than 1.5 to 1, give None.
    """
    known = np.isfinite(tilts).all(axis=1) & np.isfinite(depth_mm) & (depth_mm > 0)
    tilts, depth_mm = tilts[known], depth_mm[known]
    if depth_mm.size < 4 or depth_mm.max() < MIN_SPREAD * depth_mm.min():
        return None
    found, covariance = np.polyfit(depth_mm, tilts, 1, cov=True)
    std = float(np.sqrt(covariance[1, 1].mean()))
    return found[1] if float(np.hypot(*found[1])) > max(TILT_READ, SIGMA * std) else None


def tilt_warning(presses: Sequence[PressEvidence]) -> str:
    """Return a warning that the indenter is tilted in its mount; empty where the tilt is not significant."""
    seen = [one for one in presses if one.track.footprint is not None]
    tilts = np.array([face_tilt(one.track) for one in seen]).reshape(-1, 2)
    tilt = mount_tilt(tilts, np.array([one.depth_mm for one in seen]))
    if tilt is None:
        return ""
    right, down = tilt
    deeper = ("right" if right > 0 else "left") if abs(right) > abs(down) else "bottom" if down > 0 else "top"
    size, lever = float(np.hypot(right, down)), float(np.nanmedian([_lever_mm(one) for one in seen]))
    return (
        f"All faces are tilted by {np.degrees(size):.2f} degrees, deeper at the {deeper}, whatever their depth: "
        f"the indenter is tilted in its mount. Its bevel then tips by up to {1e3 * size * lever:.0f} µm, by which "
        "depths may be off beyond their intervals, and c and beta with them. Level the indenter."
    )


def _lever_mm(one: PressEvidence) -> float:
    """Return the distance from the axis to the bevel, or its usual value."""
    if one.distance_mm:
        return one.distance_mm
    return float("nan") if one.track.footprint is None else 2 * one.track.footprint.radius_mm
