"""What a residual leaves is described by its simplest shape, and written as an effect that removes it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from each import each

from calibration.diagnosis.residual_shape import find_shape
from calibration.effects import EFFECTS
from calibration.effects.own_shape import own_effect
from calibration.effects.private import load_effect
from calibration.inputs.observations import Observations
from calibration.tasks.compare import plain_law, with_effect
from tactilevision.records.measured import Floats

sys.path.insert(0, str(Path(__file__).parents[1] / "workbench"))
from made_bench import presses


def wave(data: Observations) -> Floats:
    return np.asarray(0.03 * np.cos(2 * np.pi * data.depth_mm / 0.15 + 1))


def step(data: Observations) -> Floats:
    return np.where(data.depth_mm > 0.28, 0.05, 0.0)  # between two of the depths


@each("planted, covariate, kind, at", [(wave, "w", "wave", 0.15), (step, "w", "step", 0.28)])
def test_what_is_planted_is_found_and_its_effect_removes_it(
    tmp_path: Path, planted: Callable[[Observations], Floats], covariate: str, kind: str, at: float
) -> None:
    data = presses()
    found = with_effect(plain_law(data.with_force(data.normal_N + planted(data))), EFFECTS["depth_zero"])
    shape = find_shape(found.models[-1].fitted)
    assert shape is not None
    assert (shape.covariate, shape.kind) == (covariate, kind)
    assert abs(shape.at - at) < 0.1 * at
    file = tmp_path / "my_effect.py"
    file.write_text(own_effect(shape, "it"))
    added = with_effect(found, load_effect(file))
    assert not added.left_out
    assert added.models[-1].held_out_N < 0.8 * found.models[-1].held_out_N
