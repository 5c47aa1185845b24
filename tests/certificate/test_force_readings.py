"""Zero, phases and the force at the event, on ramps whose force is known."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.press.event_force import event_force, force_crossing, force_in_dwell, force_on_ramp
from tactilevision.press.force_readings import Phases, find_phases, find_tare, force_window
from tactilevision.press.rejection import _elsewhere, _force_stopped, _touch_shares, moved_mm
from tactilevision.records.measured import Floats, ForceSeries
from tactilevision.records.rig import Press

STD = np.array([0.00625, 0.00625, 0.0125])


def ramp(rng: np.random.Generator, *, bump: float = 0.0) -> tuple[Floats, Floats]:
    """200 Hz; contact at 1 s, touch of the bevel at 2 s with 1 N, more force of the bevel after it."""
    time = np.arange(0, 3, 0.005)
    depth = np.clip(time - 1, 0, None) + bump * np.sin(12 * np.clip(time - 1, 0, None))
    normal = 0.9 * depth + 0.1 * depth**2 + 2.0 * np.clip(time - 2, 0, None) ** 2
    return time, np.c_[0.02 * normal, 0 * normal, normal] + STD * rng.standard_normal((time.size, 3))


def test_force_on_a_ramp_is_unbiased_and_its_std_honest() -> None:
    errors, stds = [], []
    for seed in range(40):
        found = force_on_ramp(*ramp(np.random.default_rng(seed)), STD, onset_s=1.03, touch_s=2.0)
        assert found is not None
        assert not found.dwell
        errors.append(found.force_N[2] - 1.0)
        stds.append(found.std_N[2])
        assert found.rate_N_s == pytest.approx(1.1, abs=0.1)
    assert np.mean(errors) == pytest.approx(0, abs=0.002)
    assert 0.6 < np.std(errors) / np.mean(stds) < 1.6
    assert np.mean(stds) < 0.004


def test_an_uneven_ramp_is_read_from_its_last_part() -> None:
    true = 0.9 * (1 + 0.03 * np.sin(12)) + 0.1 * (1 + 0.03 * np.sin(12)) ** 2
    errors = []
    for seed in range(20):
        found = force_on_ramp(*ramp(np.random.default_rng(seed), bump=0.03), STD, onset_s=1.03, touch_s=2.0)
        assert found is not None
        errors.append((found.force_N[2] - true) / found.std_N[2])
    assert np.sqrt(np.mean(np.square(errors))) < 2


def test_a_dwell_gives_the_mean_of_two_hundred_readings() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(0, 4, 0.005)
    force = np.array([0.01, 0.0, 1.3]) + STD * rng.standard_normal((time.size, 3))
    found = force_in_dwell(time, force, dwell_s=(0.5, 3.5), event_s=0.5)
    assert found is not None
    assert found.dwell
    assert found.readings == 200
    assert found.force_N[2] == pytest.approx(1.3, abs=4 * 0.0125 / 200**0.5)
    assert found.std_N[2] == pytest.approx(0.0125 / 200**0.5, rel=0.2)


def test_too_short_a_ramp_gives_nothing() -> None:
    assert force_on_ramp(*ramp(np.random.default_rng(0)), STD, onset_s=1.0, touch_s=1.01) is None


def test_zero_that_drifts_is_taken_between_before_and_after() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(0, 10, 0.005)
    zero = np.array([0.1, -0.2, 0.3]) + np.outer(time, [0.0, 0.002, 0.01])
    press = np.where((time > 4) & (time < 6), 1.0, 0.0)
    force = zero + np.c_[0 * press, 0 * press, press] + STD * rng.standard_normal((time.size, 3))
    series = ForceSeries(time, force, (0.00625, 0.00625, 0.0125))
    tare = find_tare(series, (3.9, 6.1), free_s=(0.0, 10.0))
    assert tare.known
    assert tare.at(np.array([5.0]))[0] == pytest.approx([0.1, -0.19, 0.35], abs=0.004)
    assert tare.before_N is not None
    assert tare.after_N is not None
    assert tare.after_N[2] - tare.before_N[2] == pytest.approx(0.01 * (tare.after_s - tare.before_s), abs=0.004)
    only_before = find_tare(series, (3.9, 6.1), free_s=(0.0, 6.0))
    assert only_before.after_N is None
    assert only_before.at(np.array([5.0]))[0][2] == pytest.approx(0.33, abs=0.01)
    assert not find_tare(series, (0.0, 10.0), free_s=(0.0, 10.0)).known


def test_phases_of_a_press() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(0, 4, 0.02)
    depth = np.interp(time, [1, 2, 2.5, 2.8], [0, 0.3, 0.3, 0]) + 0.002 * rng.standard_normal(time.size)
    phases = find_phases(depth)
    assert phases is not None
    names = phases.names(time.size)
    for moment, name in ((0.5, "free"), (1.5, "load"), (2.3, "hold"), (2.65, "unload"), (3.5, "free")):
        assert names[np.searchsorted(time, moment)] == name
    assert time[phases.onset] == pytest.approx(1.03, abs=0.06)
    assert find_phases(0.002 * rng.standard_normal(100)) is None


def stepped(rng: np.random.Generator, *, relaxing: float) -> ForceSeries:
    """Contact at 1 s, 1 N at 2 s, a dwell in which a part relaxes, on to 1.3 times the depth, hold, release."""
    time = np.arange(0, 6, 0.005)
    depth = np.interp(time, [1, 2, 3, 3.3, 4, 4.4], [0, 1, 1, 1.3, 1.3, 0])
    branch = np.zeros_like(depth)
    for i in range(1, time.size):
        branch[i] = (branch[i - 1] + depth[i] - depth[i - 1]) * np.exp(-0.005 / 0.5)
    normal = (1 - relaxing) * depth + relaxing * branch
    force = np.c_[0 * normal, 0 * normal, normal] + STD * rng.standard_normal((time.size, 3)) + 0.2
    return ForceSeries(time, force, (0.00625, 0.00625, 0.0125))


@pytest.mark.parametrize("relaxing", [0.0, 0.1])
def test_a_dwell_is_known_and_what_relaxes_in_it_is_put_back(relaxing: float) -> None:
    series = stepped(np.random.default_rng(0), relaxing=relaxing)
    window = force_window(series, Press("1", "A1", 0.5, 5.0), free_s=(0.0, 6.0), offset_s=0.0)
    assert window is not None
    assert window.ramp_N_s == pytest.approx(1.0, abs=0.12)
    (start, end), hold = window.dwells[0], window.dwells[-1]
    assert window.time_s[[start, end]] == pytest.approx([2.0, 3.0], abs=0.05)
    assert window.time_s[hold[0]] == pytest.approx(3.3, abs=0.06)
    arrived = float(window.drive_N[start])
    assert window.at(np.array([2.5, 2.9])) == pytest.approx([arrived, arrived], abs=0.01)
    assert window.at(np.array([3.3]))[0] - arrived == pytest.approx(0.3, abs=0.03)


def test_an_event_in_a_dwell_is_read_there_and_one_on_the_ramp_is_not() -> None:
    series = stepped(np.random.default_rng(1), relaxing=0.0)
    window = force_window(series, Press("1", "A1", 0.5, 5.0), free_s=(0.0, 6.0), offset_s=0.0)
    assert window is not None
    resting, moving = (
        force_crossing(window, 1.0, level_std_N=0.005),
        force_crossing(window, 0.6, level_std_N=0.005),
    )
    assert resting is not None
    assert moving is not None
    assert resting.time_s == pytest.approx(2.0, abs=0.05)
    assert moving.time_s == pytest.approx(1.6, abs=0.01)
    assert moving.dwell_s is None
    mean, fit = event_force(window, series, crossed=resting), event_force(window, series, crossed=moving)
    assert mean is not None
    assert fit is not None
    assert mean.dwell
    assert mean.force_N[2] == pytest.approx(1.0, abs=0.01)
    assert not fit.dwell
    assert fit.force_N[2] == pytest.approx(0.6, abs=0.012)
    assert force_crossing(window, 2.0, level_std_N=0.005) is None


def test_the_zero_is_read_on_both_sides_though_it_drifts_and_after_a_first_try() -> None:
    """A zero that climbs by 20 mN/s stands out of its own floor; a first touch of .5 s is contact, not a zero."""
    rng, time = np.random.default_rng(2), np.arange(0, 9, 0.005)
    normal = np.interp(time, [2.0, 2.2, 2.5, 2.6, 3.2, 5.0, 5.5, 6.0], [0, 0.6, 0.6, 0, 0, 1, 1, 0])
    drift = 0.3 + 0.02 * time
    force = np.c_[0 * time, 0 * time, normal + drift] + STD * rng.standard_normal((time.size, 3))
    series = ForceSeries(time, force, (0.00625, 0.00625, 0.0125))
    window = force_window(series, Press("1", "A1", 1.9, 6.1), free_s=(0.0, 9.0), offset_s=0.0)
    assert window is not None
    held = (time > 5.05) & (time < 5.45)
    assert window.force_N[held, 2].mean() == pytest.approx(1.0, abs=0.004)


def test_a_press_that_is_recorded_from_its_ramp_on_is_tared_on_the_free_gel_after_it() -> None:
    rng, time = np.random.default_rng(3), np.arange(0, 9, 0.005)
    normal = np.interp(time, [3.2, 5.0, 5.5, 6.0], [0, 1, 1, 0]) + 0.3
    force = np.c_[0 * time, 0 * time, normal] + STD * rng.standard_normal((time.size, 3))
    series = ForceSeries(time, force, (0.00625, 0.00625, 0.0125))
    window = force_window(series, Press("1", "A1", 3.6, 6.1), free_s=(3.6, 9.0), offset_s=0.0)
    assert window is not None
    held = (window.time_s > 5.05) & (window.time_s < 5.45)
    assert window.tare.before_N is None
    assert window.force_N[held, 2].mean() == pytest.approx(1.0, abs=0.004)


def _stopped(
    way: tuple[list[float], list[float]],
    wrong_mm: Callable[[Floats, Floats], Floats],
    *,
    rail_N: float,
    slope_N_per_mm: float,
    rate_Hz: float,
) -> bool:
    """Whether a press along a `way` (times in s, depths in mm) has a force that stops; its face is read off by
    `wrong_mm` of frames' times and depths.
    """
    rng, end = np.random.default_rng(4), way[0][-1] + 1.0
    clock, frames = np.arange(0.0, end, 0.005), np.arange(0.0, end, 1 / rate_Hz)
    normal = np.minimum(slope_N_per_mm * np.interp(clock, *way), rail_N) + 0.01 * rng.standard_normal(clock.size)
    force: Any = SimpleNamespace(time_s=clock, smooth_N=normal, phases=find_phases(normal))
    depth = np.interp(frames, *way)
    seen = depth + wrong_mm(frames, depth) + 0.002 * rng.standard_normal(frames.size)
    evidence: Any = SimpleNamespace(track=SimpleNamespace(time_s=frames, depth_mm=seen), offset_s=0.0)
    return _force_stopped(evidence, force) is not None


@pytest.mark.parametrize(
    ("rail_N", "wrong_out_mm", "stopped"), [(9.0, 0.0, False), (9.0, 0.3, False), (1.4, 0.0, True)]
)
def test_a_wall_read_wrongly_on_the_way_out_is_no_force_that_has_stopped(
    rail_N: float, wrong_out_mm: float, stopped: bool
) -> None:
    """A face of .5 mm under 2 N, in and out at .25 mm/s; beside shadows its wall may be read 60 % too deep."""
    way = ([1.0, 3.0, 3.5, 5.5], [0.0, 0.5, 0.5, 0.0])

    def wrong_mm(time_s: Floats, _: Floats) -> Floats:
        return np.asarray(wrong_out_mm * ((time_s > 3.55) & (time_s < 3.9)), dtype=np.float64)

    assert _stopped(way, wrong_mm, rail_N=rail_N, slope_N_per_mm=4.0, rate_Hz=15.0) is stopped


@pytest.mark.parametrize("rail_N", [9.0, 0.7])
def test_a_wall_read_now_one_way_now_the_other_is_no_face_that_goes_deeper(rail_N: float) -> None:
    """In a hold, four of ten frames read the wall 45 % deeper, as beside shadows."""
    way, rng = ([1.0, 2.3, 2.8, 4.1], [0.0, 0.33, 0.33, 0.0]), np.random.default_rng(6)

    def wrong_mm(time_s: Floats, depth: Floats) -> Floats:
        return np.asarray(depth * np.where((time_s > 2.3) & (rng.random(time_s.size) < 0.4), 0.45, 0.0))

    assert _stopped(way, wrong_mm, rail_N=rail_N, slope_N_per_mm=4.1, rate_Hz=30.0) is (rail_N < 2)


@each(
    "sigmas, at_mm, named",
    [(6.0, 0.38, True), (6.0, 0.45, False), (14.0, 0.38, False), (9.0, 0.53, True), (30.0, 0.31, True)],
)
def test_a_touch_far_from_where_the_others_touch_is_none(sigmas: float, at_mm: float, named: bool) -> None:
    onset: Any = SimpleNamespace(at=at_mm, std=0.004, gain=sigmas**2)
    finding = _elsewhere(onset, 0.5, usual=0.917)
    assert (finding is not None) is named
    assert finding is None or (finding.reason == "bevel_not_touched" and f"{sigmas:.1f} sigma" in finding.text)
    assert _elsewhere(onset, 0.5, usual=float("nan")) is None


def test_zeros_of_gentle_presses_may_lie_apart_and_radii_touch_each_at_their_own_depth() -> None:
    gentle: Any = SimpleNamespace(at=0.127, std=0.0005, gain=36.0)
    assert _elsewhere(gentle, 0.15, usual=0.917) is None, "11 um off"
    deep: Any = SimpleNamespace(at=0.505, std=0.0005, gain=36.0)
    assert _elsewhere(deep, 0.6, usual=0.917) is not None, "as large a part of a deep one is 45 um"

    def press(radius_mm: float, share: float, gain: float = 400.0) -> Any:
        indenter = SimpleNamespace(radius_mm=radius_mm, height_mm=0.4)
        onset = SimpleNamespace(at=0.4 * share, gain=gain)
        return SimpleNamespace(track=SimpleNamespace(indenter=indenter), touch=SimpleNamespace(onset=onset))

    made = [press(2.5, share) for share in (0.90, 0.91, 0.92, 0.93)] + [press(4.0, 0.80), press(4.0, 0.82)]
    assert _touch_shares(made) == pytest.approx({2.5: 0.915, 4.0: 0.905}), "two do not tell their own"
    assert _touch_shares([*made, press(4.0, 0.81)])[4.0] == pytest.approx(0.81)
    assert np.isnan(_touch_shares([press(2.5, 0.9), press(2.5, 0.9, gain=0.0)])[2.5])


def test_a_ramp_between_two_frames_tells_no_pace() -> None:
    """The frames jump from the free gel to the hold: what grows then may be the face."""
    frames = np.array([0.0, 0.1, 0.2, 0.3, 2.0, 2.1, 2.2, 2.3, 2.4, 2.5, 2.6])
    depth = np.array([0.0, 0.0, 0.0, 0.0, 0.30, 0.32, 0.34, 0.36, 0.38, 0.40, 0.40])
    track: Any = SimpleNamespace(time_s=frames, depth_mm=depth)
    assert moved_mm(track, 4, until=10, phases=Phases(4, 4, 10, 11, 0.001)) == pytest.approx(0.08, abs=0.021)


# read of presses at .3 mm/s and 12 frames/s, in um: from frame 17 on two hold still, and one goes on to .69 mm
HOLDS_40 = "0 8 32 57 81 106 125 148 173 194 230 256 286 323 363 394 344 363 485 366 468 473 365 364"
HOLDS_45 = "0 14 39 64 88 117 150 183 222 274 338 376 409 472 522 555 339 534 372 482 380 494 526 506 381 508"
HOLDS_44 = "0 21 46 72 96 126 152 178 207 236 267 300 333 372 395 440 357 438 439 442 436"  # from frame 15 on
GOES_ON = (
    "0 24 47 71 94 117 142 162 186 208 245 278 308 336 379 408 456 480 396 554 559 596 469 653 654 720 539 555 "
    "734 767 741 580 768 713 780"
)


@each(
    "read_um, still, deeper",
    [(HOLDS_40, 17, False), (HOLDS_45, 17, False), (HOLDS_44, 15, False), (GOES_ON, 17, True)],
)
def test_a_wall_read_two_ways_goes_deeper_in_both_where_the_face_does(
    read_um: str, still: int, deeper: bool
) -> None:
    depth = 1e-3 * np.array(read_um.split(), dtype=float)
    track: Any = SimpleNamespace(time_s=np.arange(depth.size) / 12, depth_mm=depth)
    phases = Phases(1, still, depth.size - 1, depth.size, 0.001)
    moved = moved_mm(track, still, until=depth.size, phases=phases)
    assert bool(moved > 0.15 * depth.max()) is deeper, moved
