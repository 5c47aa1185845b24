"""Friction and load share against contacts sheared by Coulomb's law, solved apart from the library."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.force_cases import Forward, at_camera
from benchmarks.slip import GEL, LINEAR, MATERIAL, VIEW, WIDEST_MM
from benchmarks.stick_slip import STUCK, Hold, Indenter, Layer, Step, load
from tactilevision.force.field import ForceField
from tactilevision.force.slip import IMMINENT
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.wrench import PATCH_COLUMNS, Slip

FORWARD = Forward(VIEW, GEL, MATERIAL)
LAYER = Layer(VIEW, FORWARD, WIDEST_MM)
SCALE = (VIEW.mm_per_px, VIEW.mm_per_px)


@pytest.fixture(scope="module")
def field() -> ForceField:
    return ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape, settings=LINEAR)


@cache
def states(kind: str, friction: float) -> list[Step]:
    return list(load(LAYER, Indenter(kind, 2.0, 0.2, friction, 0.4, 0.0, (0.5, -0.3))))


def read(field: ForceField, state: Step, std_mm: float = 0.002) -> Slip:
    u, known = FORWARD(state.traction), np.ones(VIEW.shape, dtype=bool)
    off = std_mm * np.random.default_rng(3).standard_normal((2, *VIEW.shape))
    height = HeightMap(at_camera(u, VIEW), known, SCALE, std_mm=np.full(VIEW.shape, 0.001))
    u_x, u_y = u[:2] + off
    found = field(height, ShearMap(u_x, u_y, known, SCALE, std_mm=std_mm))
    (patch,) = found.patches
    assert patch.slip is not None
    assert len(patch.row) == len(PATCH_COLUMNS)
    return patch.slip


def test_friction_and_load_share_of_a_ball_are_those_put_in(field: ForceField) -> None:
    for state in (one for one in states("ball", 0.6) if 0.65 < one.share < 0.95):
        found = read(field, state)
        assert found.friction == pytest.approx(0.6, rel=0.06)
        assert found.load_share == pytest.approx(state.share, abs=0.06)
        force = np.hypot(*state.traction[:2].sum(axis=(1, 2))) * VIEW.mm_per_px**2
        assert found.margin_N == pytest.approx(force * (1 / state.share - 1), abs=0.08 * force)
        assert found.imminent == (found.load_share > IMMINENT)


def test_a_ball_that_sticks_is_not_flagged_though_its_edge_has_a_large_ratio(field: ForceField) -> None:
    found = [read(field, state) for state in states("ball", STUCK)[1:]]
    assert not any(one.imminent for one in found)


def test_gel_that_creeps_under_a_held_ball_is_no_slip(field: ForceField) -> None:
    held, ball = (
        Hold(0.3, by_force=True, relaxes=0.3, steps=2, step=2.0),
        Indenter("ball", 2.0, 0.2, STUCK, 0.4, 0, (0, 0)),
    )
    *_, before, _, after = load(LAYER, ball, held)
    assert after.moved_mm > 1.1 * before.moved_mm, "the gel gives way"
    assert not any(read(field, one).imminent for one in (before, after))


def test_a_flat_face_below_half_the_limit_is_not_flagged(field: ForceField) -> None:
    found = [read(field, state) for state in states("flat punch", 0.8) if 0 < state.share < 0.5]
    assert not any(one.imminent or one.load_share > IMMINENT for one in found)


def test_noise_as_large_as_the_motion_cannot_tell(field: ForceField) -> None:
    state = next(one for one in states("ball", 0.3) if one.share > 0.8)
    found = read(field, state, std_mm=0.3)
    assert "average frames" in found.why
    assert np.isnan(found.load_share)
    assert not found.imminent


def test_pressed_gel_that_is_not_sheared_says_that_it_moved_too_little(field: ForceField) -> None:
    assert "moved too little" in read(field, states("ball", 0.6)[0]).why
