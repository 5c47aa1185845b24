"""How far a press has come since its face met the gel: by the motion stage, or by pace times time.

z(t) = stage(t) - stage(t0), or speed times the time that the rig has moved since t0, the zero of force
(contact_point.py). Times on the F/T sensor's clock, lengths in mm. What the rig gives under the force is part of
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.certificate.force.contact_point import ContactPoint, contact_point, moving_s, top_s
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.recording import StageSeries
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True, eq=False)
class IndenterTravel:
    """`travel_mm` (T,) at `time_s` (T,) from first contact to the top, never falling; `pace_mm_s` while it moves.

    `std_mm` of its zero by itself, `shared_mm` of all zeros alike.
    """

    time_s: Floats
    travel_mm: Floats
    pace_mm_s: float
    std_mm: float
    shared_mm: float = 0.0

    def at(self, time_s: float) -> float:
        """Travel at a time."""
        return float(np.interp(time_s, self.time_s, self.travel_mm))

    def reached_s(self, travel_mm: float) -> float:
        """When a travel was first reached; the last time where it never was."""
        place = int(np.searchsorted(self.travel_mm, travel_mm))
        if place == 0 or place == self.time_s.size:
            return float(self.time_s[min(place, self.time_s.size - 1)])
        return float(
            np.interp(travel_mm, self.travel_mm[place - 1 : place + 1], self.time_s[place - 1 : place + 1])
        )


def first_contact(window: ForceWindow, touch_s: float) -> ContactPoint | None:
    """First contact, looked for up to the rig's first stop, or to the touch at `touch_s`; None: not to be told."""
    if window.phases is None:
        return None
    onset = float(window.time_s[window.phases.onset])
    stops = [float(window.time_s[first]) for first, _ in window.dwells]
    return contact_point(window, min([stop for stop in stops if stop > onset] + [touch_s]))


def indenter_travel(
    window: ForceWindow, begun: ContactPoint, *, stage: StageSeries | None, pace_mm_s: float
) -> IndenterTravel | None:
    """The travel of one press since its first contact; None where neither stage nor pace is known, or where the
    stage still approached faster than it pressed.
    """
    end = top_s(window)
    inside = window.time_s[(window.time_s > begun.time_s) & (window.time_s < end)]
    times = np.concatenate([[begun.time_s], inside, [max(end, begun.time_s)]])
    if stage is not None and stage.time_s[0] <= times[0] and times[-1] <= stage.time_s[-1]:
        if _still_approaching(stage, times[0], times[-1]):
            return None
        place = np.interp(times, stage.time_s, stage.z_mm)
        travel = np.maximum.accumulate(place - place[0])
    elif np.isfinite(pace_mm_s):
        travel = pace_mm_s * moving_s(window, begun.time_s, time_s=times)
    else:
        return None
    moved = moving_s(window, begun.time_s, time_s=times[-1:])[0]
    pace = float(travel[-1]) / max(float(moved), 1e-9)
    if not pace > 0:
        return None
    return IndenterTravel(
        times, np.asarray(travel, dtype=np.float64), pace, pace * begun.std_s, pace * begun.shared_s
    )


def _still_approaching(stage: StageSeries, begun_s: float, end_s: float) -> bool:
    """Whether the stage moves further between two readings about first contact than ever on the way in.

    Its place at first contact, the zero of the travel, lies then anywhere between those readings.
    """
    step = np.abs(np.diff(stage.z_mm))
    first = int(np.searchsorted(stage.time_s, begun_s))
    last = int(np.searchsorted(stage.time_s, end_s))
    about, later = step[max(first - 2, 0) : first + 1], step[first + 1 : last]
    return bool(later.size and about.size and about.max() > 2 * later.max())
