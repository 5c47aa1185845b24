"""A gel that relaxes over decades of time is one that relaxes, with more terms, and nothing else besides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, pure

from calibration.diagnosis.forward_selection import forward_selection
from calibration.effects import EFFECTS, get_effect, written
from calibration.effects.viscoelasticity import MAX_TERMS, Viscoelasticity, relaxed
from calibration.inputs.observations import Observations
from tactilevision.errors import InputError


def held(count: int = 12) -> Observations:
    """Loads at 1 and .1 mm/s, holds of 20 s, and back."""
    down, still = np.linspace(0.03, 0.5, 10), np.full(8, 0.5)
    depth = np.concatenate([down, still, down[::-1]])
    phase = [["load"] * 10 + ["hold"] * 8 + ["unload"] * 10] * count
    times = []
    for k in range(count):
        rate = (0.1, 1.0)[k % 2]
        top = 300.0 * k + down / rate
        wait = top[-1] + np.geomspace(0.1, 20, 8)
        times.append(np.concatenate([top, wait, wait[-1] + 0.05 + (down - down[0]) / rate]))
    data = observations([depth] * count, [indenter()] * count, time_s=times, phase=phase)
    return replace(data, presses=replace(data.presses, speed_mm_s=np.resize([0.1, 1.0], count)))


@pytest.mark.slow
def test_more_terms_come_before_a_second_effect() -> None:
    data = held()
    values = np.array([*TRUTH, 0.06, 0.15, 0.06, 1.5, 0.06, 15.0])
    force = (MODEL + Viscoelasticity(terms=3)).predict(values, data)
    fitted = pure(measured(data, force, np.random.default_rng(1)))
    looked = [EFFECTS[key] for key in ("clock_offset", "viscoelasticity", "stiffening", "mullins")]
    found = forward_selection(fitted, looked, rng=np.random.default_rng(0), level=0.05)
    assert [step.best.effect.key for step in found.steps] == ["viscoelasticity"]
    effect = found.steps[0].best.effect
    assert isinstance(effect, Viscoelasticity)
    assert effect.terms >= 2
    assert found.current.values[0] == pytest.approx(TRUTH[0], rel=0.03)
    assert get_effect(written(effect)) == effect


def test_terms_are_named_by_number_and_end() -> None:
    assert get_effect("viscoelasticity:1") == EFFECTS["viscoelasticity"]
    assert written(EFFECTS["tilt"]) == "tilt"
    assert Viscoelasticity(terms=MAX_TERMS).richer() is None
    with pytest.raises(InputError, match="no effect of this name"):
        get_effect(f"viscoelasticity:{MAX_TERMS + 1}")


@pytest.mark.parametrize("touch_s", [0.05, 0.33])
def test_a_short_lag_is_exact_where_a_press_touches_between_two_samples(touch_s: float) -> None:
    """A filter of first order lags behind a ramp k (t - t_0) by k tau (1 - exp(-(t - t_0)/tau))."""
    time, tau = np.array([0.0, 0.4, 0.8]), 0.05
    ramp = np.maximum(time - touch_s, 0.0)
    data = observations([time - touch_s], [indenter()], time_s=[time], phase=[["load"] * 3])
    lag = -tau * np.expm1(-ramp / tau)
    assert ramp - relaxed(ramp, tau, data=data) == pytest.approx(lag, rel=1e-9)


def test_two_terms_of_stiffening_follow_a_gel_near_the_end_of_its_chains() -> None:
    """J_m/(J_m - J) of Gent, Rubber Chem. Technol. 69 (1996) 59, at J_m = .8."""
    depth = np.linspace(0.02, 0.5, 25)
    data = observations([depth], [indenter()])
    strain = depth / data.gel.thickness_mm
    stretch = 1 - strain
    gent = depth * 0.8 / (0.8 - (stretch**2 + 2 / stretch - 3))
    effect = get_effect("stiffening:2")
    added = [(MODEL + effect).predict(np.array([*TRUTH, *own]), data) for own in ((0, 0), (1, 0), (0, 1))]
    columns = np.column_stack([depth, depth * strain, added[1] - added[0], added[2] - added[0]])
    worst = [np.max(np.abs(columns[:, :k] @ np.linalg.lstsq(columns[:, :k], gent)[0] / gent - 1)) for k in (3, 4)]
    assert worst[1] < worst[0] / 5
    assert worst[1] < 2e-3
