"""Certify depth and force of all presses of a recording from its frames and force readings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.errors import InputError, RecordingError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.photometric.protocols import Progress, silent
from tactilevision.press.bevel_contact import DETECTION_CHI2, BevelContact, search_bevel_contacts
from tactilevision.press.certificate import Certificate, certified_point, evidence_of, judge_point, press_curve
from tactilevision.press.certified_faces import find_depth_scale, scale_warning
from tactilevision.press.clock import (
    PressDepths,
    clock_jump_warnings,
    clock_jumps,
    correlation_offset,
    estimate_offset,
    parabola_offset,
    stated_offset_warnings,
)
from tactilevision.press.contact_times import ContactTimes, RecordingMeasurements, contact_times
from tactilevision.press.event_force import force_crossing
from tactilevision.press.force_readings import ForceWindow, force_window, subtract_tares
from tactilevision.press.indenter_travel import apply_travel_scale
from tactilevision.press.pile_up import PileUp, press_pile_ups
from tactilevision.press.rejection import (
    Finding,
    PressEvidence,
    recording_statistics,
    rejection_reasons,
    rests,
    tilt_scatter_to_bevel,
    tilt_warning,
)
from tactilevision.press.track import (
    PressTrack,
    Reconstructs,
    allow_for_repeats,
    compression_warnings,
    late_std_mm,
    note_blocks,
    note_repeats,
    repeated_share,
    track,
)
from tactilevision.recording.layout import some
from tactilevision.recording.model import BadFrame, Recording, require_all
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.maps import Footprint
from tactilevision.records.measured import Estimate, ForceSeries
from tactilevision.records.rig import Gel, Indenter, Press

# Certificate of a recording: points, curves and evidence from the measurements of every press.

UNSEEN_PRESS = Finding("dropped_frames", "fewer than two sound frames show this press")


def assemble_certificate(measurements: RecordingMeasurements) -> Certificate:
    """Return points, curves and evidence of every press."""
    events = contact_times(measurements)
    pile_ups = press_pile_ups(events, measurements.recording.sensor.gel)
    first = _findings(measurements, _press_evidence(measurements, events, pile_ups))
    # frames may be missing where an event was seen, and not where the travel scale puts it
    sound = [
        name
        for name, against in first.items()
        if name not in measurements.clock_outliers and all(one.reason == "dropped_frames" for one in against)
    ]
    ratios = {name: pile_up.ratio for name, pile_up in pile_ups.items()}
    events = apply_travel_scale(measurements, events, pile_up_ratios=ratios, sound=sound)
    evidence = _press_evidence(measurements, events, pile_ups)
    findings = _findings(measurements, evidence)
    points = _points(measurements, events, pile_ups, evidence, findings)
    faces = [
        (touch.depth_seen_mm, point.depth_mm)
        for point in points
        if point.accepted and (touch := evidence[point.press].touch) is not None
    ]
    scale = find_depth_scale(faces)
    seen = [(evidence[point.press], point) for point in points if point.press in evidence]
    curves = [
        press_curve(one.track, one.force, point=point, touch=one.touch, offset_s=one.offset_s, depth_scale=scale)
        for one, point in seen
    ]
    recording, reconstructor = measurements.recording, measurements.reconstructor
    given = next((one.bevel_contact for one in events.values()), None)
    doubt = scale_warning(faces, [ball.ball_radius_mm for ball in recording.balls])
    tilted = tilt_warning([evidence[point.press] for point in points if point.accepted])
    return Certificate(
        points=points,
        curves=tuple(curve for curve in curves if curve is not None),
        clock_offset=measurements.offset,
        evidence={
            point.press: evidence_of(recording, reconstructor, press_evidence=one, findings=findings[point.press])
            for one, point in seen
        },
        pile_ups=pile_ups,
        bevel_distance_mm=given.distance_mm if given else None,
        depth_scale=scale,
        warnings=(*_warnings(measurements, events), *(said for said in (doubt, tilted) if said)),
        scale_doubt=doubt,
    )


def _points(
    measurements: RecordingMeasurements,
    events: Mapping[str, ContactTimes],
    pile_ups: Mapping[str, PileUp],
    evidence: Mapping[str, PressEvidence],
    findings: Mapping[str, tuple[Finding, ...]],
) -> tuple[CertifiedPoint, ...]:
    """Return the point of every press with its verdict, in the recording's order."""
    sound = [one for name, one in evidence.items() if not findings[name]]
    tilt_scatter = tilt_scatter_to_bevel(sound, recording_statistics(evidence))
    points = []
    for press in measurements.recording.presses:
        name = press.press
        known = (events.get(name), pile_ups.get(name), evidence.get(name))
        point = certified_point(measurements, press, *known, tilt_scatter_rad=tilt_scatter)
        points.append(judge_point(point, findings.get(name, (UNSEEN_PRESS,))))
    return tuple(points)


def _findings(
    measurements: RecordingMeasurements, press_evidence: Mapping[str, PressEvidence]
) -> dict[str, tuple[Finding, ...]]:
    statistics = recording_statistics(press_evidence)
    return {
        name: _clock_finding(measurements, name)
        + rejection_reasons(evidence, statistics, forces=measurements.forces)
        for name, evidence in press_evidence.items()
    }


def _clock_finding(measurements: RecordingMeasurements, name: str) -> tuple[Finding, ...]:
    """Return a finding of misaligned clocks, which may look like a saturated force."""
    if name not in measurements.clock_outliers:
        return ()
    away = f"{measurements.clock_outliers[name]:+.2f} s from here"
    text = f"depth and force go together only at another offset of the clocks, {away}"
    return (Finding("dropped_frames", text),)


def _press_evidence(
    measurements: RecordingMeasurements, events: Mapping[str, ContactTimes], pile_ups: Mapping[str, PileUp]
) -> dict[str, PressEvidence]:
    return {
        name: _evidence(measurements, track, events.get(name), pile_ups.get(name))
        for name, track in measurements.tracks.items()
        if track is not None
    }


def _evidence(
    measurements: RecordingMeasurements, track: PressTrack, events: ContactTimes | None, pile_up: PileUp | None
) -> PressEvidence:
    name, window = track.press.press, measurements.windows[track.press.press]
    touch, event = (events.touch, events.event) if events else (None, None)
    expected = (track.indenter.height_mm or float("nan")) / (1 + (pile_up.ratio if pile_up else 0.0))
    event_s = float("nan")
    if touch is not None and touch.onset.gain > DETECTION_CHI2:
        event_s = touch.time_s
    elif events is not None and window is not None and np.isfinite(expected):
        due = force_crossing(window, float(events.bevel_contact.law.force(expected)), level_std_N=0.0)
        event_s = due.time_s - measurements.offset_s if due is not None else float("nan")
    return PressEvidence(track=track, force=window, touch=touch, event=event, event_s=event_s, depth_mm=expected,
                distance_mm=events.bevel_contact.distance_mm if events else track.indenter.bevel_distance_mm,
                rest_s=measurements.rest_s[name], offset_s=measurements.offset_s)  # fmt: skip


def _warnings(measurements: RecordingMeasurements, events: Mapping[str, ContactTimes]) -> Iterator[str]:
    yield from measurements.notes
    if measurements.offset.value is None:
        yield f"The clocks could not be aligned ({measurements.offset.why}); they are taken to agree."
    torn = [bad.name for track in measurements.tracks.values() if track is not None for bad in track.missing]
    if torn:
        yield f"Frames that cannot be read were passed over: {some(torn)}."
    untared = [
        name for name, window in measurements.windows.items() if window is not None and not window.tare.known
    ]
    if untared:
        yield f"No force reading of the free gel for presses {', '.join(untared)}: their zero is as recorded."
    if any(
        t.bevel_contact.distance_mm is not None and not t.bevel_contact.distance_given for t in events.values()
    ):
        place = next(
            t.bevel_contact.distance_mm for t in events.values() if t.bevel_contact.distance_mm is not None
        )
        yield f"The bevel's edge is not stated; it was found at {place:.1f} mm from the axis."
    if any(t.bevel_contact.distance_mm is None for t in events.values()):
        yield (
            "The bevel's place is neither stated nor seen: depths are the machined heights, which may be "
            "too deep by up to 13 %."
        )


# Frames and forces of a recording to its certificate.
#
# track each press -> align the clocks -> tare -> find all contact events together -> pile-up, depth, force ->
# check

_LONG = 250  # frames of a press beyond which their maps are not kept
_TRIAL_FRAMES = 12  # frames of a long press in which the face is searched first
_SILICONE = 0.48  # Poisson's ratio, for the stiffness of a wider punch
_MARGIN_S = 0.5  # s of free gel wanted before and after the press that the table names; benchmarks.certificate


def certify(recording: Recording, reconstructor: Reconstructs, *, progress: Progress = silent) -> Certificate:
    """Return certified depth and force of every press of a recording that has frames and forces.

    `progress` hears of each press, and of the steps after the last one. Frames are streamed, one press at a time
    in memory.
    Raises RecordingError where frames, their times, forces or presses are missing, or an indenter is not
    described.
    """
    require_all(recording)
    repeats: list[float] = []
    blocks: list[float] = []
    tracks = _track_all(recording, reconstructor, progress, repeats, blocks)
    progress(0, 1, "clocks and contact events")
    forces = recording.forces
    assert forces is not None
    offset = _first_offset(recording, forces, tracks)
    windows = _windows(recording, forces, tracks, offset.value or 0.0)
    search = partial(search_bevel_contacts, tracks, unseen_mm=late_std_mm(blocks))
    bevel_contacts = search(windows, offset_s=offset.value or 0.0)
    doubts: tuple[str, ...] = ()
    if offset.value is not None:
        # again, now that the frames that feel the bevel are known
        level = subtract_tares(forces, (window.tare for window in windows.values() if window is not None))
        seen = list(_seen(tracks, windows, bevel_contacts, recording.sensor.gel).values())
        if recording.clock_offset_s is not None:
            doubts = stated_offset_warnings(recording.clock_offset_s, seen, level)
        else:
            offset = estimate_offset(seen, level, start_s=offset.value)
            windows = _windows(recording, forces, tracks, offset.value or 0.0)
            bevel_contacts = search(windows, offset_s=offset.value or 0.0, before=bevel_contacts)
    offset, notes = allow_for_repeats(offset, repeated_share(repeats), times_s=recording.frame_times_s)
    notes += doubts + compression_warnings(blocks)
    clock_outliers = {}
    if offset.value is not None:
        clock_outliers = clock_jumps(
            _seen(tracks, windows, bevel_contacts, recording.sensor.gel), forces, offset_s=offset.value
        )
        notes = (*notes, *clock_jump_warnings(clock_outliers))
    progress(0, 1, "depths, forces and checks")
    rest_s = dict(zip(tracks, rests(recording.presses), strict=True))
    return assemble_certificate(
        RecordingMeasurements(
            recording, reconstructor, tracks, windows, offset, bevel_contacts, rest_s, notes, clock_outliers
        )
    )


def _track_all(
    recording: Recording,
    reconstructor: Reconstructs,
    progress: Progress,
    repeats: list[float],
    blocks: list[float],
) -> dict[str, PressTrack | None]:
    """Every press as the camera saw it; `blocks` takes the steps between blocks of one frame of each, `repeats`
    of a video what its frames have in common.
    """
    found: dict[str, PressTrack | None] = {}
    labels = [press.press for press in recording.presses]
    for label in labels:
        if labels.count(label) > 1:
            raise RecordingError(
                "two presses have the same label",
                where=recording.path,
                value=label,
                remedy="Give each row of presses.csv its own.",
            )
    for k, press in enumerate(recording.presses):
        indenter = recording.indenters.get(press.indenter)
        if indenter is None:
            raise RecordingError(
                "a press names an indenter that is not described",
                where=recording.path,
                value=press.indenter,
                remedy=f"Add a table [indenter.{press.indenter}].",
            )
        first, last = free_span(recording.presses, k)
        first, last = max(first, press.start_s - _MARGIN_S), min(last, press.end_s + _MARGIN_S)
        near = _look_ahead(recording, reconstructor, (first, last), indenter)
        frames = note_blocks(iter_frames(recording, first, end_s=last), blocks)
        if recording.frames_path is not None and recording.frames_path.is_file():
            frames = note_repeats(frames, repeats)
        found[press.press] = track(frames, reconstructor, press=press, indenter=indenter, near=near)
        progress(k + 1, len(recording.presses), "frames")
    return found


def _look_ahead(
    recording: Recording, reconstructor: Reconstructs, span_s: tuple[float, float], indenter: Indenter
) -> Footprint | None:
    """Return the face's place in the deepest of a few frames of a long press; None for a short one."""
    times = recording.frame_times_s
    rows = np.flatnonzero((times >= span_s[0]) & (times <= span_s[1]))
    if rows.size <= _LONG:
        return None
    best, top = None, 0.0
    for row in rows[np.linspace(0, rows.size - 1, _TRIAL_FRAMES).astype(int)]:
        frame, face = next(iter_frames(recording, float(times[row]), end_s=float(times[row]))), None
        with suppress(InputError):  # a rejected frame is named where the press is tracked
            if not isinstance(frame, BadFrame):
                face = find_footprint(reconstructor.height_map(frame), indenter)
        if face is not None and face.depth_mm > top:
            best, top = face, face.depth_mm
    return best


def free_span(presses: Sequence[Press], k: int) -> tuple[float, float]:
    """Return the time from the end of the previous press to the start of the next one."""
    here = presses[k]
    before = [p.end_s for p in presses if p is not here and p.end_s <= here.start_s]
    after = [p.start_s for p in presses if p is not here and p.start_s >= here.end_s]
    return max(before, default=-np.inf), min(after, default=np.inf)


def _first_offset(recording: Recording, forces: ForceSeries, tracks: Mapping[str, PressTrack | None]) -> Estimate:
    if recording.clock_offset_s is not None:
        known = recording.clock_offset_s
        return Estimate(known, 0.0, (known, known), "s")
    seen = list(_seen(tracks, {}, {}, recording.sensor.gel).values())
    if not seen:
        return Estimate(None, None, None, "s", why="no press is to be seen in the frames")
    start, sure = correlation_offset(seen, forces)
    if sure < 0.5:
        return Estimate(None, None, None, "s", why=f"depth and force do not go together (correlation {sure:.2f})")
    return estimate_offset(seen, forces, start_s=parabola_offset(seen, forces, start_s=start))


def _seen(
    tracks: Mapping[str, PressTrack | None],
    windows: Mapping[str, ForceWindow | None],
    bevel_contacts: Mapping[str, BevelContact],
    gel: Gel | None,
) -> dict[str, PressDepths]:
    """Return the presses for the clocks, by label; the force reaches the touch at the depth read there."""
    found = {}
    for name, seen in tracks.items():
        if seen is None or seen.footprint is None:
            continue
        if np.isnan(seen.indenter.radius_mm):  # a cone has no face
            continue
        bevel_contact, window = bevel_contacts.get(name), windows.get(name)
        level = float("nan")
        if bevel_contact is not None and window is not None:
            level = float("inf")
            if bevel_contact.onset is not None and bevel_contact.onset.gain > DETECTION_CHI2:
                level = float(bevel_contact.law.force(bevel_contact.onset.at))
        radius = stiffness = seen.indenter.radius_mm
        if gel is not None:
            stiffness *= float(fast_kappa(_SILICONE, np.clip(radius / gel.thickness_mm, *A_OVER_H_RANGE)))
        found[name] = PressDepths(seen.time_s, seen.depth_mm, radius, level, stiffness)
    return {name: depths for name, depths in found.items() if depths.goes_in}


def _windows(
    recording: Recording, forces: ForceSeries, tracks: Mapping[str, PressTrack | None], offset_s: float
) -> dict[str, ForceWindow | None]:
    found: dict[str, ForceWindow | None] = {}
    for k, (name, seen) in enumerate(tracks.items()):
        first, last = free_span(recording.presses, k)
        here = recording.presses[k]
        span = (max(first, here.start_s - 2.0), min(last, here.end_s + 2.0))
        found[name] = None if seen is None else force_window(forces, here, free_s=span, offset_s=offset_s)
    return found
