"""Patches are the planted contacts, a wrench moves as statics says, and no contact is a limit, not a number."""

from __future__ import annotations

import numpy as np
import pytest
from planted_forces import GEL, MATERIAL, SCALE, VIEW, hertz, measured

from tactilevision.errors import InputError
from tactilevision.force.field import NO_CONTACT, NO_SHEAR, ForceField, ForceSettings
from tactilevision.force.patches import PatchTracker
from tactilevision.records.measured import Floats
from tactilevision.records.wrench import Wrench

LEFT, RIGHT = (-4.5, 1.0), (4.5, -1.0)
EMPTY = np.zeros((3, VIEW.shape[0] * VIEW.fine, VIEW.shape[1] * VIEW.fine))


@pytest.fixture(scope="module")
def field() -> ForceField:
    return ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape, settings=ForceSettings(large_depth=False))


def twisted(centre_mm: tuple[float, float]) -> Floats:
    """A pressed patch that is also twisted, so that its shear turns about its centre."""
    whole, (x, y) = hertz(1.8, centre_mm, (0.1, 0.0, 0.5)), VIEW.mesh()
    turn = 0.2 * whole[2]
    added: Floats = np.stack([-turn * (y - centre_mm[1]), turn * (x - centre_mm[0]), 0 * turn])
    return np.asarray(whole + added, float)


def test_patches_add_up_to_the_wrench_and_stand_where_they_were_planted(field: ForceField) -> None:
    planted = hertz(1.6, LEFT, (0.1, 0.0, 0.4)), twisted(RIGHT)
    found = field(*measured(planted[0] + planted[1]))
    assert len(found.patches) == 2
    total = sum(one.wrench.values for one in found.patches)
    assert total == pytest.approx(found.wrench.values, rel=1e-6, abs=1e-9)
    assert found.nodal_N.sum(axis=(1, 2)) == pytest.approx(found.resultant_N, rel=1e-6)
    x, y = VIEW.mesh()
    area = (VIEW.mm_per_px / VIEW.fine) ** 2
    by_place = sorted(found.patches, key=lambda one: one.centre_mm[0])
    for one, centre, traction in zip(by_place, (LEFT, RIGHT), planted, strict=True):
        assert one.centre_mm == pytest.approx(centre, abs=0.1)
        assert np.abs(np.subtract(one.centre_mm, centre) / one.centre_std_mm).max() < 4
        torsion = area * ((x - centre[0]) * traction[1] - (y - centre[1]) * traction[0]).sum()
        assert one.torsion_Nmm == pytest.approx(torsion, abs=max(0.05 * torsion, 4 * one.torsion_std_Nmm))
        assert one.area_mm2 == pytest.approx(np.pi * 1.7**2, rel=0.25)
        assert one.wrench.covariance is not None
        assert np.linalg.eigvalsh(one.wrench.covariance).min() > -1e-12


def test_numbers_of_patches_last_while_they_overlap() -> None:
    track, frame = PatchTracker(), np.zeros((6, 12), dtype=np.intp)
    frame[1:3, 1:3], frame[1:3, 8:10] = 1, 2
    assert track.follow(frame) == {1: 1, 2: 2}
    moved = np.zeros_like(frame)
    moved[2:4, 9:11], moved[4:6, 1:3] = 1, 2  # the second, moved; and one where none was
    assert track.follow(moved) == {1: 2, 2: 3}
    assert track.follow(0 * frame) == {}
    assert track.follow(frame) == {1: 4, 2: 5}


def test_a_wrench_about_another_point_is_that_of_its_forces() -> None:
    rng = np.random.default_rng(0)
    places, forces = rng.normal(size=(2, 5, 3))
    where, turn = rng.normal(size=3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    unit = np.diag(np.arange(1.0, 7.0))

    def about(point: Floats) -> Floats:
        return np.concatenate([forces.sum(axis=0), np.cross(places - point, forces).sum(axis=0)])

    moved = Wrench.of(about(np.zeros(3)), unit).at(where, turn)
    hand = np.linalg.det(turn)
    expected = about(where)
    assert moved.values == pytest.approx([*turn @ expected[:3], *hand * turn @ expected[3:]])
    back = moved.at(np.zeros(3), turn.T)
    assert back.values == pytest.approx(about(np.zeros(3)))
    assert back.covariance == pytest.approx(unit, abs=1e-12)
    blind = Wrench.of(np.array([np.nan, np.nan, 1.0, 0.0, 0.0, np.nan]), unit).at((2.0, 0.0, 0.0))
    assert blind.force_N[2] == 1.0
    assert blind.moment_Nmm[1] == 2.0
    assert np.isnan([*blind.force_N[:2], blind.moment_Nmm[2]]).all()
    with pytest.raises(InputError, match="orthogonal"):
        moved.at(where, 2 * np.eye(3))


def test_what_no_contact_hides_is_limited_and_what_is_not_measured_is_not_zero(field: ForceField) -> None:
    weak = 0.004
    height, shear = measured(EMPTY + hertz(1.0, (1.0, 2.0), (0.0, 0.0, weak)), std_mm=0.02)
    found = field(height)
    assert {NO_CONTACT, NO_SHEAR} <= set(found.flags)
    assert found.resultant_N[2] == 0
    assert weak < found.could_hide_N < 0.1
    assert found.could_hide_N == pytest.approx(1.645 * found.resultant_std_N[2])
    known = [*found.resultant_std_N, *(found.moment_std_Nmm or ())]
    assert np.isnan([known[k] for k in (0, 1, 5)]).all()
    assert np.isnan([found.resultant_N[0], found.resultant_N[1]]).all()
    assert min(known[k] for k in (2, 3, 4)) > 0
    assert np.isfinite(field(height, shear).resultant_N).all()
