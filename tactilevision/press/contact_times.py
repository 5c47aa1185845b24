"""Determine the contact times of all presses from the travel scale and the bevel contact depths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tactilevision.press.bevel_contact import DETECTION_CHI2, BevelContact, ContactEvent
from tactilevision.press.event_force import EventForce, ForceCrossing, event_force, force_crossing
from tactilevision.press.force_readings import ForceWindow
from tactilevision.press.track import PressTrack, Reconstructs
from tactilevision.recording.model import Recording
from tactilevision.records.measured import Bools, Estimate, Floats, ForceSeries
from tactilevision.robust import mad_std

# Travel of the approach as a measure of depth, fitted to the heights at which the bevels touch.
#
#     z_i = alpha w_i + s P_i + b t_i + delta + e_i
#
# z_i is the travel of press i (mm) from the zero of force to the observed contact event, from the stage or else
# from stated speed times time. w_i is the depth that the bevel certifies (mm), P_i the force then (N). alpha is
# the speed's scale, 1 for a stage; s the rig's compliance (mm/N). delta is the common detection delay of all
# events (mm), e_i the error of each. t_i is the lowering of the bevel by the tilt that the camera reads, relative
# to the median; b, about 0 to 1, is the weight of that reading.
#
# At constant pace z measures depth from the gel's surface. delta does not grow with depth, so different heights
# separate it from alpha. The shape of the growing dent bounds delta, the stiffness of rigs bounds s. The force is
# then read at alpha w_i + s P_i in all presses.
#
# Generalised least squares. Faces that tilt by more than the camera detects increase the scatter of the events.
# Individual errors are then enlarged until chi-square is right (Birge, Phys. Rev. 40 (1932) 207); shared ones are
# not. With a much larger scatter, and no other evidence of even paces, there is no scale.

RIG_COMPLIANCE_MM_PER_N = 0.005  # mm/N, one sigma: rigs with their F/T sensors stand at 200 N/mm or so
STAGE_STD = 0.005  # of 1, one sigma of a motion stage's scale
_MIN_COUNT = 3  # events, where the scale is not known beforehand; tests.certificate.test_travel_scale
_MIN_HEIGHTS = 2  # machined heights among them; tests.certificate.test_travel_scale
_TILT_TRUST_STD = 1.0  # of 1, one sigma of b; tests.certificate.test_travel_scale
_MAX_ITERATIONS = 8  # of enlarging errors, until chi-square is right; test_travel_scale
_MIN_SPREAD = 0.25  # of the largest depth, that the heights must differ by; test_travel_scale
_OUTLIER_SIGMA = 4.0  # beyond which a contact event is an outlier; test_travel_scale
_MAX_CHI2 = 9.0  # per degree of freedom: beyond it ramps not known to be even are no scale; test_travel_scale


@dataclass(frozen=True, slots=True)
class TravelPoint:
    """One contact event on the travel scale: certified depth, travel until detection, force.

    `own_std_mm` is its own std, `shared_std_mm` that common to all, of which `zero_std_mm` is the travel's zero.
    `height` names the shared machined height, `height_std_mm` its std; `tilt_shift_mm`: lowering of the bevel by
    the face's tilt, as read.
    """

    depth_mm: float
    travel_mm: float
    own_std_mm: float
    shared_std_mm: float
    force_N: float
    height: str
    height_std_mm: float
    tilt_shift_mm: float = 0.0
    zero_std_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class TravelScale:
    """alpha, s, b and their covariance (3, 3); `used` points (N,); `delay_mm` and its std: delta.

    `zero_std_mm`: common error of all depths on the scale, from its zero.
    """

    alpha: float
    compliance_mm_per_N: float
    covariance: Floats
    used: Bools
    delay_mm: float
    delay_std_mm: float
    zero_std_mm: float

    def travel_mm(self, depth_mm: float, force_N: float) -> float:
        """Return the travel (mm) at a depth and a force."""
        return self.alpha * depth_mm + self.compliance_mm_per_N * force_N

    def relative_std(self, stiffness_N_per_mm: float) -> float:
        """Return the common relative std of the scale's depths, for this initial stiffness."""
        slope = np.array([1.0, stiffness_N_per_mm, 0.0])
        whole = self.alpha + self.compliance_mm_per_N * stiffness_N_per_mm
        return float(np.sqrt(slope @ self.covariance @ slope)) / whole


def fit_travel_scale(
    points: Sequence[TravelPoint], *, scale: float | None = None, even: bool = False
) -> TravelScale | None:
    """Return the travel scale of these events; None where they are too few, too similar, or on no scale.

    `scale` is alpha where it is known, to STAGE_STD; `even`: forces follow one law of the travel.
    """
    used = np.ones(len(points), dtype=bool)
    while True:
        chosen = [point for point, use in zip(points, used, strict=True) if use]
        depths = [point.depth_mm for point in chosen]
        if not chosen:
            return None
        few = len(chosen) < _MIN_COUNT or len({point.height for point in chosen}) < _MIN_HEIGHTS
        if scale is None and (few or np.ptp(depths) < _MIN_SPREAD * max(depths)):
            return None
        found, apart = _solve(chosen, used, scale, np.inf if even else _MAX_CHI2)
        worst = int(np.abs(apart).argmax())
        if abs(apart[worst]) < _OUTLIER_SIGMA:
            return found
        used[np.flatnonzero(used)[worst]] = False


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """alpha, s, b, their covariance (3, 3), the touches' (N, N); white residuals, chi-square per freedom."""

    answer: Floats
    inverse: Floats
    design: Floats
    held: Floats
    covariance: Floats
    weighed: Floats
    apart: Floats
    birge: float


def _solve(
    points: Sequence[TravelPoint], used: Bools, scale: float | None, limit: float
) -> tuple[TravelScale | None, Floats]:
    """Return the scale, and each event's deviation (N,) from the others' prediction, in median sigmas."""
    found = _least_squares(points, scale, 1.0)
    scatter_unit = max(mad_std(found.apart, centre=0.0), 1.0)
    apart = found.apart / scatter_unit
    if found.birge > limit and float(np.abs(apart).max()) < _OUTLIER_SIGMA:
        return None, np.zeros(len(points))
    scatter = 1.0
    for _ in range(_MAX_ITERATIONS):
        if found.birge <= 1:
            break
        scatter *= float(np.sqrt(found.birge))
        found = _least_squares(points, scale, scatter)
    pace = _pace(points)
    shared = np.array([point.shared_std_mm for point in points])
    delay = float(shared @ found.weighed) * float(np.median(shared)) / pace
    delay_std = _delay_std(found.covariance, found.design, found.held, shared) / pace
    zero = float(np.median([point.zero_std_mm for point in points])) / pace
    alpha, compliance, _ = (float(value) for value in found.answer)
    return TravelScale(
        alpha, compliance, found.inverse * max(found.birge, 1.0), used.copy(), delay, delay_std, zero
    ), apart


def _pace(points: Sequence[TravelPoint]) -> float:
    """Return an approximate ratio of travel to depth."""
    return float(np.median([point.travel_mm / point.depth_mm for point in points]))


def _least_squares(points: Sequence[TravelPoint], scale: float | None, scatter: float) -> _Solution:
    """Return the least-squares solution with errors of touches and heights `scatter` times as large as stated."""
    depth, travel, own, shared, force, height_std, tilt_shift = np.array(
        [
            (m.depth_mm, m.travel_mm, m.own_std_mm, m.shared_std_mm, m.force_N, m.height_std_mm, m.tilt_shift_mm)
            for m in points
        ]
    ).T
    alike = np.array([[a.height == b.height for a in points] for b in points])
    pace = _pace(points)
    apart = np.diag(own**2) + alike * np.outer(height_std, height_std) * pace**2
    covariance = scatter**2 * apart + np.outer(shared, shared)
    weight = np.linalg.inv(covariance)
    design = np.column_stack([depth, force, tilt_shift])
    expected = np.array([scale or 0.0, 0.0, 0.0])
    held = np.array(
        [
            0.0 if scale is None else (scale * STAGE_STD) ** -2,
            (pace * RIG_COMPLIANCE_MM_PER_N) ** -2,
            (pace * _TILT_TRUST_STD) ** -2,
        ]
    )
    inverse = np.linalg.inv(design.T @ weight @ design + np.diag(held))
    answer = inverse @ (design.T @ weight @ travel + held * expected)
    residual = travel - design @ answer
    square = float(residual @ weight @ residual) + float(held @ (answer - expected) ** 2)
    # leave-one-out error of each touch, from the inverse covariance
    weighed = weight @ residual
    return _Solution(answer, inverse, design, held, covariance, weighed, weighed / np.sqrt(np.diag(weight)),
                     square / max(len(points) - (scale is None), 1))  # fmt: skip


def _delay_std(covariance: Floats, design: Floats, held: Floats, shared: Floats) -> float:
    """Return the std of delta, by the joint fit of alpha, s, b and delta."""
    rest = np.linalg.inv(covariance - np.outer(shared, shared))
    whole = np.column_stack([design, np.ones(len(shared))])
    normal = whole.T @ rest @ whole + np.diag([*held, float(np.median(shared)) ** -2])
    return float(np.sqrt(np.linalg.inv(normal)[-1, -1]))


# The touch time of each press on either clock, and the force then: from the depths at which the bevels touch.

_MIN_DWELLS = 3  # dwells from which their scatter is determined; benchmarks.certificate


@dataclass(frozen=True, slots=True, eq=False)
class RecordingMeasurements:
    """Measurements of a recording before its presses are judged, by press label; `notes` for the reader.

    `clock_outliers` (s): clock offsets of single presses (`clock_jumps`).
    """

    recording: Recording
    reconstructor: Reconstructs
    tracks: Mapping[str, PressTrack | None]
    windows: Mapping[str, ForceWindow | None]
    offset: Estimate
    bevel_contacts: Mapping[str, BevelContact]
    rest_s: Mapping[str, float]
    notes: tuple[str, ...] = ()
    clock_outliers: Mapping[str, float] = field(default_factory=dict)

    @property
    def forces(self) -> ForceSeries:
        assert self.recording.forces is not None
        return self.recording.forces

    @property
    def offset_s(self) -> float:
        return self.offset.value or 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ContactTimes:
    """One press at its event: the search result, its crossing on the F/T clock, the touch and the force.

    `stop_std_N`: std of the force where the rig stands still near the touch, not at it. `travel_scale`: the scale
    on which the event was placed, None: as detected.
    """

    bevel_contact: BevelContact
    crossed: ForceCrossing | None
    touch: ContactEvent | None
    event: EventForce | None
    stop_std_N: float = 0.0
    travel_scale: TravelScale | None = None


def contact_times(measurements: RecordingMeasurements) -> dict[str, ContactTimes]:
    """Return every press that was searched, at its event."""
    return _with_dwell_scatter(
        measurements,
        {
            name: _time(measurements, name, bevel_contact)
            for name, bevel_contact in measurements.bevel_contacts.items()
        },
    )


def _time(measurements: RecordingMeasurements, name: str, bevel_contact: BevelContact) -> ContactTimes:
    """Return the touch and force of one press, from the depth at which its bevel touches."""
    onset, window, track = bevel_contact.onset, measurements.windows[name], bevel_contact.press_signal.track
    if onset is None or window is None:
        return ContactTimes(bevel_contact, None, None, None)
    level = float(bevel_contact.law.force(onset.at))
    stiffness = float(bevel_contact.law.force(onset.at + 1e-3) - level) / 1e-3
    crossed = force_crossing(window, level, level_std_N=stiffness * onset.std)
    if crossed is None:
        return ContactTimes(bevel_contact, None, None, None)
    time_s = crossed.time_s - measurements.offset_s
    seen = float(np.interp(time_s, track.time_s, track.depth_mm))
    std_s = float(np.hypot(crossed.std_s, measurements.offset.std or 0.0))
    touch = ContactEvent(time_s, std_s, seen, bevel_contact.channel, onset)
    event = event_force(window, measurements.forces, crossed=crossed) if onset.gain > DETECTION_CHI2 else None
    return ContactTimes(bevel_contact, crossed, touch, event)


def _with_dwell_scatter(
    measurements: RecordingMeasurements, events: dict[str, ContactTimes]
) -> dict[str, ContactTimes]:
    """Return the presses with the scatter of the rig's stops about the touches that the camera detects.

    A dwell represents the touch as far as the rig stops there each time. The scatter of dwells about the onsets
    beyond
    the onsets' own errors adds to the std; a common error is not detectable.
    """
    apart: dict[str, tuple[float, float, float]] = {}
    for name, one in events.items():
        onset, window = one.bevel_contact.onset, measurements.windows[name]
        if one.event is None or not one.event.dwell or one.crossed is None or onset is None or window is None:
            continue
        there = window.at(np.array([one.crossed.time_s]))
        law, own = one.bevel_contact.law, max(onset.std**2 - onset.shared_std**2, 0.0)
        stiffness = float(law.force(onset.at + 1e-3) - law.force(onset.at)) / 1e-3
        apart[name] = (onset.at - float(law.depth(there)[0]), own, stiffness)
    if len(apart) < _MIN_DWELLS:
        return events
    distance, own, _ = np.array(list(apart.values())).T
    open_mm = float(np.sqrt(max(distance.var(ddof=1) - own.mean(), 0.0)))
    return {
        name: replace(one, stop_std_N=open_mm * apart[name][2]) if name in apart else one
        for name, one in events.items()
    }
