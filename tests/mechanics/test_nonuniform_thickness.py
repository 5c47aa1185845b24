"""The equivalent thickness of uneven gel: the energy at the base is the derivative of the stiffness."""

from __future__ import annotations

from typing import TypedDict

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import kappa, kappa_gradient
from tactilevision.mechanics.nonuniform_thickness import base_energy, base_stress, equivalent_thickness

PX = (0.1, 0.1)


class Punch(TypedDict):
    mm_per_px: tuple[float, float]
    radius_mm: float
    poisson_ratio: float


PUNCH = Punch(mm_per_px=PX, radius_mm=2.5, poisson_ratio=0.48)


@each("nu", [0.0, 0.3, 0.48, 0.499])
@each("alpha", [0.3, 2.5 / 3, 2.0])
def test_energy_at_the_base_is_the_derivative_of_the_stiffness(nu: float, alpha: float) -> None:
    # c = 2 a E kappa/(1 - nu^2): Int W dA = -(1/2) dc/dh = (a/(1 - nu^2)) kappa' a/h^2
    a, h = alpha * 3.0, 3.0
    t, weights = np.polynomial.legendre.leggauss(300)
    r, weights = (t + 1) / 2 * (a + 8 * h), weights * (a + 8 * h) / 2
    energy = base_energy(r, radius_mm=a, thickness_mm=h, poisson_ratio=nu)
    total = float(np.sum(weights * 2 * np.pi * r * energy))
    assert total == pytest.approx(a / (1 - nu**2) * kappa_gradient(nu, alpha)[1] * a / h**2, rel=1e-4)


def test_long_waves_pass_the_layer_unchanged() -> None:
    normal, shear = base_stress(np.array([1e-3]), 0.4)
    assert abs(normal[0]) == pytest.approx(1, abs=1e-4)
    assert abs(shear[0]) < 2e-3


def test_even_gel_and_wedge_keep_their_thickness() -> None:
    x = (np.arange(201) - 100)[None, :] * PX[0] * np.ones((201, 1))
    known = np.ones(x.shape, bool)
    assert equivalent_thickness(np.full(x.shape, 3.0), known, centre_mm=(0.0, 0.0), **PUNCH) == pytest.approx(
        3.0, abs=1e-12
    )
    assert equivalent_thickness(3 + 0.05 * x, known, centre_mm=(0.0, 0.0), **PUNCH) == pytest.approx(3.0, abs=1e-9)


def test_thickness_near_the_punch_counts() -> None:
    x = (np.arange(201) - 100) * PX[0]
    r = np.hypot(x[None, :], x[:, None])
    known = np.ones(r.shape, bool)
    inner = equivalent_thickness(np.where(r < 2.5, 3.1, 3.0), known, centre_mm=(0.0, 0.0), **PUNCH)
    outer = equivalent_thickness(np.where(r > 6.0, 3.1, 3.0), known, centre_mm=(0.0, 0.0), **PUNCH)
    assert inner == pytest.approx(3.029, abs=0.002)  # at nu = .48 the face holds 29 % of the weight
    assert 3.0 <= outer < 3.005
    assert kappa(0.48, 2.5 / inner) < kappa(0.48, 2.5 / 3)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="lacks"):
        equivalent_thickness(np.full((50, 50), 3.0), np.ones((50, 50), bool), centre_mm=(9.0, 0.0), **PUNCH)
    with pytest.raises(InputError, match="thickness_mm"):
        equivalent_thickness(np.full((90, 90), -3.0), np.ones((90, 90), bool), centre_mm=(0.0, 0.0), **PUNCH)
