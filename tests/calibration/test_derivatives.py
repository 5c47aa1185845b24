"""Every derivative of a law and of an effect against central differences of the whole model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import indenter
from test_effects import RICH, data_for

from calibration.effects import CATALOGUE, EFFECTS
from calibration.fit.least_squares import Box, differentiate
from calibration.fit.tolerances import with_tolerances
from calibration.inputs.observations import Observations, Resultants, Shared
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.paper import Paper
from calibration.laws.reconstructed_depth import ReconstructedDepth
from calibration.laws.resultant import Resultant
from calibration.laws.round_bodies import RoundBody
from calibration.model.composition import Model
from calibration.model.dual import Dual
from calibration.model.stages import Effect

BY_DIFFERENCES = {"recovery"}  # its memory passes from press to press in a loop
WITH_EDGES = replace(RICH, indenters=tuple(replace(i, edge_radius_mm=0.2) for i in RICH.indenters))
EFFECTS_OF_ALL = [EFFECTS[key] for key in CATALOGUE]
PUNCH = FlatPunch(free_poisson_ratio=True)


def inside(model: Model, data: Observations, seed: int) -> np.ndarray:
    """Values between the bounds, near the defaults of the law and of a usual size of the effects."""
    rng, values = np.random.default_rng(seed), []
    for p in model.parameters(data):
        low, high = max(p.bounds[0], p.default - 3 * p.scale), min(p.bounds[1], p.default + 3 * p.scale)
        values.append(low + (high - low) * rng.uniform(0.15, 0.85))
    return np.array(values)


def assert_same_slopes(model: Model, data: Observations, *, seed: int = 0) -> None:
    values, table = inside(model, data, seed), model.parameters(data)
    box = Box(*np.array([p.bounds for p in table]).T, np.array([p.scale for p in table]))
    wanted = differentiate(lambda one: model.predict(one, data), values, box=box)
    got = model.derivatives(values, data)
    size = np.maximum(np.abs(wanted).max(axis=0), 1e-9)
    off = np.abs(got - wanted) / size
    assert np.quantile(off, 0.98) < 2e-5  # a sample at a kink has a slope on either side
    assert np.median(off.max(axis=0)) < 1e-4
    assert (np.abs(wanted).max(axis=0) > 0).any()


@each("effect", EFFECTS_OF_ALL)
def test_slopes_of_an_effect_are_those_of_differences(effect: Effect) -> None:
    data = data_for(effect)
    assert effect.analytic == (effect.key not in BY_DIFFERENCES)
    if not effect.absent(data):
        assert_same_slopes(Model(PUNCH) + effect, data)
