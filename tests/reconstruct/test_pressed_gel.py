"""The surface round a flat face that shadows are forecast from: theory's where the map bears it out."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.heightmap.circular_edges import CircularEdge
from tactilevision.heightmap.pressed_gel import with_faces
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.records.measured import Bools, Floats

SCALE = (0.08, 0.08)  # mm per px
RADIUS, THICKNESS, DEPTH = 2.5, 3.0, 0.5  # mm
CENTRE = (8.0, 7.5)  # mm from the first pixel
NOTHING = np.zeros(0)


def radii() -> Floats:
    y, x = np.indices((190, 200)) * SCALE[0]
    return np.asarray(np.hypot(x - CENTRE[0], y - CENTRE[1]))


def pressed(poisson_ratio: float) -> Floats:
    """A face and its gel (H, W), mm."""
    r = np.maximum(radii() / RADIUS, 1.0)
    return -DEPTH * seen_profile(r, PunchCase(poisson_ratio, RADIUS / THICKNESS))


def shadow() -> Bools:
    """One side of the gel beside the face."""
    x = np.indices((190, 200))[1] * SCALE[0] - CENTRE[0]
    return np.asarray((radii() > RADIUS) & (radii() < RADIUS + 1.8) & (x > 0))


def forecast(depth: Floats, lit: Bools | None) -> Floats:
    edge = PunchEdge(CENTRE, RADIUS, 0.3, NOTHING, NOTHING, DEPTH, 0.0, 0.0)
    return np.asarray(with_faces(depth, [edge], lit=lit, mm_per_px=SCALE, thickness_mm=THICKNESS))


@pytest.mark.parametrize("poisson_ratio", [0.41, 0.45, 0.495])
def test_a_false_slope_in_shadow_is_not_in_the_forecast(poisson_ratio: float) -> None:
    true, dark = pressed(poisson_ratio), shadow()
    read = true + np.where(dark, 0.12 * DEPTH, 0.0)
    found = forecast(read, ~dark)
    assert np.abs(found - true)[dark].max() < 0.02 * DEPTH
    assert np.abs(found - true).mean() < 0.2 * np.abs(read - true).mean()


def test_without_light_that_tells_a_usual_gel_is_taken() -> None:
    for told in (None, np.zeros((190, 200), np.bool_)):
        off = forecast(pressed(0.41), told) - pressed(0.462)
        assert np.abs(off[radii() < RADIUS + 2.0]).max() < 0.01 * DEPTH


def test_a_tilted_face_stays_tilted() -> None:
    x = np.indices((190, 200))[1] * SCALE[0] - CENTRE[0]
    true = pressed(0.45) * (1.0 + 0.02 * x * np.minimum(1.0, RADIUS / np.maximum(radii(), 1.0)) / DEPTH)
    assert np.abs(forecast(true, ~shadow()) - true).max() < 0.01 * DEPTH


def test_what_is_no_gel_beside_a_face_stays_as_it_is() -> None:
    read, hole = pressed(0.45), radii() < 1.0
    read[hole] = 0.5 * DEPTH
    dent = (radii() > RADIUS + 0.5) & (radii() < RADIUS + 1.0) & shadow()
    read[dent] += 0.4 * DEPTH
    found = forecast(read, ~shadow())
    assert np.allclose(found[dent], read[dent], atol=1e-6)
    assert np.abs(found - read)[hole].max() < 0.1 * DEPTH
    far = radii() > RADIUS + 3.6
    assert np.array_equal(found[far], read[far])


def test_beside_a_rim_whose_wall_is_all_in_shadow_theory_stands_in_for_what_is_read() -> None:
    """Shadows of faces .55 to .65 mm deep made .33 to .5 of the depth of the gel beside them."""
    true, beside = pressed(0.45), (radii() > RADIUS) & (radii() < RADIUS + 1.8)
    read = true + np.where(beside, 0.45 * DEPTH, 0.0)
    rim = CircularEdge(CENTRE, RADIUS, 0.05, 0.0, NOTHING, NOTHING, NOTHING, NOTHING)
    found = with_faces(read, [rim], lit=None, mm_per_px=SCALE, thickness_mm=THICKNESS)
    assert np.abs(found - true)[beside].max() < 0.03 * DEPTH
    assert np.array_equal(forecast(read, None)[beside], read[beside])


def test_a_gentle_or_tiny_face_is_left_alone() -> None:
    gentle = 0.1 * pressed(0.45)
    assert forecast(gentle, None) is gentle
    edge = PunchEdge(CENTRE, 0.5, 0.3, NOTHING, NOTHING, DEPTH, 0.0, 0.0)
    read = pressed(0.45)
    assert with_faces(read, [edge], lit=None, mm_per_px=SCALE, thickness_mm=THICKNESS) is read
    assert with_faces(read, [], lit=None, mm_per_px=SCALE, thickness_mm=THICKNESS) is read
