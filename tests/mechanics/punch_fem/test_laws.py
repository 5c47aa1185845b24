"""Every law's stress is the slope of its energy, its tangent the slope of its stress; limits and objectivity."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.laws import IDENTITY, Gent, Hencky, Law, NeoHooke, Yeoh, deformation
from tactilevision.records.measured import Floats

LAWS: tuple[Law, ...] = (NeoHooke(), Yeoh(0.1, 0.02), Gent(20.0), Hencky())
IDS = [law.name for law in LAWS]
STEP = 1e-6


def some_deformations(size: float, count: int = 40) -> Floats:
    """Random deformation gradients (count, 5) around the identity."""
    return IDENTITY + size * np.random.default_rng(5).uniform(-1, 1, (count, 5))


def moved(F: Floats, component: int, by: float) -> Floats:
    """F with one component changed."""
    changed = F.copy()
    changed[:, component] += by
    return changed


@each("law", LAWS)
@each("size", [0.3, 0.01])
def test_stress_is_the_slope_of_the_energy(law: Law, size: float) -> None:
    F = some_deformations(size)
    stress, _ = law.distortion(deformation(F), 0.7)
    for i in range(5):
        above, below = (law.energy(deformation(moved(F, i, s * STEP)), 0.7) for s in (1, -1))
        np.testing.assert_allclose(stress[:, i], (above - below) / (2 * STEP), atol=2e-8)


@each("law", LAWS)
@each("size", [0.3, 0.01])
def test_tangent_is_the_slope_of_the_stress(law: Law, size: float) -> None:
    F = some_deformations(size)
    _, tangent = law.distortion(deformation(F), 0.7)
    np.testing.assert_allclose(tangent, tangent.transpose(0, 2, 1), atol=1e-12)
    for i in range(5):
        above, below = (law.distortion(deformation(moved(F, i, s * STEP)), 0.7)[0] for s in (1, -1))
        np.testing.assert_allclose(tangent[:, :, i], (above - below) / (2 * STEP), atol=1e-7)


@each("law", LAWS)
def test_volume_measure_and_its_slopes(law: Law) -> None:
    J = np.linspace(0.5, 1.8, 30)
    g, dg, ddg = law.volume(J)
    above, below = law.volume(J + STEP), law.volume(J - STEP)
    np.testing.assert_allclose(dg, (above[0] - below[0]) / (2 * STEP), rtol=1e-7)
    np.testing.assert_allclose(ddg, (above[1] - below[1]) / (2 * STEP), atol=1e-7)
    assert np.all(np.diff(g) > 0)


@each("law", LAWS)
def test_energy_knows_neither_rotation_nor_dilatation(law: Law) -> None:
    F = some_deformations(0.2)
    cosine, sine = np.cos(0.8), np.sin(0.8)
    turned = F.copy()
    turned[:, 0], turned[:, 1] = cosine * F[:, 0] - sine * F[:, 2], cosine * F[:, 1] - sine * F[:, 3]
    turned[:, 2], turned[:, 3] = sine * F[:, 0] + cosine * F[:, 2], sine * F[:, 1] + cosine * F[:, 3]
    energy = law.energy(deformation(F), 1.0)
    np.testing.assert_allclose(law.energy(deformation(turned), 1.0), energy, atol=1e-12)
    np.testing.assert_allclose(law.energy(deformation(1.3 * F), 1.0), energy, atol=1e-12)


@each("law", LAWS)
def test_small_strain_is_linear_elasticity(law: Law) -> None:
    strain = 1e-6 * np.random.default_rng(2).uniform(-1, 1, (20, 5))
    stress, _ = law.distortion(deformation(IDENTITY + strain), 0.7)
    mean = strain[:, [0, 3, 4]].mean(axis=1)
    shear = (strain[:, 1] + strain[:, 2]) / 2
    expected = (
        2 * 0.7 * np.stack([strain[:, 0] - mean, shear, shear, strain[:, 3] - mean, strain[:, 4] - mean], -1)
    )
    np.testing.assert_allclose(stress, expected, atol=3e-11)


def test_yeoh_and_gent_tend_to_neo_hooke() -> None:
    state = deformation(some_deformations(0.2))
    plain = NeoHooke().distortion(state, 1.0)[0]
    np.testing.assert_allclose(Yeoh(0.0, 0.0).distortion(state, 1.0)[0], plain, rtol=1e-14)
    np.testing.assert_allclose(Gent(1e9).distortion(state, 1.0)[0], plain, atol=1e-8)


def test_gent_beyond_its_limit_is_not_a_number() -> None:
    state = deformation(np.array([[2.0, 0.0, 0.0, 0.25, 2.0]]))
    assert np.isnan(Gent(3.0).distortion(state, 1.0)[0]).all()
    with pytest.raises(InputError, match="above 0"):
        Gent(0.0)
