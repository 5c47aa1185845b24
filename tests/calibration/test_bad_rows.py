"""Rows that hold no measurement: a logger's codes, spikes, times that stand still, and points at depth 0."""

from __future__ import annotations

import csv
import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_recordings import points_of, recording_of

from benchmarks.others_curves.recording import make
from calibration.effects import EFFECTS
from calibration.inputs.checks import usable
from calibration.inputs.denoised_depth import denoised_depth
from calibration.inputs.gather import observe_curves, observe_points
from calibration.inputs.observations import Measured
from calibration.inputs.wild_samples import wild_samples
from calibration.tasks.calibrate import calibrate
from tactilevision.errors import InputError
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Curve
from tactilevision.records.rig import Gel, Indenter, Press, Sensor


def _recording(
    rng: np.random.Generator, *, tails: float = np.inf, pull_N: float = 0.0, slip: float = 0.0, step_N: float = 0.0
) -> Measured:
    """Ten presses of a trapezoid in time, P = 3.5 w (1 + .9 w/3): the layer's law with c and beta given.

    `tails`: degrees of freedom of the noise; `pull_N`: tension at which the gel lets go; `slip`: fall of the force
    at three places in loading, as a share, until unloading; `step_N`: what the force is rounded to.
    """
    curves, presses = [], []
    for k in range(10):
        deepest, speed = (0.3, 0.45, 0.6)[k % 3], (0.1, 1.0)[k % 2]
        ends = np.cumsum([0.0, (deepest + 0.05) / speed, 2.0, (deepest + 0.15) / speed])
        time = np.sort(np.concatenate([ends, rng.uniform(0, ends[-1], 36)]))
        depth = np.interp(time, ends, [-0.05, deepest, deepest, -0.1])
        force = 3.5 * np.maximum(depth, 0.0) * (1 + 0.3 * depth)
        back = time > ends[2]
        force = np.where(back & (depth < 0) & (depth > -0.06), pull_N * depth / 0.06, force)
        for place in (0.35, 0.6, 0.8):
            force = np.where(~back & (np.maximum.accumulate(depth) > place * deepest), force * (1 - slip), force)
        noise = rng.standard_normal if np.isinf(tails) else lambda size: rng.standard_t(tails, size)
        force = force + 0.004 * noise(time.size)
        force = np.round(force / step_N) * step_N if step_N else force
        depth = depth + 0.002 * noise(time.size)
        three = np.column_stack([0.01 * noise(time.size), 0.01 * noise(time.size), force])
        curves.append(Curve(f"p{k}", 100.0 * k + time, depth, three, np.full(time.size, "")))
        presses.append(Press(f"p{k}", "A", 100.0 * k, 100.0 * k + ends[-1], speed_mm_s=speed))
    sensor = Sensor("custom", 10, 10, (0.1, 0.1), Gel(3.0, poisson_ratio=0.48, poisson_ratio_std=0.005))
    recording = recording_of(sensor, {"A": Indenter("A", radius_mm=2.5)}, tuple(presses), depth_source="stage")
    return Measured(recording, curves=tuple(curves))


def _with(measured: Measured, press: int, row: int, **values: float) -> Measured:
    """Return the recording with other numbers in one row."""
    curves = list(measured.curves)
    one = curves[press]
    depth, force = one.depth_mm.copy(), one.force_N.copy()
    depth[row] = values.get("depth_mm", depth[row])
    force[row] = [values.get(name, force[row, k]) for k, name in enumerate(("fx_N", "fy_N", "fz_N"))]
    curves[press] = replace(one, depth_mm=depth, force_N=force)
    return replace(measured, curves=tuple(curves))


@pytest.mark.parametrize(
    "values",
    [
        {"fz_N": 9999.0},
        {"fz_N": 1e30},
        {"fz_N": -999.0},
        {"fz_N": -1.0},
        {"fz_N": 30.0},
        {"fx_N": 9999.0},
        {"depth_mm": 9999.0},
        {"depth_mm": -1.0},
        {"depth_mm": -1.0, "fz_N": -1.0},
    ],
)
@pytest.mark.parametrize("row", [14, 24])
def test_one_wild_row_is_excluded_and_named(values: dict[str, float], row: int) -> None:
    clean = _recording(np.random.default_rng(3))
    data = observe_curves(_with(clean, 4, row, **values))
    kept = np.delete(clean.curves[4].time_s, row)
    assert np.array_equal(data.time_s[data.press == 4] - data.time_s[0], kept - clean.curves[0].time_s[0])
    (said,) = data.warnings
    assert f"press p4 at {clean.curves[4].time_s[row]:.6g} s" in said
    for name, value in values.items():
        assert name == "fx_N" or f"{name} = {value:g}" in said


def test_the_modulus_is_that_without_the_row() -> None:
    clean = _recording(np.random.default_rng(4))
    spiked = calibrate(_with(replace(clean, curves=clean.curves[:6]), 2, 25, fz_N=9999.0))
    assert "p2" in spiked.warnings[0]
    assert spiked.c.value == pytest.approx(3.5, rel=0.02)


def test_a_code_that_is_repeated_in_neighbouring_rows_is_recognised() -> None:
    """Of one press, and of several recordings, each by its own name."""
    clean = _recording(np.random.default_rng(5))
    for value in (-1.0, 9999.0):
        spoilt = clean
        for press, row in ((1, 23), (1, 24), (1, 25), (6, 12)):
            spoilt = _with(spoilt, press, row, fz_N=value)
        sets = [
            replace(spoilt, recording=replace(spoilt.recording, name=name, date=datetime.date(2026, 11, day)))
            for name, day in (("first", 1), ("second", 2))
        ]
        data = observe_curves(sets)
        assert data.normal_N.min() > -0.5
        assert data.normal_N.max() < 5
        assert data.size == 2 * (400 - 4)
        for name, said in zip(("first", "second"), data.warnings, strict=True):
            assert said.startswith(f"{name}: curves.csv: 4 of 400 samples")


def test_many_wild_rows_are_an_error() -> None:
    spoilt = _recording(np.random.default_rng(6))
    for k in range(24):
        spoilt = _with(spoilt, k % 10, 13 + k, fz_N=500.0 + 37 * k)
    with pytest.raises(InputError, match=r"2\d of 400 samples .*press p0"):
        observe_curves(spoilt)


def test_a_column_full_of_codes_is_an_error() -> None:
    spoilt = _recording(np.random.default_rng(6))
    for k in range(60):
        spoilt = _with(spoilt, k % 10, 10 + k // 10, fz_N=9999.0)
    with pytest.raises(InputError, match="60 of 400 samples"):
        observe_curves(spoilt)


@pytest.mark.parametrize(
    "kind",
    [{"tails": 4.0}, {"pull_N": 0.5}, {"pull_N": 0.05}, {"slip": 0.05}, {"slip": 0.3}, {"step_N": 0.02}, {}],
    ids=str,
)
def test_sound_rows_are_kept(kind: dict[str, float]) -> None:
    """Heavy tails, pull-off, slips, coarse steps, corners and the touch: one sample in 4,000 at most is lost."""
    rng = np.random.default_rng(7)
    drawn = [observe_curves(_recording(rng, **kind)) for _ in range(10)]
    assert sum(data.size for data in drawn) >= 10 * 400 - 1


@pytest.mark.parametrize("seed", range(6))
def test_sound_rows_of_others_are_kept(seed: int, tmp_path: Path) -> None:
    """Recordings of formulas that share no code with the library, with noise of five kinds."""
    made = make(tmp_path, "outside" if seed % 2 else "clean", seed, rich=False, count=6)
    read = read_recording(tmp_path)
    assert observe_curves(Measured(read, curves=read.curves)).size == made.samples


def test_a_sentinel_in_a_file_of_others_is_named(tmp_path: Path) -> None:
    make(tmp_path, "clean", 3, rich=False, count=6)
    with (tmp_path / "curves.csv").open() as file:
        rows = list(csv.reader(file))
    rows[40][5] = "9999"
    with (tmp_path / "curves.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    read = read_recording(tmp_path)
    (said,) = observe_curves(Measured(read, curves=read.curves)).warnings
    assert f"press {rows[40][0]} at {float(rows[40][1]):.6g} s" in said
    assert "fz_N = 9999" in said


def test_the_alarm_is_of_a_recording_whatever_its_length() -> None:
    """Of Student's t of four degrees, 5 recordings in 1,000 at most lose a row."""
    rng = np.random.default_rng(8)
    press, time = np.repeat(np.arange(8), 50), np.tile(np.arange(50.0), 8)
    lost = 0
    for _ in range(60):
        force = np.column_stack([np.zeros((400, 2)), 1 + 0.01 * rng.standard_t(4, 400)])
        lost += int(wild_samples(press, time, np.full(400, 0.3), force).any())
    assert lost <= 2, "60 times .005 is .3: three or more have a chance of .0036"


def _floor(curve: Curve, tick_s: float) -> Curve:
    return replace(curve, time_s=np.floor(curve.time_s / tick_s) * tick_s)


@pytest.mark.parametrize("which", ["whole seconds", "a press with one time"])
def test_times_that_stand_still_are_no_times(which: str) -> None:
    fine = _recording(np.random.default_rng(9))
    curves = list(fine.curves)
    if which == "whole seconds":
        curves, named = [_floor(curve, 1.0) for curve in curves], "p0, p1"
    else:
        curves[7], named = replace(curves[7], time_s=np.full(curves[7].time_s.size, 700.0)), "press p7"
    coarse = replace(fine, curves=tuple(curves))
    data = usable(observe_curves(coarse))
    assert not data.is_timed
    assert np.isfinite(denoised_depth(data)).all()
    (said,) = [warning for warning in data.warnings if "curves.csv" in warning]
    assert named in said
    for key in ("clock_offset", "viscoelasticity"):
        assert "times that grow" in EFFECTS[key].missing(data)
        assert not EFFECTS[key].missing(observe_curves(fine))
    result = calibrate(coarse)
    assert any(named in warning for warning in result.warnings)
    assert result.c.value == pytest.approx(3.5, rel=0.02)


def test_a_few_equal_times_are_times() -> None:
    """Four samples in a row of one time, at the corner of a ramp, in presses that are timed otherwise."""
    fine = _recording(np.random.default_rng(10))
    curves = []
    for curve in fine.curves:
        top = int(np.argmax(curve.depth_mm > 0.98 * curve.depth_mm.max()))
        time = curve.time_s.copy()
        time[top - 4 : top + 1] = time[top]
        curves.append(replace(curve, time_s=time))
    data = usable(observe_curves(replace(fine, curves=tuple(curves))))
    assert data.is_timed
    assert np.isfinite(denoised_depth(data)).all()


def test_points_at_depth_0_and_force_0_are_dropped_by_name() -> None:
    depth = np.array([0.0, 0.2, 0.4, 0.6, 0.0005, 0.3])
    force = np.array([0.0, 0.7, 1.5, 2.4, 0.001, 1.1])
    data = observe_points(points_of(depth, force))
    assert data.presses.label == ("2", "3", "4", "6")
    (said,) = data.warnings
    assert (
        said
        == "made: points.csv: 2 rows are excluded, whose depth and force are 0 within their noise (press 1, 5)"
    )
    assert (
        calibrate(points_of(depth, force)).c.value
        == calibrate(points_of(depth[data_rows], force[data_rows])).c.value
    )


data_rows = [1, 2, 3, 5]  # of the points above that are pressed


@pytest.mark.parametrize(("depth", "force"), [(0.0, 0.8), (0.3, 0.0)])
def test_only_one_0_is_a_fault(depth: float, force: float) -> None:
    with pytest.raises(InputError, match="above 0"):
        calibrate(points_of(np.array([depth, 0.2, 0.4]), np.array([force, 0.7, 1.5])))
