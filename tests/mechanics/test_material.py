"""Moduli of the gel, and those of the neo-Hookean solid."""

from __future__ import annotations

import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.material import neo_hooke
from tactilevision.mechanics.punch_equation import positive
from tactilevision.records.measured import Material


@each("nu", [0.0, 0.3, 0.49])
def test_moduli_agree_with_each_other(nu: float) -> None:
    gel = Material(0.2, nu)
    mu, bulk = gel.shear_modulus_MPa, gel.bulk_modulus_MPa
    assert 9 * bulk * mu / (3 * bulk + mu) == pytest.approx(0.2, rel=1e-12)


def test_neo_hooke_of_the_published_gel() -> None:
    assert neo_hooke(Material(0.1981, 0.4797)) == pytest.approx((0.0335, 1.2297), abs=5e-5)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="thickness_mm"):
        positive("thickness_mm", -0.1)
    with pytest.raises(InputError, match="Young"):
        Material(-0.1, 0.48)
    with pytest.raises(InputError, match="Poisson"):
        Material(0.2, 0.6)
    with pytest.raises(InputError, match=r"\.4999"):
        Material(0.2, 0.5)
