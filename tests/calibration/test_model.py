"""A law and its effects compose in one way, and switched off they are the law."""

from __future__ import annotations

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.effects.depth_zero import DepthZero
from calibration.effects.viscoelasticity import Viscoelasticity
from calibration.laws.flat_punch import FlatPunch
from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import kappa

RAMP = np.linspace(0.05, 0.6, 12)
DATA = observations([RAMP, RAMP], [indenter("A", 2.5), indenter("B", 1.5)])


def test_the_law_is_the_equation_written_out() -> None:
    force = FlatPunch() + DepthZero()
    values = np.array([0.2, 0.48, 1.1, 0.9, 0.01])  # E, nu, beta of 1.5 mm, of 2.5 mm, w0
    got = force.predict(values, DATA)
    for press, (a, beta) in enumerate([(2.5, 0.9), (1.5, 1.1)]):
        w = RAMP + 0.01
        c = 2 * a * 0.2 * kappa(0.48, a / 3.0) / (1 - 0.48**2)
        np.testing.assert_allclose(got[DATA.press == press], c * w * (1 + beta * w / 3.0), rtol=1e-7)


def test_the_order_of_adding_does_not_matter() -> None:
    one = FlatPunch() + DepthZero() + Viscoelasticity(terms=2)
    other = FlatPunch() + Viscoelasticity(terms=2) + DepthZero()
    assert one == other
    assert one.keys == ("depth_zero", "viscoelasticity")
    assert [p.name for p in one.parameters(DATA)][-2:] == ["viscoelasticity.g_2", "viscoelasticity.tau_2_s"]


def test_an_effect_stands_once() -> None:
    with pytest.raises(InputError, match="depth_zero"):
        FlatPunch() + DepthZero() + DepthZero()


def test_without_takes_an_effect_out_again() -> None:
    assert (FlatPunch() + DepthZero()).without("depth_zero").effects == ()


def test_a_step_that_is_held_relaxes_as_the_series_says() -> None:
    time = np.array([0.0, 1e-6, 1.0, 2.0, 5.0, 20.0])
    depth = np.array([0.0, 0.3, 0.3, 0.3, 0.3, 0.3])
    data = observations([depth], [indenter()], time_s=[time])
    model = FlatPunch() + Viscoelasticity()
    values = np.array([0.2, 0.48, 0.8, 0.25, 3.0])
    force = model.predict(values, data)
    np.testing.assert_allclose(force[1:] / force[1], 1 - 0.25 * -np.expm1(-time[1:] / 3.0), rtol=1e-5)


def test_the_slope_is_the_derivative() -> None:
    model = FlatPunch() + DepthZero()
    values = np.array([0.2, 0.48, 1.1, 0.9, 0.0])
    w, a = RAMP, 2.5
    c = 2 * a * 0.2 * kappa(0.48, a / 3.0) / (1 - 0.48**2)
    np.testing.assert_allclose(model.slope(values, DATA)[:12], c * (1 + 2 * 0.9 * w / 3.0), rtol=1e-6)
