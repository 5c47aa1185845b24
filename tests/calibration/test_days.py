"""On which day a press was made: by its clock, by its own date, or by its recording's."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np
from made_recordings import points_of

from calibration.inputs.gather import observe_points
from calibration.inputs.observations import DAY_S, Measured
from calibration.tasks.diagnose import diagnose
from tactilevision.records.rig import Press

HEIGHTS = np.repeat([0.15, 0.3, 0.45, 0.6], 3)


def made(date: datetime.date | None, E: float = 0.2, seed: int = 0) -> Measured:
    """Twelve points without a time: P/w = 16.6 E (1 + .85 w/h) N/mm at four heights, read to two mN."""
    rng = np.random.default_rng(seed)
    force = 16.6 * E * HEIGHTS * (1 + 0.85 * HEIGHTS / 3) * (1 + 0.003 * rng.standard_normal(12))
    one = points_of(HEIGHTS, force + 0.002 * rng.standard_normal(12))
    return replace(one, recording=replace(one.recording, date=date))


def timed(one: Measured, time_s: list[float], dates: list[str]) -> Measured:
    """The same with clocks, and dates in the protocol."""
    points = tuple(replace(p, time_s=t) for p, t in zip(one.points, time_s, strict=False))
    presses = tuple(Press(p.press, "A", 0, 1, date=d) for p, d in zip(points, dates, strict=True))
    recording = replace(one.recording, presses=presses)
    return replace(one, points=points, recording=recording)


def test_recordings_without_clocks_are_dated_by_their_date_and_ordered_by_it() -> None:
    late, early = made(datetime.date(2026, 11, 20)), made(datetime.date(2026, 11, 2))
    data = observe_points([late, early])
    np.testing.assert_allclose(data.presses.day, np.repeat([0.0, 18.0], 12))
    assert data.presses.recording.tolist() == [1] * 12 + [0] * 12


def test_a_clock_that_starts_anew_each_day_gives_way_to_the_dates() -> None:
    dates = ["2026-11-02"] * 2 + ["2026-11-09"] * 2
    again = timed(made(datetime.date(2026, 11, 2)), [10, 400, 10, 400], dates)
    np.testing.assert_allclose(observe_points(again).presses.day, [0, 0, 7, 7], atol=0.01)
    on = timed(made(datetime.date(2026, 11, 2)), [10, 400, 7 * DAY_S + 10, 7 * DAY_S + 400], dates)
    expected = [10 / DAY_S, 400 / DAY_S, 7 + 10 / DAY_S, 7 + 400 / DAY_S]
    np.testing.assert_allclose(observe_points(on).presses.day, expected)


def test_points_taken_weeks_apart_show_a_gel_that_ages() -> None:
    """E grows by .06 for each e-fold of age, t0 = 7 days; no point has a time of its own."""
    days = (2, 9, 16, 23, 30)
    sets = [
        made(datetime.date(2026, 11, day), 0.2 * (1 + 0.06 * np.log1p((day - 2) / 7)), seed=day) for day in days
    ]
    found = diagnose(observe_points(sets), np.random.default_rng(0))
    assert [named.key for named in found.effects] == ["ageing"]
    interval = dict(found.effects[0].parameters)["rate"].interval95
    assert interval is not None
    assert interval[0] < 0.06 < interval[1]
