"""Bad tables: presses that are copies, times in milliseconds, a noise stated far too large or too small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.fit.depth_noise import depth_beyond_stated
from calibration.fit.repeats import beyond_stated
from calibration.inputs.checks import usable, without_copies
from calibration.inputs.observations import Measured, Observations
from calibration.result.material import determine_material
from calibration.tasks.calibrate import calibrate
from calibration.tasks.diagnose import concluded
from tactilevision.errors import InputError
from tactilevision.recording.read import read_recording

SAMPLES = Path(__file__).parents[2] / "sample_frames"
SAMPLED = ("time_s", "depth_mm", "force_N", "phase", "temperature_C", "depth_std_mm", "force_std_N")


def made(count: int = 12) -> Observations:
    data = presses(count)
    return measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(5))


def copied(data: Observations, press: int, *, onto: int, recording: int = 0) -> Observations:
    """The samples of one press in the place of another one's, of a second recording where asked."""
    depth, force = data.depth_mm.copy(), data.force_N.copy()
    depth[data.press == onto], force[data.press == onto] = depth[data.press == press], force[data.press == press]
    number = data.presses.recording.copy()
    number[onto:] = recording
    return replace(
        data,
        depth_mm=depth,
        force_N=force,
        presses=replace(data.presses, recording=number),
        recordings=("monday", "friday")[: recording + 1],
    )


def test_a_copied_press_is_left_out_and_named() -> None:
    data = made()
    kept = usable(copied(data, 2, onto=8))
    assert kept.count == data.count - 1
    assert "press p8 has the samples of press p2: excluded" in kept.warnings


def test_a_press_copied_from_another_recording_is_named_with_it() -> None:
    kept = usable(copied(made(), 2, onto=8, recording=1))
    assert "press p8 of friday has the samples of press p2 of monday: excluded" in kept.warnings


def test_presses_of_one_law_that_repeat_each_other_are_no_copies() -> None:
    data = made()
    assert usable(data).count == data.count


def test_points_equal_to_each_other_stay_and_are_named() -> None:
    data = made()
    points = replace(
        data, press=np.arange(data.count), **{name: getattr(data, name)[data.first] for name in SAMPLED}
    )
    assert not points.is_curves
    assert without_copies(points).warnings == points.warnings
    kept = without_copies(copied(points, 2, onto=8))
    assert kept.count == points.count
    assert "copies unless by rounding: p8 of p2" in kept.warnings[-1]


@pytest.mark.parametrize("stated", [True, False], ids=["speed stated", "speed not stated"])
def test_times_in_milliseconds_are_refused(*, stated: bool) -> None:
    data = made()
    usual = float(np.median(data.presses.speed_mm_s)) / 0.25  # to a quarter of a millimetre a second
    speed = data.presses.speed_mm_s / (usual if stated else 1000 * usual)
    slow = replace(data, time_s=1000 * usual * data.time_s, presses=replace(data.presses, speed_mm_s=speed))
    with pytest.raises(InputError, match="are these in ms"):
        usable(slow)


def test_slow_presses_are_not_refused() -> None:
    data = made()
    presses_slow = replace(data.presses, speed_mm_s=data.presses.speed_mm_s / 20)
    slow = replace(data, time_s=20 * data.time_s, presses=presses_slow)
    assert usable(slow).count == data.count


def test_a_hold_is_no_slow_way_in() -> None:
    """Fast presses that are held for long, and noise that makes the deepest sample one of the hold's last."""
    time, depth = np.array([0.0, 0.02, 0.04, 0.06, 4.0, 8.0]), np.array([0.0, 0.1, 0.2, 0.299, 0.3, 0.301])
    data = observations([depth] * 3, [indenter()] * 3, time_s=[100 * k + time for k in range(3)])
    data = data.with_force(np.tile(depth, 3) + 1e-3 * np.arange(data.size))
    assert usable(replace(data, presses=replace(data.presses, speed_mm_s=np.full(3, 5.0)))).count == 3


@pytest.mark.parametrize(("wrong", "least", "most"), [(0.1, 8.0, 12.0), (10.0, 0.08, 0.12)])
def test_a_noise_stated_ten_times_off_is_told(wrong: float, least: float, most: float) -> None:
    data = made(20)
    stated = replace(data, force_std_N=np.full(data.size, 0.004 * wrong), depth_std_mm=np.zeros(data.size))
    fitted = pure(stated)
    found = beyond_stated(fitted)
    assert found is not None
    assert fitted.noise.scale * wrong == pytest.approx(1.0, abs=0.2)
    assert least <= found < most
    flag = "stated_noise_too_small" if wrong < 1 else "stated_noise_too_large"
    assert flag in concluded(fitted, determine_material(fitted)).flags


@pytest.mark.parametrize(
    ("wrong", "flags"),
    [
        (0.1, {"stated_noise_too_small"}),
        (1.0, set()),
        pytest.param(10.0, {"stated_noise_too_large"}, marks=pytest.mark.slow),
    ],
)
def test_calibrate_tells_a_noise_stated_ten_times_off(wrong: float, flags: set[str]) -> None:
    recording = read_recording(SAMPLES / "hidden_unknown")
    assert recording.force_std_N is not None
    x, y, z = recording.force_std_N
    stated = replace(recording, force_std_N=(wrong * x, wrong * y, wrong * z))
    found = calibrate(Measured(stated, curves=stated.curves), test=False)
    assert {flag for flag in found.flags if flag.startswith("stated_noise")} == flags
    assert sum("std_N of [force]" in warning for warning in found.warnings) == len(flags)


@pytest.mark.parametrize(("stated_mm", "told"), [(0.0004, True), (0.004, False)])
def test_a_depths_noise_stated_ten_times_too_small_is_told_where_no_force_is_stated(
    *, stated_mm: float, told: bool
) -> None:
    """Presses begin in air, where no depth's noise is seen: what is stated of it alone is none of the samples."""
    data, (in_air, off) = made(20), 0.004 * np.random.default_rng(3).standard_normal((2, 340))
    first = np.arange(data.size) % 17 == 0
    data = data.shifted(np.where(first, -0.05 - data.depth_mm, off))
    data = data.with_force(np.where(first, in_air, data.normal_N))
    fitted = pure(replace(data, depth_std_mm=np.full(data.size, stated_mm)))
    assert beyond_stated(fitted) is None
    times = depth_beyond_stated(fitted)
    assert times == pytest.approx(10.0, rel=0.2) if told else times is None
    result = concluded(fitted, determine_material(fitted))
    assert ("stated_noise_too_small" in result.flags) is told
    assert any("depths scatter" in said for said in result.warnings) is told
