"""The test of a calibration's model, on curves by a formula of the literature with known faults."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from made_recordings import recording_of
from shared_scenes import shared

from benchmarks.others_curves.law import slope_N_per_mm
from calibration.inputs.observations import Measured
from calibration.result.result import CalibrationResult, unfixed_as_json
from calibration.tasks import calibrate as page
from calibration.tasks.calibrate import calibrate
from calibration.tasks.compare import FAR_HELD_OUT
from tactilevision.records.measured import Curve
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

MODULUS, NU, BEND, THICKNESS = 0.25, 0.48, 0.7, 3.0
RADII = {"R15": 1.5, "R25": 2.5}


def pressed(seed: int, *, late_mm: float = 0.0, bias_N: float = 0.0) -> Measured:
    """Twelve presses to .3 to .75 mm, .03 mm of air before: 4 mN a sample, .5 % gain and 4 um zero a press."""
    rng, curves, presses = np.random.default_rng(seed), [], []
    for k, name in enumerate(list(RADII) * 6):
        deepest = 0.3 + 0.15 * (k // 2 % 4)
        time = np.linspace(0.0, 2 * (deepest + 0.03) / 0.1 + 2, 33)
        depth = np.minimum(np.minimum(-0.03 + 0.1 * time, deepest), (time[-1] - time) * 0.1 - 0.03)
        inside = np.maximum(depth, 0.0)
        force = slope_N_per_mm(MODULUS, NU, RADII[name], THICKNESS) * inside * (1 + BEND * inside / THICKNESS)
        force = force * (1 + 0.005 * rng.standard_normal()) + bias_N + 0.004 * rng.standard_normal(33)
        read = depth - late_mm + 0.004 * rng.standard_normal() + 0.002 * rng.standard_normal(33)
        begin = 80.0 * k
        curves.append(Curve(str(k), begin + time, read, np.outer(force, [0, 0, 1.0]), np.full(33, "")))
        presses.append(Press(str(k), name, begin, begin + float(time[-1])))
    gel = Gel(THICKNESS, 0.02, "disc", 15.0, poisson_ratio=NU, poisson_ratio_std=0.005)
    sensor = Sensor("custom", 400, 300, (0.06, 0.06), gel)
    punches = {name: Indenter(name, radius_mm=radius) for name, radius in RADII.items()}
    return Measured(recording_of(sensor, punches, tuple(presses), depth_source="vision"), curves=tuple(curves))


@cache
@shared
def found(late_mm: float = 0.0, bias_N: float = 0.0) -> CalibrationResult:
    return calibrate(pressed(3, late_mm=late_mm, bias_N=bias_N))


def test_a_sufficient_model_has_no_flag() -> None:
    result = found()
    assert result.model_test is not None
    assert result.model_test.p > 0.05
    assert not {"model_insufficient", FAR_HELD_OUT} & set(result.flags)
    assert calibrate(pressed(3), test=False).youngs_modulus == result.youngs_modulus


@pytest.mark.parametrize(
    ("key", "late_mm", "bias_N", "size"),
    [
        ("depth_zero", 0.04, 0.0, 0.04),
        pytest.param("force_bias", 0.0, 1.2, 1.2, marks=pytest.mark.slow),
    ],
)
def test_a_fault_is_named_and_within_the_interval(key: str, late_mm: float, bias_N: float, size: float) -> None:
    result = found(late_mm, bias_N)
    assert {"model_insufficient", FAR_HELD_OUT} <= set(result.flags)
    assert result.model_test is not None
    first = result.model_test.suspects[0]
    assert first.key == key
    assert first.sizes[0][1] == pytest.approx(size, rel=0.15)
    low, high = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert low < MODULUS < high
    assert sum("the model does not explain these data" in line for line in result.warnings) == 1


@pytest.mark.slow
def test_the_value_of_E_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    result = found(0.04)
    monkeypatch.setattr(page, "with_model_test", lambda result, *_, **__: result)
    assert calibrate(pressed(3, late_mm=0.04)).youngs_modulus.value == result.youngs_modulus.value


def test_the_test_is_written_down() -> None:
    content = found(0.04).as_json()
    assert content["model_test"]["suspects"][0]["parameters"]["offset_mm"]["unit"] == "mm"
    assert set(unfixed_as_json(None, (), why="none", law="default")) == set(content)
