"""Frames and forces of a recording to its certificate.

track each press -> align the clocks -> tare -> find all contact events together -> pile-up, depth, force -> check
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from tactilevision.certificate.assemble import assemble_certificate
from tactilevision.certificate.certificate import Certificate
from tactilevision.certificate.clock.alignment import (
    PressDepths,
    clock_jump_warnings,
    clock_jumps,
    correlation_offset,
    estimate_offset,
    parabola_offset,
    stated_offset_warnings,
)
from tactilevision.certificate.clock.repeated_frames import allow_for_repeats, note_repeats, repeated_share
from tactilevision.certificate.force.tare import subtract_tares
from tactilevision.certificate.force.window import ForceWindow, force_window
from tactilevision.certificate.rejection import rests
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.bevel_search import BevelContact, search_bevel_contacts
from tactilevision.certificate.touch.compressed_frames import compression_warnings, late_std_mm, note_blocks
from tactilevision.certificate.touch.contact_times import RecordingMeasurements
from tactilevision.certificate.touch.press_track import PressTrack, Reconstructs, track
from tactilevision.contact.footprint import find_footprint
from tactilevision.errors import RecordingError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.recording import BadFrame, Recording, iter_frames, require
from tactilevision.records import Estimate, Footprint, ForceSeries, Gel, Indenter, Press

Progress = Callable[[int, int], None]
_LONG = 250  # frames of a press beyond which their maps are not kept
_TRIAL_FRAMES = 12  # frames of a long press in which the face is searched first
_SILICONE = 0.48  # Poisson's ratio, to tell how much harder a wider punch presses
_MARGIN_S = 0.5  # s of free gel wanted before and after the press that the table names; benchmarks.certificate


def certify(recording: Recording, reconstructor: Reconstructs, *, progress: Progress | None = None) -> Certificate:
    """Certified depth and force of every press of a recording that has frames and forces.

    `progress(done, of)` is called after each press. Frames are streamed, one press at a time in memory.
    Raises RecordingError where frames, their times, forces or presses are missing, or an indenter is not
    described.
    """
    require_all(recording)
    repeats: list[float] = []
    blocks: list[float] = []
    tracks = _track_all(recording, reconstructor, progress or (lambda done, of: None), repeats, blocks)
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
    rest_s = dict(zip(tracks, rests(recording.presses), strict=True))
    return assemble_certificate(
        RecordingMeasurements(
            recording, reconstructor, tracks, windows, offset, bevel_contacts, rest_s, notes, clock_outliers
        )
    )


def require_all(recording: Recording) -> None:
    """Raise RecordingError for what a certificate needs and the recording lacks, before any work is done."""
    require(recording, "frames", "frame_times", "forces", "presses", "indenters", step="certifying the presses")


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
        progress(k + 1, len(recording.presses))
    return found


def _look_ahead(
    recording: Recording, reconstructor: Reconstructs, span_s: tuple[float, float], indenter: Indenter
) -> Footprint | None:
    """Where the face is in the deepest of a few frames of a long press; None for a short one."""
    times = recording.frame_times_s
    rows = np.flatnonzero((times >= span_s[0]) & (times <= span_s[1]))
    if rows.size <= _LONG:
        return None
    best, top = None, 0.0
    for row in rows[np.linspace(0, rows.size - 1, _TRIAL_FRAMES).astype(int)]:
        frame = next(iter_frames(recording, float(times[row]), end_s=float(times[row])))
        face = None if isinstance(frame, BadFrame) else find_footprint(reconstructor.height_map(frame), indenter)
        if face is not None and face.depth_mm > top:
            best, top = face, face.depth_mm
    return best


def free_span(presses: Sequence[Press], k: int) -> tuple[float, float]:
    """From the end of the press before to the start of the one after."""
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
    """The presses for the clocks, by label; the depth that the camera read at the touch is where the force passed
    through it.
    """
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
