"""A gel that relaxes over decades of time is one that relaxes, with more terms, and nothing else besides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from test_screen import MODEL, TRUTH, measured, pure

from calibration.diagnosis.forward_selection import forward_selection
from calibration.effects import EFFECTS, get_effect, written
from calibration.effects.viscoelasticity import MAX_TERMS, Viscoelasticity
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
