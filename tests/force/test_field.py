"""Planted forces come back; what limits a map is said; a wrong material does what it should."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from planted_forces import GEL, MATERIAL, SCALE, VIEW, displacement, hertz, measured

from tactilevision.errors import InputError
from tactilevision.force.calibrated import material_sensitivity
from tactilevision.force.compliance import solve
from tactilevision.force.field import CUT, NO_CONTACT, NO_SHEAR, SMALL_GEL, ForceField, ForceSettings
from tactilevision.records.maps import HeightMap, Positions, ShearMap
from tactilevision.records.measured import Material
from tactilevision.records.rig import Gel

LINEAR = ForceSettings(large_depth=False)
FORCE = (0.12, -0.08, 0.6)


@pytest.fixture(scope="module")
def field() -> ForceField:
    return ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape, settings=LINEAR)


@pytest.fixture(scope="module")
def press() -> tuple[HeightMap, ShearMap]:
    return measured(hertz(2.0, (0.4, -0.3), FORCE))


def test_a_planted_force_and_its_moment_come_back_within_their_deviations(
    field: ForceField, press: tuple[HeightMap, ShearMap]
) -> None:
    found = field(*press)
    off = np.subtract(found.resultant_N, FORCE)
    assert np.abs(off).max() < 0.02 * np.linalg.norm(FORCE)
    assert (np.abs(off) < 3 * np.asarray(found.resultant_std_N)).all()
    moment = (-0.3 * FORCE[2], -0.4 * FORCE[2], 0.4 * FORCE[1] + 0.3 * FORCE[0])
    assert found.moment_Nmm == pytest.approx(moment, abs=0.012)
    assert found.flags == ()


def test_depth_at_positions_of_the_untouched_gel_is_not_moved_once_more(field: ForceField) -> None:
    u = displacement(hertz(2.0, (0.4, -0.3), FORCE))
    everywhere = np.ones(VIEW.shape, dtype=bool)
    shear = ShearMap(u[0], u[1], everywhere, SCALE, std_mm=1e-4)
    forces = {}
    for positions in get_args(Positions):
        height = HeightMap(u[2], everywhere, SCALE, np.full(VIEW.shape, 1e-4), positions=positions)
        forces[positions] = field(height, shear).resultant_N[2]
    assert forces["undeformed"] == pytest.approx(FORCE[2], rel=0.005)
    assert abs(forces["deformed"] / FORCE[2] - 1) > 0.01
    with pytest.raises(InputError, match="positions are"):
        HeightMap(u[2], everywhere, SCALE, positions="elsewhere")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("shape", "said"),
    [("torus", "not solved"), ("dome", "curvature_mm"), ("disc", "radius_mm"), ("rectangle", "size_mm")],
)
def test_a_gel_that_is_not_solved_is_refused_and_not_taken_for_a_flat_layer(shape: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Gel(3.0, shape=shape)


def test_two_contacts_keep_their_own_forces(field: ForceField) -> None:
    left, right = hertz(1.6, (-4.5, 1.0), (0.1, 0.0, 0.4)), hertz(1.8, (4.5, -1.0), (-0.1, 0.05, 0.5))
    found = field(*measured(left + right))
    middle = found.t_z.shape[1] // 2
    cell = found.mm_per_px[0] ** 2
    assert cell * found.t_z[:, :middle].sum() == pytest.approx(0.4, rel=0.03)
    assert cell * found.t_z[:, middle:].sum() == pytest.approx(0.5, rel=0.03)
    assert cell * found.t_x[:, :middle].sum() == pytest.approx(0.1, abs=0.012)


def test_a_weak_contact_beside_a_deep_one_keeps_its_force(field: ForceField) -> None:
    """Its depth is less than the rise that the deep one makes, and a twentieth of the deep one's."""
    deep, weak = hertz(2.2, (-5.0, 0.0), (0.0, 0.0, 1.2)), hertz(1.2, (4.5, 1.0), (0.0, 0.0, 0.02))
    for seed in range(3):
        found = field(*measured(deep + weak, std_mm=0.002, seed=seed))
        middle = found.t_z.shape[1] // 2 + 3
        right = found.mm_per_px[0] ** 2 * found.t_z[:, middle:].sum()
        assert right == pytest.approx(0.02, rel=0.3)
        none = field(*measured(deep, std_mm=0.002, seed=seed))
        assert none.t_z[:, middle:].sum() == 0, "and where there is none, none is found"


def test_scatter_over_noise_is_what_propagation_says(field: ForceField) -> None:
    truth = hertz(1.8, (0.0, 0.0), FORCE)
    forces = np.array([field(*measured(truth, std_mm=0.02, seed=seed)).resultant_N for seed in range(12)])
    alone = ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape, settings=LINEAR)(*measured(truth, std_mm=0.02))
    scatter = forces.std(axis=0, ddof=1)
    assert (scatter < 1.6 * np.asarray(alone.resultant_std_N)).all()
    assert (np.abs(forces - FORCE).max(axis=0) < 4 * np.asarray(alone.resultant_std_N)).all()
    off = np.abs(forces.mean(axis=0) - FORCE)
    assert (off < 3 * scatter / np.sqrt(len(forces)) + 0.004 * np.abs(FORCE)).all(), "no clipping bias"


def test_no_cell_pulls_unless_the_gel_may_be_pulled(field: ForceField, press: tuple[HeightMap, ShearMap]) -> None:
    assert field(*press).t_z.min() >= 0


def test_a_modulus_off_by_a_tenth_gives_a_force_off_by_a_tenth(
    field: ForceField, press: tuple[HeightMap, ShearMap]
) -> None:
    softer = ForceField(GEL, replace(MATERIAL, youngs_modulus_MPa=0.22), SCALE, settings=LINEAR)
    ratio = np.divide(softer(*press).resultant_N, field(*press).resultant_N)
    assert ratio == pytest.approx(1.1, rel=1e-9)


def test_poissons_ratio_off_moves_the_force_as_its_derivative_says(press: tuple[HeightMap, ShearMap]) -> None:
    def force(nu: float) -> float:
        return ForceField(GEL, Material(0.2, nu), SCALE, settings=LINEAR)(*press).resultant_N[2]

    certain = ForceField(GEL, MATERIAL, SCALE, settings=LINEAR)(*press)
    unsure = ForceField(GEL, Material(0.2, 0.48, np.diag([0.0, 0.005**2])), SCALE, settings=LINEAR)(*press)
    share = np.sqrt(unsure.resultant_std_N[2] ** 2 - certain.resultant_std_N[2] ** 2)
    slope = (force(0.485) - force(0.475)) / 0.01
    assert share == pytest.approx(abs(slope) * 0.005, rel=0.15)
    # A layer that yields less by nu is pushed harder for the same depth: 3 to 5 per unit of nu, as for a punch.
    assert force(0.48 - 0.02) / force(0.48) == pytest.approx(np.exp(-0.02 * slope / force(0.48)), rel=0.03)
    assert 1 < slope / force(0.48) < 8


def test_sensitivity_spans_the_calibrations_own_interval(press: tuple[HeightMap, ShearMap]) -> None:
    material = Material(0.2, 0.48, np.diag([0.01**2, 0.004**2]))
    field = ForceField(GEL, material, SCALE, settings=LINEAR)
    modulus, poisson, both = material_sensitivity(field, field(*press), *press)
    stiffer = ForceField(GEL, replace(material, youngs_modulus_MPa=modulus.values[1]), SCALE, settings=LINEAR)
    assert modulus.force_N[1] == pytest.approx(stiffer(*press).resultant_N, rel=1e-9)
    assert modulus.force_N[1, 2] / modulus.force_N[0, 2] == pytest.approx(modulus.values[1] / modulus.values[0])
    assert poisson.force_N[1, 2] > poisson.force_N[0, 2]
    alone = [np.ptp(one.force_N[:, 2]) / 2 for one in (modulus, poisson)]
    assert np.ptp(both.force_N[:, 2]) / 2 == pytest.approx(np.hypot(alone[0], alone[1]), rel=0.01)
    tied = np.array([[0.01**2, -0.01 * 0.004], [-0.01 * 0.004, 0.004**2]])
    aware = ForceField(GEL, replace(material, covariance=tied), SCALE, settings=LINEAR)
    known = material_sensitivity(aware, field(*press), *press)[2]
    assert np.ptp(known.force_N[:, 2]) / 2 == pytest.approx(abs(alone[0] - alone[1]), rel=0.01)
    assert material_sensitivity(ForceField(GEL, MATERIAL, SCALE), field(*press), *press) == ()


def test_without_shear_the_tangential_force_is_unknown_and_the_normal_one_less_sure(field: ForceField) -> None:
    force = (0.024, -0.016, 0.12)
    press = measured(hertz(2.0, (0.4, -0.3), force))
    found, both = field(press[0]), field(*press)
    assert NO_SHEAR in found.flags
    assert np.isnan(found.resultant_N[:2]).all()
    assert found.resultant_std_N[2] > 1.2 * both.resultant_std_N[2]
    assert abs(found.resultant_N[2] - force[2]) < 2 * found.resultant_std_N[2]


def test_an_untouched_gel_is_no_contact(field: ForceField) -> None:
    found = field(*measured(np.zeros((3, 360, 480))))
    assert NO_CONTACT in found.flags
    assert found.resultant_N == (0.0, 0.0, 0.0)
    assert 0 < found.resultant_std_N[2] < 0.02


def test_cells_that_all_would_pull_are_no_contact(field: ForceField) -> None:
    assert field.compliance is not None
    cells = np.array([300, 301, 302])
    u = np.concatenate([np.zeros((2, 3)), np.full((1, 3), -0.1)])
    for parts in (1, 3):
        sunk = solve(field.compliance, cells, displacement_mm=u[-parts:], std_mm=np.full(parts, 0.001))
        assert len(sunk.cells) == 0


def test_a_contact_cut_by_the_border_is_flagged_and_less_sure(field: ForceField) -> None:
    whole, cut = field(*measured(hertz(2.0, (0, 0), FORCE))), field(*measured(hertz(2.0, (9.6, 0), FORCE)))
    assert CUT in cut.flags
    assert CUT not in whole.flags
    assert cut.resultant_std_N[2] > 5 * whole.resultant_std_N[2]


def test_pixels_that_are_not_known_are_bridged_or_cut(
    field: ForceField, press: tuple[HeightMap, ShearMap]
) -> None:
    height, shear = press
    holes = height.valid.copy()
    holes[40:42, 55:58] = False
    depth = np.where(holes, height.depth_mm, np.nan)
    found = field(replace(height, depth_mm=depth, valid=holes), shear)
    assert found.resultant_N[2] == pytest.approx(FORCE[2], rel=0.03)


def test_shear_lost_over_half_of_the_view_is_not_used(
    field: ForceField, press: tuple[HeightMap, ShearMap]
) -> None:
    height, shear = press
    few = np.zeros_like(shear.valid)
    few[:30] = True
    lost = field(height, replace(shear, valid=few, flags=("markers lost: 90 of 100",)))
    assert any("lost" in flag for flag in lost.flags)
    assert np.isnan(lost.resultant_N[0])
    some = shear.valid.copy()
    some[45:48, 60:63] = False
    assert any("bridged" in flag for flag in field(height, replace(shear, valid=some)).flags)


def test_depths_alone_are_no_height_map(field: ForceField, press: tuple[HeightMap, ShearMap]) -> None:
    with pytest.raises(InputError, match="takes a height map"):
        field(press[0].depth_mm)  # type: ignore[arg-type]


def test_maps_of_another_sensor_are_refused(field: ForceField, press: tuple[HeightMap, ShearMap]) -> None:
    height, shear = press
    with pytest.raises(InputError, match="another scale"):
        field(replace(height, mm_per_px=(0.1, 0.1)), shear)
    with pytest.raises(InputError, match="another size"):
        field(HeightMap(height.depth_mm[1:], height.valid[1:], SCALE))
    with pytest.raises(InputError, match="scale in mm"):
        HeightMap(height.depth_mm, height.valid, (0.0, 0.1))
    with pytest.raises(InputError, match=r"\[0, 0\.5\)"):
        ForceField(GEL, Material(0.2, 0.5), SCALE)


def test_a_gel_smaller_than_the_view_is_flagged(press: tuple[HeightMap, ShearMap]) -> None:
    small = Gel(3.0, shape="rectangle", size_mm=(16.0, 13.0))
    found = ForceField(small, MATERIAL, SCALE, settings=ForceSettings(sides=False, large_depth=False))(*press)
    assert SMALL_GEL in found.flags
    with pytest.raises(InputError, match="no part of the view"):
        ForceField(Gel(3.0, shape="disc", radius_mm=0.1), MATERIAL, SCALE)(*press)
