"""The layer's compliance against the half-space, its other limits, reciprocity and an independent solution."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from scipy.linalg import expm

from tactilevision.errors import InputError
from tactilevision.mechanics.layer import layer_compliance, surface_compliance
from tactilevision.mechanics.punch_equation import layer_defect


@each("nu", [0.0, 0.3, 0.48, 0.5])
def test_short_waves_see_a_half_space(nu: float) -> None:
    u = np.array([30.0, 500.0, 1e5])
    part = layer_compliance(u, nu)
    np.testing.assert_allclose(part.normal * u, 1 - nu, rtol=1e-12)
    np.testing.assert_allclose(part.along * u, 1 - nu, rtol=1e-12)
    np.testing.assert_allclose(part.across * u, 1, rtol=1e-12)
    np.testing.assert_allclose(part.coupling * u, (1 - 2 * nu) / 2, atol=1e-12)


@each("nu", [0.0, 0.3, 0.48, 0.4999])
def test_long_waves_compress_and_shear_uniformly(nu: float) -> None:
    mean = surface_compliance(0.0, 0.0, youngs_modulus_MPa=0.2, poisson_ratio=nu, thickness_mm=3.0)
    shear = 3.0 / (0.2 / (2 * (1 + nu)))
    modulus = 0.2 * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    np.testing.assert_allclose(mean, np.diag([shear, shear, 3.0 / modulus]), rtol=1e-12)


def test_incompressible_layer_resists_long_waves_with_the_square_of_the_wave_number() -> None:
    u = np.array([1e-6, 1e-4, 1e-2])  # lubrication limit: C_zz = (h/mu) u^2/3
    np.testing.assert_allclose(layer_compliance(u, 0.5).normal / (u**2 / 3), 1, rtol=1e-3)


def test_series_and_closed_form_meet() -> None:
    u = np.array([0.05 * (1 - 1e-9), 0.05 * (1 + 1e-9)])
    below, above = layer_compliance(u, 0.5).normal
    assert above / below - 1 == pytest.approx(4e-9, abs=1e-10)


@each("nu", [0.0, 0.3, 0.45, 0.499])
@each("u", [0.01, 0.5, 1.0, 4.0])
def test_against_an_independent_solution_of_the_layer(nu: float, u: float) -> None:
    # Navier's equations for exp(i x) through the thickness as a first-order system, solved by a matrix exponential
    ratio = 1 / (1 - 2 * nu)
    system = np.array(
        [[0, 1, 0, 0], [1 / (1 + ratio), 0, 0, ratio / (1 + ratio)], [0, 0, 0, 1], [0, -ratio, 1 + ratio, 0]]
    )
    lame = 2 * nu * ratio
    traction = np.array([[0, -(lame + 2), lame, 0], [-1, 0, 0, -1.0]])
    conditions = np.vstack([traction, expm(system * u)[[0, 2]]])
    solution = np.linalg.solve(conditions, np.eye(4)[:, :2])[[0, 2]]
    part = layer_compliance(u, nu)
    ours = np.array([[part.normal, part.coupling], [part.coupling, part.along]]) * u
    np.testing.assert_allclose(ours, solution, rtol=1e-7, atol=1e-12)


def test_reciprocity_and_positive_energy() -> None:
    rng = np.random.default_rng(3)
    kx, ky = rng.normal(scale=2, size=(2, 200))
    for nu in (0.0, 0.4, 0.499):
        matrix = surface_compliance(kx, ky, youngs_modulus_MPa=1.0, poisson_ratio=nu, thickness_mm=2.0)
        np.testing.assert_allclose(matrix, np.conj(np.swapaxes(matrix, -1, -2)), atol=1e-15)
        assert np.linalg.eigvalsh(matrix).min() > 0


def test_compliance_turns_with_the_wave() -> None:
    angle, case = 0.7, {"youngs_modulus_MPa": 1.0, "poisson_ratio": 0.4, "thickness_mm": 2.0}
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    straight = surface_compliance(1.3, 0.0, **case)
    turned = surface_compliance(1.3 * np.cos(angle), 1.3 * np.sin(angle), **case)
    np.testing.assert_allclose(turned, turn @ straight @ turn.T, atol=1e-14)


def test_normal_part_is_the_kernel_of_kappa() -> None:
    u = np.linspace(0.001, 20, 400)
    for nu in (0.0, 0.45, 0.5):
        np.testing.assert_allclose(
            layer_compliance(u, nu).normal * u / (1 - nu), 1 - layer_defect(u, nu), atol=1e-14
        )


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="wave number"):
        layer_compliance(np.array([1.0, -1.0]), 0.4)
    with pytest.raises(InputError, match="Poisson"):
        layer_compliance(1.0, 0.6)
    with pytest.raises(InputError, match="thickness_mm"):
        surface_compliance(1.0, 0.0, youngs_modulus_MPa=1.0, poisson_ratio=0.4, thickness_mm=0.0)
