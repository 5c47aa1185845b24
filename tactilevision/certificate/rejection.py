"""Whether a press can be trusted: each check says why not, with its figures, or nothing.

Limits come from what the figures of the whole recording scatter by, or from what an error would do to the
certified depth and force; where both speak, the larger one counts. Several may speak; the first in ORDER is
the press' reason: what is seen at once and spoils the rest comes first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.phases import find_phases
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.certificate.touch.pace import moved_mm, of_three
from tactilevision.certificate.touch.press_track import PressTrack, deep_tilts
from tactilevision.contact.bevel import SIDES
from tactilevision.contact.bevel_onset import Onset
from tactilevision.contact.footprint import relief_mm, ring_beside, unevenness_mm
from tactilevision.records import Bools, Floats, ForceSeries, Press

TANGENTIAL = 0.1  # of the normal force: a share of 1/10 turns the resultant by six degrees
TILT_SHARE = 0.05  # of the depth: what a tilt may shift the bevel by; benchmarks.certificate
TILT_READ = 0.005  # rad that a map right to 1 % may tilt a flat face by; benchmarks.certificate
RADIUS_SHARE = 0.06  # of the radius, thrice what the footprint itself may be off; benchmarks.certificate
# of the depth, on the face or beside it: the gel there dips and rises by a third of it, alike all round
UNEVEN_SHARE = 0.05
FORCE_SHARE = 0.005  # of the force, what a gap between frames may leave open
FAINT_CHI2 = 4 * DETECTION_CHI2  # ten sigma, below which light that drifts may pass for a touch
ELSEWHERE_SHARE = 0.05  # of the depth of touch: more than heights and gels differ by from press to press
FAR_SHARE = 0.2  # of it: more than a gel softens by, over several presses, or a height is ground off
ZERO_MM = 0.015  # that the zeros of presses' depths may lie apart by
_MAX_GAP = 2.5  # of the median interval at the event: one lost frame and jitter are no gap; benchmarks.certificate
_TILTED = 0.75  # of a face's deep frames, in which it must be tilted: walls may be read wrongly in half of them
_MIN_REST = 0.5  # of the median rest, that a press must have had


@dataclass(frozen=True, slots=True)
class Finding:
    """A reason (one of records.REASONS) against a press, in one sentence with its figures."""

    reason: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class PressEvidence:
    """One press with all that was read of it. `event_s` (camera): its touch, or where the touch was to be
    expected.
    """

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
    """Medians and scatter of this recording: radius over nominal by indenter, tilt (2,) and its scatter, the
    interval of frames at the event, the rest, the chance that two readings of the free gel are equal, how
    uneven the gel is beside the face, how far the face is from flat, and, by indenter, what the gel beside the
    other ones has in common round them (180,). `touch_share`, by radius in mm: depth of touch, by the force, over
    the height, NaN where it is not known.
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
    """All that speaks against a press, the main reason first."""
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
    """A length (mm) with two decimals, and one below .1 with two digits: never 0.00 unless it is nothing."""
    return f"{length:.2f}" if length >= 0.1 else f"{length:.2g}"


def _footprint(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    face, nominal = evidence.track.footprint, evidence.track.indenter.radius_mm
    if face is None:
        return Finding("footprint", "no round face is to be seen")
    if face.residual_mm > RADIUS_SHARE * face.radius_mm:
        return Finding("footprint", f"the face is not round: its edge is {face.residual_mm:.2f} mm off a circle")
    # a face that slides on leaves the circle of its shallow frames, and draws gel along
    dragged = _tangential(evidence, statistics, forces) is not None
    ring = ring_beside(evidence.track.face_map, face, away_from=SIDES[evidence.track.side])
    uneven = unevenness_mm(ring, statistics.light[evidence.track.indenter.name])
    if uneven > max(UNEVEN_SHARE * face.depth_mm, 4 * statistics.uneven_mm) and not dragged:
        return Finding(
            "footprint", f"beside the face the gel is uneven by {1e3 * uneven:.0f} µm: it is no plain disc"
        )
    flatness = (
        relief_mm(evidence.track.face_map, face) if evidence.track.indenter.shape == "flat_cylinder" else 0.0
    )
    if flatness > max(UNEVEN_SHARE * face.depth_mm, 4 * statistics.relief_mm) and not dragged:
        return Finding(
            "footprint", f"the face is not flat: {1e3 * flatness:.0f} µm rms beside a plane; is it chipped?"
        )
    if not np.isfinite(nominal) or evidence.track.indenter.shape != "flat_cylinder":  # a ball touches with less
        return None
    ratio = face.radius_mm / nominal / statistics.radius.get(evidence.track.indenter.name, 1.0)
    limit = max(
        RADIUS_SHARE, 3 * face.radius_std_mm / nominal, 3 * evidence.track.indenter.radius_std_mm / nominal
    )
    if abs(ratio - 1) > limit:
        text = f"the face has a radius of {face.radius_mm:.2f} mm, the indenter {nominal:.2f} mm"
        return Finding("footprint", f"{text} ({100 * (ratio - 1):+.0f} % against the other presses)")
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
    """The force has stopped growing while the camera still sees the face go deeper.

    Frames count until the force falls again: on its way out no face goes deeper, but walls may be read wrongly.
    """
    seen = find_phases(evidence.track.depth_mm)
    if force.phases is None or seen is None or seen.hold == 0:
        return None
    ends = [force.phases.hold, min(force.phases.release, force.time_s.size - 1)]
    still_s, falls_s = force.time_s[ends] - evidence.offset_s
    depth = evidence.track.depth_mm
    # frames taken since: none is made up in a gap
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
    """Interval (s) between the frames, taken at times (N,) s, before and after an event; inf outside them."""
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
    """How long the rig needs for what it moved between the frames about the event: a dwell is no gap."""
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
        return Finding(
            "bevel_not_touched", f"a touch of the bevel would stand only {sigma:.1f} sigma out of the noise"
        )
    usual = statistics.touch_share.get(indenter.radius_mm, float("nan"))
    return _elsewhere(evidence.touch.onset, indenter.height_mm, usual=usual)


def _elsewhere(onset: Onset, height_mm: float, *, usual: float) -> Finding | None:
    """A touch far from where the other presses touch is light that changes there; a faint one sooner."""
    away = onset.at / height_mm / usual - 1
    share = ELSEWHERE_SHARE if onset.gain <= FAINT_CHI2 else FAR_SHARE
    if not abs(away) > max(share, 5 * onset.std / height_mm / usual, ZERO_MM / height_mm):
        return None
    return Finding(
        "bevel_not_touched",
        f"what stands {np.sqrt(onset.gain):.1f} sigma out of the noise comes {100 * away:+.0f} % off the depth at "
        "which the other presses touch: light that changes there, or another height than stated",
    )


def _short_rest(evidence: PressEvidence, statistics: RecordingStatistics, forces: ForceSeries) -> Finding | None:
    if evidence.rest_s < _MIN_REST * statistics.rest_s:
        return Finding(
            "short_rest", f"the gel had rested {evidence.rest_s:.1f} s, {statistics.rest_s:.1f} s are usual"
        )
    return None


def rests(presses: Sequence[Press]) -> list[float]:
    """Rest before each press: as recorded, else the time since the end of the one before."""
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
