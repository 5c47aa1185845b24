"""What is usual in a recording: the yardstick of the checks that compare one press with the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tactilevision.certificate.rejection import PressEvidence, RecordingStatistics, face_tilt, interval_at
from tactilevision.contact.bevel import SIDES
from tactilevision.contact.footprint import relief_mm, unevenness_mm
from tactilevision.records import Floats
from tactilevision.robust import mad_std

_UNTRIED = 0.002  # rad: scatter of the tilts where too few presses show it
_REPEATS = 2  # from which their scatter is taken
_DOUBTFUL = 0.1  # a common radius error beyond this is no habit of the footprint: then the stated radius counts


def recording_statistics(looks: Mapping[str, PressEvidence]) -> RecordingStatistics:
    """Medians over the presses, and the scatter of their tilts."""
    seen = [look for look in looks.values() if look.track.footprint is not None]
    tilts = np.array([face_tilt(look.track) for look in seen]).reshape(-1, 2)
    tilts = tilts[np.isfinite(tilts).all(axis=1)]
    tilt, scatter = np.zeros(2), _UNTRIED
    if len(tilts) >= 3:
        tilt = np.median(tilts, axis=0)
        scatter = mad_std(np.hypot(*(tilts - tilt).T), centre=0.0) / np.sqrt(2)
    intervals = [
        interval_at(look.track.time_s, look.event_s) for look in looks.values() if np.isfinite(look.event_s)
    ]
    finite = [gap for gap in intervals if np.isfinite(gap)]
    faces = [(look.track, face) for look in seen if (face := look.track.footprint) is not None]
    uneven = [unevenness_mm(track.face_map, face, away_from=SIDES[track.side]) for track, face in faces]
    relief = [relief_mm(track.face_map, face) for track, face in faces]
    rest = [look.rest_s for look in looks.values() if np.isfinite(look.rest_s)]
    return RecordingStatistics(
        radius=_radius_ratios(seen),
        tilt=np.asarray(tilt),
        tilt_scatter=scatter,
        interval_s=float(np.median(finite)) if finite else float("inf"),
        rest_s=float(np.median(rest)) if rest else 0.0,
        equal=_equal(looks),
        uneven_mm=_median(uneven),
        relief_mm=_median(relief),
    )


def _median(values: Sequence[float]) -> float:
    """Of what is known; 0 where too few tell what is usual."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if len(known) >= 3 else 0.0


def _radius_ratios(seen: list[PressEvidence]) -> dict[str, float]:
    """Radius over nominal, by indenter where it has three presses, else of all."""
    by_name: dict[str, list[float]] = {}
    for look in seen:
        face, indenter = look.track.footprint, look.track.indenter
        if face is not None and np.isfinite(indenter.radius_mm):
            by_name.setdefault(indenter.name, []).append(face.radius_mm / indenter.radius_mm)
    everything = [ratio for ratios in by_name.values() for ratio in ratios]
    common = float(np.median(everything)) if len(everything) >= 3 else 1.0
    usual = {name: float(np.median(r)) if len(r) >= 3 else common for name, r in by_name.items()}
    return {name: ratio if abs(ratio - 1) < _DOUBTFUL else 1.0 for name, ratio in usual.items()}


def _equal(looks: Mapping[str, PressEvidence]) -> float:
    """Chance that two readings of the free gel, one after the other, are the same number."""
    shares: list[float] = []
    for look in looks.values():
        if look.force is None or look.force.phases is None:
            continue
        free: Floats = look.force.force_N[: look.force.phases.onset] + look.force.tare.at(
            look.force.time_s[: look.force.phases.onset]
        )
        if len(free) > 20:
            shares += [float((np.abs(np.diff(free, axis=0)) < 1e-9).mean(axis=0).max())]
    return float(np.clip(np.median(shares), 0.05, 0.9)) if shares else 0.6


def lean_scatter(looks: Sequence[PressEvidence], usual: RecordingStatistics) -> float:
    """What faces lean by towards the bevel from press to press, rad, by the repeats of each indenter.

    Against all presses where none is repeated: a height map that misreads walls leans by what the depth is.
    """
    leans: dict[str, list[float]] = {}
    for look in looks:
        lean = float(face_tilt(look.track) @ np.array(SIDES[look.track.side]))
        if look.track.footprint is not None and np.isfinite(lean):
            leans.setdefault(look.track.indenter.name, []).append(lean)
    freedom = sum(len(group) - 1 for group in leans.values())
    if freedom < _REPEATS:
        return usual.tilt_scatter
    return float(np.sqrt(sum(np.var(group) * len(group) for group in leans.values()) / freedom))
