"""Moduli of the gel, and those of the neo-Hookean solid."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics import material


def test_moduli_agree_with_each_other() -> None:
    E, nu = 0.2, np.array([0.0, 0.3, 0.49])
    mu, bulk = material.shear_modulus(E, nu), material.bulk_modulus(E, nu)
    np.testing.assert_allclose(9 * bulk * mu / (3 * bulk + mu), E, rtol=1e-12)


def test_neo_hooke_of_the_published_gel() -> None:
    c10, d1 = material.neo_hooke(0.1981, 0.4797)
    assert c10 == pytest.approx(0.0335, abs=5e-5)
    assert d1 == pytest.approx(1.2297, abs=5e-5)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="youngs_modulus_MPa"):
        material.shear_modulus(-0.1, 0.48)
    with pytest.raises(InputError, match="Poisson"):
        material.shear_modulus(0.2, 0.6)
    with pytest.raises(InputError, match=r"\.4999"):
        material.bulk_modulus(0.2, 0.5)
