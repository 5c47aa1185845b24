"""Clocks aligned from what camera and F/T sensor both saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.press.clock import (
    PressDepths,
    clock_jump_warnings,
    clock_jumps,
    correlation_offset,
    estimate_offset,
    parabola_offset,
    stated_offset_warnings,
)
from tactilevision.press.force_readings import Tare, find_tare, subtract_tares
from tactilevision.records.measured import Floats, ForceSeries

TOPS = (0.2, 0.35, 0.4, 0.5, 0.65)


def depth_at(time: Floats, start: float, top: float, speed: float = 0.25) -> Floats:
    """Ramp, hold of half a second, quick release."""
    corners = np.cumsum([start, top / speed, 0.5, top / 1.0])
    return np.interp(time, corners, [0.0, top, top, 0.0])


def presses(
    offset_s: float,
    rng: np.random.Generator,
    *,
    rate_Hz: float = 30.0,
    frames: int | None = None,
    relaxing: float = 0.0,
    crooked: float = 0.4,
) -> tuple[list[PressDepths], ForceSeries]:
    """Presses every seven seconds; the camera reads depths crookedly, at jittered and thinned times."""
    force_time = np.arange(0, 7.0 * len(TOPS) + 2, 0.005)
    depth = np.sum([depth_at(force_time, 2 + 7 * k, top) for k, top in enumerate(TOPS)], axis=0)
    normal = 3.5 * depth * (1 + 0.28 * depth)
    if relaxing:
        branch = np.zeros_like(normal)
        for i in range(1, normal.size):
            branch[i] = (branch[i - 1] + normal[i] - normal[i - 1]) * np.exp(-0.005 / 1.0)
        normal = (1 - relaxing) * normal + relaxing * branch
    force = np.c_[0 * normal, 0 * normal, normal + 0.2] + 0.0125 * rng.standard_normal((normal.size, 3))
    seen = []
    for k, top in enumerate(TOPS):
        time = np.arange(1 + 7 * k, 6 + 7 * k, 1 / rate_Hz)
        time = time + rng.uniform(-0.1, 0.1, time.size) / rate_Hz
        if frames is not None:
            time = np.sort(rng.choice(time, frames, replace=False))
        true = depth_at(time, 2 + 7 * k, top)
        read = true * (1.2 - crooked * true) * rng.normal(1, 0.02) + 0.002 * rng.standard_normal(time.size)
        seen.append(PressDepths(time, read, 2.5))
    return seen, ForceSeries(force_time + offset_s, force, (0.00625, 0.00625, 0.0125))


@each("rate_Hz", [15.0, 30.0, 90.0])
@each("offset_s", [-0.15, 0.0, 0.08])
def test_offset_within_three_milliseconds(rate_Hz: float, offset_s: float) -> None:
    seen, forces = presses(offset_s, np.random.default_rng(int(rate_Hz)), rate_Hz=rate_Hz)
    start, sure = correlation_offset(seen, forces)
    assert sure > 0.9
    found = estimate_offset(seen, forces, start_s=parabola_offset(seen, forces, start_s=start))
    assert found.value == pytest.approx(offset_s, abs=0.003)
    assert found.std is not None
    assert found.std < 0.003


def test_noise_that_was_taken_for_a_face_moves_no_clock() -> None:
    rng = np.random.default_rng(5)
    seen, forces = presses(0.12, rng, rate_Hz=15.0)
    assert all(press.goes_in for press in seen)
    for k in (3, 4):
        seen[k] = replace(seen[k], depth_mm=0.3 * rng.standard_normal(seen[k].time_s.size))
    kept = [press for press in seen if press.goes_in]
    assert len(kept) == 3
    assert correlation_offset(seen, forces)[1] < 0.9
    start, sure = correlation_offset(kept, forces)
    assert sure > 0.9
    assert start == pytest.approx(0.12, abs=0.1)


@each("stated_s, warned", [(0.12, False), (0.125, False), (0.17, True), (0.05, True)])
def test_a_stated_offset_that_the_presses_contradict_is_told(stated_s: float, warned: bool) -> None:
    seen, forces = presses(0.12, np.random.default_rng(6))
    said = stated_offset_warnings(stated_s, seen, forces)
    assert bool(said) is warned
    if warned:
        assert f"offset_s = {stated_s}" in said[0]
        assert "0.12" in said[0].partition("go together at")[2]


def test_thinned_frames_and_a_relaxing_gel() -> None:
    for seed, relaxing in ((1, 0.0), (2, 0.0), (3, 0.15)):
        seen, forces = presses(0.12, np.random.default_rng(seed), rate_Hz=60, frames=60, relaxing=relaxing)
        start, _ = correlation_offset(seen, forces)
        found = estimate_offset(seen, forces, start_s=parabola_offset(seen, forces, start_s=start))
        assert found.value == pytest.approx(0.12, abs=0.003), relaxing


def test_clocks_of_different_origin() -> None:
    seen, forces = presses(5432.1, np.random.default_rng(0))
    start, sure = correlation_offset(seen, forces)
    assert sure > 0.9
    found = estimate_offset(seen, forces, start_s=parabola_offset(seen, forces, start_s=start))
    assert found.value == pytest.approx(5432.1, abs=0.003)


def test_std_is_what_the_estimate_scatters_by() -> None:
    errors, stds = [], []
    for seed in range(12):
        seen, forces = presses(0.05, np.random.default_rng(seed), frames=40)
        found = estimate_offset(seen, forces, start_s=0.06)
        assert found.value is not None
        assert found.std is not None
        errors.append(found.value - 0.05)
        stds.append(found.std)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / np.mean(stds) < 2


def test_no_ramp_no_offset() -> None:
    seen, forces = presses(0.0, np.random.default_rng(0))
    free = [PressDepths(s.time_s[:5], np.zeros(5), 2.5) for s in seen]
    found = estimate_offset(free, forces, start_s=0.0)
    assert found.value is None
    assert found.why


def test_a_zero_that_drifts_is_no_lag() -> None:
    raw: list[float] = []
    level: list[float] = []
    for seed in range(4):
        seen, forces = presses(0.05, np.random.default_rng(seed), rate_Hz=30.0)
        drifting = replace(forces, force_N=forces.force_N + 0.01 * forces.time_s[:, None])
        spans = [(2.05 + 7 * k, 2.05 + top / 0.25 + 0.5 + top + 7 * k) for k, top in enumerate(TOPS)]
        tares = [
            find_tare(drifting, (first - 0.1, last + 0.1), free_s=(first - 2, last + 2)) for first, last in spans
        ]
        for found, force in ((raw, drifting), (level, subtract_tares(drifting, tares))):
            value = estimate_offset(seen, force, start_s=0.06).value
            assert value is not None
            found.append(value - 0.05)
    assert abs(np.mean(level)) < 0.001
    assert abs(np.mean(raw)) > 0.003


def test_forces_without_a_known_zero_stay_as_they_are() -> None:
    _, forces = presses(0.0, np.random.default_rng(0))
    assert subtract_tares(forces, [Tare(None, np.nan, None, np.nan, np.full(3, np.nan))]) is forces


def slow_presses(
    rng: np.random.Generator, harder: tuple[float, float] = (1.0, 1.0)
) -> tuple[list[PressDepths], ForceSeries]:
    """Six slow presses by two punches in turn, two of each, filmed at 12 frames a second; clocks .03 s apart."""
    force_time, tops = np.arange(0, 74, 0.005), (0.2, 0.3, 0.2, 0.3, 0.2, 0.3)
    normal, seen = 0.2 + 0.012 * rng.standard_normal(force_time.size), []
    for k, top in enumerate(tops):
        corners = np.cumsum([2 + 12 * k, top / 0.15, 0.5, top / 0.15])
        here, stiffness = np.interp(force_time, corners, [0, top, top, 0]), harder[k // 2 % 2]
        normal += 2.9 * stiffness * here * (1 + 0.28 * here)
        time = np.arange(0.7 + 12 * k + rng.uniform(0, 0.08), 10 + 12 * k, 1 / 12)
        true = np.interp(time, corners, [0, top, top, 0])
        read = true * rng.normal(1, 0.01) + np.where(true > 0, 0.0018, 0.0006) * rng.standard_normal(time.size)
        seen.append(PressDepths(time, read, stiffness, np.inf, stiffness))
    return seen, ForceSeries(force_time + 0.03, np.c_[0 * normal, 0 * normal, normal], (0.006, 0.006, 0.012))


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_noise_of_the_force_is_no_relaxing_gel(seed: int) -> None:
    """A memory of .2 s less a delay of as much smooths the readings: taken for a gel, it was 20 ms off."""
    found = estimate_offset(*slow_presses(np.random.default_rng(seed)), start_s=0.03)
    assert found.value == pytest.approx(0.03, abs=0.003)


def test_a_wide_punch_presses_harder_at_one_depth() -> None:
    """Of punches in turn that press unlike, the wrong pair once went together better than the right one."""
    seen, forces = slow_presses(np.random.default_rng(1), (1.0, 6.0))
    start, sure = correlation_offset(seen, forces)
    assert start == pytest.approx(0.03, abs=0.05)
    assert sure > 0.98


def test_a_clock_that_jumps_is_named_with_its_presses() -> None:
    rng = np.random.default_rng(3)
    seen, forces = presses(0.05, rng, relaxing=0.2)
    labels = [f"P{k}" for k in range(len(seen))]
    assert clock_jumps(dict(zip(labels, seen, strict=True)), forces, offset_s=0.05) == {}
    late = [replace(one, time_s=one.time_s - 0.5) if k < 2 else one for k, one in enumerate(seen)]
    clock_outliers = clock_jumps(dict(zip(labels, late, strict=True)), forces, offset_s=0.05)
    assert clock_outliers == pytest.approx({"P0": 0.5, "P1": 0.5}, abs=0.05)
    assert "P0 (+0." in next(clock_jump_warnings(clock_outliers))
