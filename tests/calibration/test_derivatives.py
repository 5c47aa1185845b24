"""Every derivative of a law and of an effect against central differences of the whole model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from each import each
from test_effects import RICH, data_for

from calibration.effects import CATALOGUE, EFFECTS
from calibration.fit.least_squares import box_of, differentiate
from calibration.fit.tolerances import with_tolerances
from calibration.inputs.observations import Observations, Resultants
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.paper import Paper
from calibration.laws.reconstructed_depth import ReconstructedDepth
from calibration.laws.resultant import Resultant
from calibration.laws.round_bodies import RoundBody
from calibration.model.composition import Model
from calibration.model.dual import Dual
from calibration.model.stages import Effect
from tactilevision.records.rig import Indenter

BY_DIFFERENCES = {"recovery"}  # its memory passes from press to press in a loop
WITH_EDGES = replace(RICH, indenters=tuple(replace(i, edge_radius_mm=0.2) for i in RICH.indenters))
EFFECTS_OF_ALL = [EFFECTS[key] for key in CATALOGUE]
TOLERANT = replace(
    RICH,
    depth_source="gauge",
    gel=replace(RICH.gel, thickness_std_mm=0.05),
    indenters=tuple(replace(i, radius_std_mm=0.02, height_std_mm=0.01) for i in RICH.indenters),
)
WITH_FORCE = WITH_EDGES.with_force(2 * RICH.depth_mm)
BALLS = replace(
    RICH, indenters=tuple(Indenter(i.name, radius_mm=i.radius_mm, shape="sphere") for i in RICH.indenters)
)
PUNCH = FlatPunch(free_poisson_ratio=True)


def in_picture(key: str) -> Effect:
    found = EFFECTS[key].in_picture()
    assert found is not None
    return found


def inside(model: Model, data: Observations, seed: int) -> np.ndarray:
    """Values between the bounds, near the defaults of the law and of a usual size of the effects."""
    rng, values = np.random.default_rng(seed), []
    for p in model.parameters(data):
        low, high = max(p.bounds[0], p.default - 3 * p.scale), min(p.bounds[1], p.default + 3 * p.scale)
        values.append(low + (high - low) * rng.uniform(0.15, 0.85))
    return np.array(values)


def assert_same_slopes(model: Model, data: Observations, *, seed: int = 0) -> None:
    values, table = inside(model, data, seed), model.parameters(data)
    free = np.array([not p.fixed for p in table])

    def force(free_values: np.ndarray) -> np.ndarray:
        values[free] = free_values
        return model.predict(values, data)

    wanted = differentiate(force, values[free], box=box_of(table))
    predicted, slopes = model.linear(values, data, free=free)
    np.testing.assert_allclose(predicted, model.predict(values, data), rtol=1e-12)
    assert not slopes[:, ~free].any()
    got = slopes[:, free]
    size = np.maximum(np.abs(wanted).max(axis=0), 1e-9)
    off = np.abs(got - wanted) / size
    assert np.quantile(off, 0.98) < 1e-4  # a sample at a kink has a slope on either side
    assert np.median(off.max(axis=0)) < 1e-4
    assert (np.abs(wanted).max(axis=0) > 0).any()


@each("effect", EFFECTS_OF_ALL)
def test_slopes_of_an_effect_are_those_of_differences(effect: Effect) -> None:
    data = data_for(effect)
    assert effect.analytic == (effect.key not in BY_DIFFERENCES)
    if not effect.absent(data):
        assert_same_slopes(Model(PUNCH) + effect, data)


def with_resultants() -> Observations:
    """Points of the rich data with the forces of the inverse step, at a stated E."""
    data, rng = RICH.samples(RICH.depth_mm > 0.1), np.random.default_rng(3)
    share = rng.uniform(0.5, 1.5, (5, data.size))
    found = Resultants(share[0], 0.02 * share[1], data.depth_mm, 1.2 * share[2], -0.5 * share[3], 0.2 * share[4])
    return replace(data, resultants=found, gel=replace(data.gel, youngs_modulus_MPa=0.2))


def with_faces() -> Observations:
    """Points whose reconstructed depth is known next to a certified one."""
    data = RICH.samples(RICH.depth_mm > 0.1)
    return replace(data, depth_source="gauge", reconstructed_std_mm=0.01 * data.depth_mm)


@each(
    "model, data",
    [
        (Model(FlatPunch(free_poisson_ratio=True, sticking=1.0, bent=True)), WITH_EDGES),
        (Model(Paper()) + EFFECTS["depth_zero"], WITH_EDGES),
        (Model(PUNCH) + EFFECTS["edge_fillet"] + EFFECTS["thickness"] + EFFECTS["skin"], RICH),
        (Model(PUNCH) + EFFECTS["tilt"] + EFFECTS["depth_zero"] + EFFECTS["viscoelasticity"], WITH_EDGES),
        (
            Model(PUNCH) + EFFECTS["backing_compliance"] + EFFECTS["adhesion"],
            replace(WITH_FORCE, depth_source="stage"),
        ),
        (Model(RoundBody("sphere")) + EFFECTS["depth_zero"], BALLS.take([0, 1])),
        (Model(Resultant()) + EFFECTS["cut_contact"] + EFFECTS["photometric_gain"], with_resultants()),
        (Model(ReconstructedDepth()) + in_picture("bevel_rise"), with_faces()),
        (with_tolerances(Model(PUNCH), TOLERANT), TOLERANT),
    ],
)
def test_slopes_of_a_law_are_those_of_differences(model: Model, data: Observations) -> None:
    assert_same_slopes(model, data, seed=1)


def test_a_function_without_a_slope_is_refused() -> None:
    number = Dual(np.array([0.5, 0.7]), np.eye(2))
    with pytest.raises(TypeError, match="no derivative"):
        np.asarray(number)
    with pytest.raises(TypeError):
        np.floor(number)
    with pytest.raises(TypeError):
        np.cumsum(number)


def test_a_value_that_is_not_chosen_does_not_spoil_the_slope() -> None:
    x = Dual(np.array([2.0, 3.0]), np.ones((1, 2)))
    for both in ((np.array([5.0, np.nan]) * x, x), (np.array([5.0, np.nan]) * x, 7.0)):
        chosen: Any = np.where([True, False], *both)
        np.testing.assert_array_equal(chosen.whole, [[5.0, float(both[1] is x)]])
