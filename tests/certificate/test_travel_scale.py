"""The ramp as a ruler: planted scales, offsets, gives and wrong heights come back, with honest errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactilevision.press.contact_times import TravelPoint, fit_travel_scale
from tactilevision.press.force_readings import contact_point, force_window, moving_s, top_s
from tactilevision.press.indenter_travel import first_contact, indenter_travel
from tactilevision.recording.model import StageSeries
from tactilevision.records.measured import ForceSeries
from tactilevision.records.rig import Press

HEIGHTS = (0.15, 0.3, 0.4, 0.5, 0.6)
C, BETA, THICKNESS = 3.8, 0.85, 3.0
OWN, TOGETHER, MACHINED = 0.0015, 0.004, 0.001


def force_of(depth: float) -> float:
    return C * depth * (1 + BETA * depth / THICKNESS)


def marks(rng: np.random.Generator, *, late: float, alpha: float = 1.02, give: float = 0.0) -> list[TravelPoint]:
    """Three presses at each height, seen `late` mm behind, each with an error of its own."""
    found = []
    for k, height in enumerate(HEIGHTS):
        true = height / 1.1 + MACHINED * rng.standard_normal()
        for _ in range(3):
            seen = alpha * true + give * force_of(true) + late + OWN * rng.standard_normal()
            found.append(TravelPoint(height / 1.1, seen, OWN, TOGETHER, force_of(true), f"A{k}", MACHINED))
    return found


def test_the_ruler_does_not_follow_touches_that_are_all_seen_late() -> None:
    errors, scale = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        late = float(rng.normal(0, TOGETHER))
        ruler = fit_travel_scale(marks(rng, late=late))
        assert ruler is not None
        assert ruler.used.all()
        slope, true = ruler.alpha + ruler.compliance_mm_per_N * C, 1.02
        errors.append((slope / true - 1) / ruler.relative_std(C))
        scale.append(ruler.relative_std(C))
        assert abs(ruler.delay_mm - late) < 4 * ruler.delay_std_mm
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.median(scale) < 0.008


def test_a_rig_that_gives_way_is_still_a_ruler() -> None:
    errors = []
    for seed in range(30):
        ruler = fit_travel_scale(marks(np.random.default_rng(seed), late=0.003, give=0.005))
        assert ruler is not None
        errors.append((ruler.alpha + ruler.compliance_mm_per_N * C) / (1.02 + 0.005 * C) - 1)
    assert abs(np.mean(errors)) < 0.006


def test_without_errors_every_place_is_exact() -> None:
    exact = [TravelPoint(h, 2.0 * h, 1e-6, 1e-6, force_of(h), str(h), 0.0) for h in HEIGHTS]
    ruler = fit_travel_scale(exact)
    assert ruler is not None
    for mark in exact:
        assert ruler.travel_mm(mark.depth_mm, mark.force_N) == pytest.approx(mark.travel_mm, abs=1e-5)
    assert ruler.delay_mm == pytest.approx(0, abs=1e-6)


def test_one_wrong_touch_is_left_out() -> None:
    wrong = marks(np.random.default_rng(2), late=0.002)
    wrong[7] = replace(wrong[7], travel_mm=wrong[7].travel_mm + 0.03)
    ruler = fit_travel_scale(wrong)
    assert ruler is not None
    assert list(np.flatnonzero(~ruler.used)) == [7]


def test_two_heights_are_enough_where_they_differ() -> None:
    errors = []
    for seed in range(40):
        late = float(np.random.default_rng(seed + 1000).normal(0, TOGETHER))
        two = [mark for mark in marks(np.random.default_rng(seed), late=late) if mark.height in ("A1", "A4")]
        ruler = fit_travel_scale(two)
        assert ruler is not None
        errors.append(((ruler.alpha + ruler.compliance_mm_per_N * C) / 1.02 - 1) / ruler.relative_std(C))
    assert np.sqrt(np.mean(np.square(errors))) < 1.3


def test_a_face_that_leans_is_believed_as_far_as_the_touches_say() -> None:
    """Tilts of 5 um at the bevel that are real scatter the touches; those that the map made up do not."""
    spread = {}
    for real in (1.0, 0.0):
        errors = []
        for seed in range(40):
            rng = np.random.default_rng(seed)
            lean = 0.005 * rng.standard_normal(3 * len(HEIGHTS))
            leaning = [
                replace(mark, travel_mm=mark.travel_mm - 1.02 * real * t, tilt_shift_mm=t)
                for mark, t in zip(marks(rng, late=0.002), lean, strict=True)
            ]
            ruler = fit_travel_scale(leaning)
            assert ruler is not None
            errors.append((ruler.alpha + ruler.compliance_mm_per_N * C) / 1.02 - 1)
        spread[real] = np.std(errors)
    assert spread[1.0] < 1.3 * spread[0.0]


def test_a_stage_tells_at_one_height_how_late_the_touches_are() -> None:
    late = 0.004
    one = [mark for mark in marks(np.random.default_rng(5), late=late, alpha=1.0) if mark.height == "A2"]
    assert fit_travel_scale(one) is None
    ruler = fit_travel_scale([replace(mark, force_N=0.0) for mark in one], scale=1.0)  # a rig that does not give
    assert ruler is not None
    assert ruler.alpha == pytest.approx(1.0, abs=0.005)
    assert ruler.delay_mm == pytest.approx(late, abs=2.5 * ruler.delay_std_mm)


def test_travel_is_read_from_the_stage_where_there_is_one_and_across_stops() -> None:
    series, press = ramp(np.random.default_rng(3), dwell_s=1.0)
    window = force_window(series, press, free_s=(0.0, 8.0), offset_s=0.0)
    assert window is not None
    stop_s, top_s_ = 1.2345 + 0.3 / 0.25, 1.2345 + 0.5 / 0.25 + 1.0
    times = np.arange(0.0, 8.0, 0.01)
    place = 7.0 + np.interp(
        times, [0.0, 1.2345, stop_s, stop_s + 1.0, top_s_, 8.0], [-0.1, 0.0, 0.3, 0.3, 0.5, 0.5]
    )
    begun = first_contact(window, top_s_ - 0.2)
    assert begun is not None
    for stage, pace in ((StageSeries(times, place), float("nan")), (None, 0.25)):
        travel = indenter_travel(window, begun, stage=stage, pace_mm_s=pace)
        assert travel is not None
        assert travel.at(stop_s + 0.5) == pytest.approx(0.3, abs=0.012)
        assert travel.at(top_s_ - 0.2) == pytest.approx(0.45, abs=0.012)
        assert travel.reached_s(0.45) == pytest.approx(top_s_ - 0.2, abs=0.06)
    assert indenter_travel(window, begun, stage=None, pace_mm_s=float("nan")) is None


def test_a_stage_that_still_approaches_fast_at_first_contact_is_no_ruler() -> None:
    """.05 mm between two readings about first contact: its place there, and so every touch, was .05 mm off."""
    series, press = ramp(np.random.default_rng(3))
    window = force_window(series, press, free_s=(0.0, 8.0), offset_s=0.0)
    assert window is not None
    begun = first_contact(window, 1.2345 + 0.5 / 0.25 - 0.2)
    assert begun is not None
    times = np.arange(0.0, 8.0, 0.02)
    pressing = np.interp(times, [1.2345, 1.2345 + 0.5 / 0.25], [0.0, 0.5])
    noise = 0.0004 * np.random.default_rng(1).standard_normal(times.size)
    steady = 7.0 + np.where(times < 1.2345, np.maximum(0.25 * (times - 1.2345), -0.05), pressing) + noise
    fast = 7.0 + np.where(times < 1.2345, -0.05, pressing) + noise
    assert indenter_travel(window, begun, stage=StageSeries(times, steady), pace_mm_s=float("nan")) is not None
    assert indenter_travel(window, begun, stage=StageSeries(times, fast), pace_mm_s=float("nan")) is None


def test_faces_that_lean_unseen_widen_the_ruler_of_an_even_pace() -> None:
    errors, stds = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        leaning = [
            replace(mark, travel_mm=mark.travel_mm + 0.006 * rng.standard_normal())
            for mark in marks(rng, late=float(rng.normal(0, TOGETHER)))
        ]
        ruler = fit_travel_scale(leaning, even=True)
        assert ruler is not None
        errors.append((ruler.alpha + ruler.compliance_mm_per_N * C) / 1.02 - 1)
        stds.append(ruler.relative_std(C))
    assert 0.5 < np.std(errors) / np.mean(stds) < 1.3


def test_no_ruler_without_a_common_pace_or_enough_heights() -> None:
    rng = np.random.default_rng(3)
    uneven = [
        replace(mark, travel_mm=mark.travel_mm * rng.choice([0.7, 1.0, 1.6])) for mark in marks(rng, late=0.0)
    ]
    found = fit_travel_scale(uneven)
    assert found is None or found.used.sum() < len(uneven)
    assert fit_travel_scale([mark for mark in marks(rng, late=0.0) if mark.height in ("A3", "A4")]) is None
    assert fit_travel_scale([]) is None


def ramp(rng: np.random.Generator, *, dwell_s: float = 0.0) -> tuple[ForceSeries, Press]:
    """200 Hz, first contact at 1.2345 s, .25 mm/s to .5 mm, a stop at .3 mm, hold, release."""
    time = np.arange(0, 8, 0.005)
    stop = 1.2345 + 0.3 / 0.25
    way = np.clip(time - 1.2345, 0, None) - np.clip(time - stop, 0, dwell_s)
    depth = np.minimum(0.25 * way, 0.5)
    depth = np.where(time > 5.5, np.clip(0.5 - (time - 5.5), 0, None), depth)
    normal = C * depth * (1 + BETA * depth / THICKNESS)
    noise = np.array([0.006, 0.006, 0.0125]) * rng.standard_normal((time.size, 3))
    reading = np.c_[0 * normal, 0 * normal, normal] + noise
    return ForceSeries(time, reading, (0.006, 0.006, 0.0125)), Press("1", "A1", 0.5, 7.0)


def test_first_contact_is_unbiased_and_its_std_honest() -> None:
    errors, stds = [], []
    for seed in range(40):
        series, press = ramp(np.random.default_rng(seed))
        window = force_window(series, press, free_s=(0.0, 8.0), offset_s=0.0)
        assert window is not None
        found = contact_point(window, 1.2345 + 0.4 / 0.25)
        assert found is not None
        errors.append(found.time_s - 1.2345)
        stds.append(found.std_s)
    assert abs(np.mean(errors)) < 0.001
    assert 0.6 < np.std(errors) / np.mean(stds) < 1.6
    assert np.mean(stds) < 0.004  # a micrometre at this speed


def test_a_stop_on_the_way_is_no_part_of_the_travel() -> None:
    series, press = ramp(np.random.default_rng(1), dwell_s=1.0)
    window = force_window(series, press, free_s=(0.0, 8.0), offset_s=0.0)
    assert window is not None
    assert contact_point(window, 1.2345 + 0.45 / 0.25 + 1.0) is None
    since = 1.2345 + 0.2 / 0.25
    moved = moving_s(window, since, time_s=np.array([since, since + 0.4, since + 1.9]))
    assert moved == pytest.approx([0.0, 0.4, 0.9], abs=0.06)


def test_the_way_in_ends_at_the_corner_not_where_the_top_is_nearly_reached() -> None:
    corner, errors = 1.2345 + 0.5 / 0.25, []
    for seed in range(20):
        series, press = ramp(np.random.default_rng(seed))
        window = force_window(series, press, free_s=(0.0, 8.0), offset_s=0.0)
        assert window is not None
        assert window.phases is not None
        assert window.time_s[window.phases.hold] < corner - 0.02
        errors.append(top_s(window) - corner)
    assert abs(np.mean(errors)) < 0.006
    assert np.std(errors) < 0.012
