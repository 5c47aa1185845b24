"""Frames missing at the event, and events that the travel scale moved away from frames that show them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
from each import each

from tactilevision.press.rejection import PressEvidence, RecordingStatistics, _dropped
from tactilevision.records.measured import ForceSeries

FRAMES_S = np.concatenate([[0.0, 0.6], np.arange(1.5, 1.7, 0.011)])  # few on the way in, dense about the touch
TOUCH_S = 1.53


def reason(event_s: float, seen_s: float) -> str | None:
    force = SimpleNamespace(ramp_N_s=1.0, at=lambda times: times)
    evidence = SimpleNamespace(
        track=SimpleNamespace(time_s=FRAMES_S),
        force=force,
        touch=SimpleNamespace(seen_s=seen_s),
        event=SimpleNamespace(force_N=np.array([0.0, 0.0, 1.0])),
        event_s=event_s,
        offset_s=0.0,
    )
    statistics = SimpleNamespace(interval_s=0.011)
    found = _dropped(
        cast(PressEvidence, evidence), cast(RecordingStatistics, statistics), cast(ForceSeries, SimpleNamespace())
    )
    return None if found is None else found.reason


@each(
    "event_s, seen_s, expected",
    [
        (TOUCH_S, float("nan"), None),
        (1.2, float("nan"), "dropped_frames"),
        (1.49, TOUCH_S, None),
        (1.49, 1.2, "dropped_frames"),
    ],
)
def test_frames_count_where_the_event_was_seen(event_s: float, seen_s: float, expected: str | None) -> None:
    assert reason(event_s, seen_s) == expected
