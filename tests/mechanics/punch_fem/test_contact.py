"""The punch's outline, the return map and the contact's tangent, each against differences."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.contact import RoundedPunch, signed_gap, slip, touch, untouched
from tactilevision.mechanics.punch_fem.problem import Model, PunchProblem, build
from tactilevision.records.measured import Floats, Material

STEP = 1e-7


def coarse_model(friction: float) -> Model:
    """A small pad under a punch with a large edge radius."""
    return build(PunchProblem(Material(1.0, 0.45), RoundedPunch(1.0, 0.3, friction), 1.0, 4.0, penalty=50.0))


def test_gap_of_named_places() -> None:
    punch = RoundedPunch(1.0, 0.2)
    place = np.array([[0.3, 0.0], [0.3, 0.05], [0.8 + 0.2 / math.sqrt(2), 0.2 - 0.2 / math.sqrt(2)], [1.3, 2.0]])
    gap, normal, curvature = signed_gap(punch, place)
    np.testing.assert_allclose(gap, [0.0, -0.05, 0.0, 0.3], atol=1e-15)
    np.testing.assert_allclose(normal[[0, 3]], [[0, -1], [1, 0]], atol=1e-15)
    np.testing.assert_allclose(curvature, [0, 0, 5, 0], atol=1e-12)


def test_normal_is_the_slope_of_the_gap() -> None:
    place = np.random.default_rng(1).uniform([0.4, -0.2], [1.2, 0.6], (200, 2))
    punch = RoundedPunch(1.0, 0.2)
    for axis in range(2):
        shift = STEP * np.eye(2)[axis]
        slope = (signed_gap(punch, place + shift)[0] - signed_gap(punch, place - shift)[0]) / (2 * STEP)
        np.testing.assert_allclose(signed_gap(punch, place)[1][:, axis], slope, atol=1e-6)


def test_slip_is_capped_by_coulomb_and_smooth() -> None:
    trial, pressure = np.linspace(-2, 2, 401), np.full(401, 1.5)
    traction, by_trial, by_pressure = slip(0.4, trial, pressure=pressure)
    assert np.abs(traction).max() == pytest.approx(0.6)
    small = np.abs(trial) < 0.5
    np.testing.assert_allclose(traction[small], trial[small])
    np.testing.assert_allclose(
        by_trial,
        (slip(0.4, trial + STEP, pressure=pressure)[0] - slip(0.4, trial - STEP, pressure=pressure)[0])
        / (2 * STEP),
        atol=1e-6,
    )
    np.testing.assert_allclose(
        by_pressure,
        (slip(0.4, trial, pressure=pressure + STEP)[0] - slip(0.4, trial, pressure=pressure - STEP)[0])
        / (2 * STEP),
        atol=1e-6,
    )
    assert not slip(0.0, trial, pressure=pressure)[0].any()
    np.testing.assert_array_equal(slip(math.inf, trial, pressure=pressure)[0], trial)


@pytest.mark.parametrize("friction", [0.0, 0.3, math.inf])
def test_contact_stiffness_is_the_slope_of_its_forces(friction: float) -> None:
    model = coarse_model(friction)
    surface, punch = model.mesh.surface, model.problem.punch
    assert isinstance(punch, RoundedPunch)
    rng = np.random.default_rng(4)
    u = 0.01 * rng.normal(size=model.mesh.size)
    u[model.mesh.punch] = -0.1
    old = untouched(surface, punch)
    history = replace(old, place_mm=old.place_mm + 0.01, shear_MPa=0.05 + 0 * old.shear_MPa)
    way = rng.normal(size=u.size)

    def force(by: float) -> Floats:
        return touch(surface, punch, stiffness=50.0, u=u + by * way, history=history).force

    here = touch(surface, punch, stiffness=50.0, u=u, history=history)
    assert (here.pressure_MPa > 0).any()
    assert (here.pressure_MPa == 0).any()
    predicted = (here.stiffness @ way[surface.dofs][:, :, None])[:, :, 0]
    difference = (force(STEP) - force(-STEP)) / (2 * STEP)
    np.testing.assert_allclose(predicted, difference, atol=2e-5 * np.abs(difference).max())


def test_forces_on_gel_and_punch_balance() -> None:
    model = coarse_model(0.3)
    surface, punch = model.mesh.surface, model.problem.punch
    assert isinstance(punch, RoundedPunch)
    u = np.zeros(model.mesh.size)
    u[model.mesh.punch] = -0.1
    state = touch(surface, punch, stiffness=50.0, u=u, history=untouched(surface, punch))
    np.testing.assert_allclose(state.force[:, 3:6].sum(axis=1), -state.force[:, 6], atol=1e-12)
    assert state.force[:, 6].sum() < 0


@each("radius, edge, friction", [(1, 0, 0), (1, 1, 0), (1, 0.1, -0.1), (1, 0.1, math.nan)])
def test_impossible_punches_are_refused(radius: float, edge: float, friction: float) -> None:
    with pytest.raises(InputError, match="RoundedPunch"):
        RoundedPunch(radius, edge, friction)
