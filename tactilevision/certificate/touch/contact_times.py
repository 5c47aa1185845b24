"""When each press touched on either clock, and the force then: from the depths at which the bevels touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tactilevision.certificate.force.event_force import EventForce
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.bevel_search import BevelContact
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.certificate.touch.force_crossing import ForceCrossing, event_force, force_crossing
from tactilevision.certificate.touch.press_track import PressTrack, Reconstructs
from tactilevision.certificate.touch.travel_scale import TravelScale
from tactilevision.recording import Recording
from tactilevision.records import Estimate, ForceSeries

_MIN_DWELLS = 3  # dwells from which their scatter can be told; benchmarks.certificate


@dataclass(frozen=True, slots=True, eq=False)
class RecordingMeasurements:
    """Everything gathered from a recording before a press is judged, by press label; `notes` for the reader.

    `clock_outliers` (s): by how much the clocks of single presses are off (`alignment.clock_jumps`).
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
    """One press at its event: what the search found, its crossing on the F/T clock, the touch and the force.

    `stop_std_N`: what a rig that stands still near the touch, not at it, leaves open of the force. `travel_scale`:
    the scale that the event was put on, None: as it was seen.
    """

    bevel_contact: BevelContact
    crossed: ForceCrossing | None
    touch: ContactEvent | None
    event: EventForce | None
    stop_std_N: float = 0.0
    travel_scale: TravelScale | None = None


def contact_times(measurements: RecordingMeasurements) -> dict[str, ContactTimes]:
    """Every press that was searched, at its event."""
    return _with_dwell_scatter(
        measurements,
        {
            name: _time(measurements, name, bevel_contact)
            for name, bevel_contact in measurements.bevel_contacts.items()
        },
    )


def _time(measurements: RecordingMeasurements, name: str, bevel_contact: BevelContact) -> ContactTimes:
    """Touch and force of one press, from the depth at which its bevel touches."""
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
    """With what the stops of the rig scatter by about the touches that the camera sees.

    A dwell stands for the touch as far as the rig stops there each time. What its places scatter by against the
    onsets, beyond the onsets' own errors, is left open; an error that all share cannot be seen so.
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
