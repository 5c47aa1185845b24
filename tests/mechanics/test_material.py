"""Moduli, the way from c to E and back, and how E moves with what it was computed from."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics import material
from tactilevision.mechanics.kappa import kappa

PUNCH = {"radius_mm": 2.5, "thickness_mm": 3.0}


def test_modulus_of_the_published_stiffness() -> None:
    # c = 3.4943 N/mm, nu = .4797 at the true a/h = .8333: .1915 MPa; at a/h = .8: .1988 (figures of the literature
    # recomputed with the exact kappa)
    assert material.youngs_modulus(3.4943, 0.4797, **PUNCH) == pytest.approx(0.1915, abs=5e-5)
    assert material.youngs_modulus(3.4943, 0.4797, radius_mm=2.5, thickness_mm=3.125) == pytest.approx(
        0.1988, abs=5e-5
    )


def test_stiffness_and_modulus_are_inverse() -> None:
    nu = np.linspace(0, 0.5, 7)
    c = material.contact_stiffness(0.2, nu, **PUNCH)
    np.testing.assert_allclose(material.youngs_modulus(c, nu, **PUNCH), 0.2, rtol=1e-14)
    assert c[0] == pytest.approx(2 * 2.5 * 0.2 * kappa(0.0, 2.5 / 3), rel=1e-7)


def test_modulus_moves_with_poisson_ratio_at_fixed_stiffness() -> None:
    low, high = material.youngs_modulus(1.0, np.array([0.45, 0.5]), **PUNCH) / (1 - np.array([0.45, 0.5]) ** 2)
    assert low / high - 1 == pytest.approx(0.13, abs=0.01)  # E/(1 - nu^2) moves 13 % from nu = .45 to .5


def test_moduli_agree_with_each_other() -> None:
    E, nu = 0.2, np.array([0.0, 0.3, 0.49])
    mu, bulk = material.shear_modulus(E, nu), material.bulk_modulus(E, nu)
    np.testing.assert_allclose(material.constrained_modulus(E, nu), bulk + 4 / 3 * mu, rtol=1e-12)
    np.testing.assert_allclose(material.reduced_modulus(E, nu), 4 * mu * (3 * bulk + mu) / (3 * bulk + 4 * mu))


def test_neo_hooke_of_the_published_gel() -> None:
    c10, d1 = material.neo_hooke(0.1981, 0.4797)
    assert c10 == pytest.approx(0.0335, abs=5e-5)
    assert d1 == pytest.approx(1.2297, abs=5e-5)
    assert material.moduli_of_neo_hooke(c10, d1) == pytest.approx((0.1981, 0.4797), rel=1e-12)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="youngs_modulus_MPa"):
        material.contact_stiffness(-0.1, 0.48, **PUNCH)
    with pytest.raises(InputError, match="Poisson"):
        material.shear_modulus(0.2, 0.6)
    with pytest.raises(InputError, match=r"\.4999"):
        material.bulk_modulus(0.2, 0.5)
    with pytest.raises(InputError, match="a/h"):
        material.youngs_modulus(1.0, 0.48, radius_mm=2.5, thickness_mm=0.1)
