"""Statistics of a recording's presses, against which the checks hold each of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tactilevision.certificate.rejection import PressEvidence, RecordingStatistics, interval_at
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.press_track import face_tilt
from tactilevision.contact.bevel import SIDES
from tactilevision.contact.footprint import relief_mm, ring_beside, shared_ring, unevenness_mm
from tactilevision.records import Floats
from tactilevision.robust import mad_std

_DEFAULT_TILT_STD = 0.002  # rad, where too few presses show the tilts' scatter
_MIN_REPEATS = 2  # repeated presses from which the scatter of tilts is taken; benchmarks.certificate
_MAX_RADIUS_OFF = 0.1  # of 1: a larger common error of radii is no habit of the footprint


def recording_statistics(presses: Mapping[str, PressEvidence]) -> RecordingStatistics:
    """Medians over the presses, and the scatter of their tilts."""
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
        (track.indenter.name, ring_beside(track.face_map, face, away_from=SIDES[track.side]))
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
    """Median over the presses of a radius that touched; of all radii where fewer than three did; else NaN.

    How far the gel rises at the bevel depends on the radius.
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
    """Of what is known; 0 where fewer than three are known."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if len(known) >= 3 else 0.0


def _radius_ratios(seen: list[PressEvidence]) -> dict[str, float]:
    """Radius over nominal, by indenter where it has three presses, else of all."""
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
    """Chance that two readings of the free gel, one after the other, are the same number."""
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
    """Scatter (rad) of the faces' tilt towards the bevel from press to press, by the repeats of each indenter.

    Against all presses where none is repeated: a height map that misreads walls tilts by what the depth is.
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
