"""Lamps found from pictures that a path tracer drew, and the shadows that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rendered_light import MM_PER_PX, SAMPLE, TRUTH, found_lamps, rendered_reconstructor

from tactilevision.photometric.illumination.cast_shadow import lit, visibility
from tactilevision.photometric.illumination.lamps import Lamp, Lamps, fit_lamps, shading
from tactilevision.photometric.reference import make_reference
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bools, Floats


def nearest(azimuth_rad: float) -> Lamp:
    return min(found_lamps().lamps, key=lambda lamp: abs(np.angle(np.exp(1j * (lamp.azimuth_rad - azimuth_rad)))))


@pytest.mark.parametrize("drawn", TRUTH["rig"]["lamps"], ids=["red", "green", "blue"])
def test_a_lamp_is_found_where_the_path_tracer_had_it(drawn: dict[str, Any]) -> None:
    x, y, z = drawn["centre_mm"]
    lamp = nearest(float(np.arctan2(y, x)))
    assert abs(np.angle(np.exp(1j * (lamp.azimuth_rad - np.arctan2(y, x))))) < 0.1
    assert lamp.height_mm / lamp.distance_mm == pytest.approx(z / np.hypot(x, y), rel=0.25)
    true, seen = (np.array(colour) / max(colour) for colour in (drawn["colour"], lamp.colour))
    assert seen == pytest.approx(true, abs=0.12)


@pytest.mark.parametrize("drawn", TRUTH["rig"]["lamps"], ids=["red", "green", "blue"])
def test_gloss_and_raised_gel_tell_how_high_a_lamp_stands(drawn: dict[str, Any]) -> None:
    x, y, z = drawn["centre_mm"]
    refined = found_lamps().refined
    assert refined is not None
    lamp = min(refined.lamps, key=lambda one: abs(np.angle(np.exp(1j * (one.azimuth_rad - np.arctan2(y, x))))))
    assert lamp.height_mm / lamp.distance_mm == pytest.approx(z / np.hypot(x, y), rel=0.09)


def ring(step: dict[str, Any], reach: tuple[float, float], shape: tuple[int, ...]) -> tuple[Bools, Floats, Floats]:
    """Places (H, W) at a distance from the punch's edge in mm, and the directions from its axis."""
    rows, columns = np.indices(shape)
    x = (columns - (shape[1] - 1) / 2) * MM_PER_PX[0] - step["centre_mm"][0]
    y = (rows - (shape[0] - 1) / 2) * MM_PER_PX[1] - step["centre_mm"][1]
    radius = np.hypot(x, y)
    beyond = radius - step["radius_mm"]
    return (beyond > reach[0]) & (beyond < reach[1]), x / radius, y / radius


def test_slopes_beside_deep_punches_are_right_where_all_lamps_reach_and_only_there() -> None:
    """Lamps and heights from the pictures alone; outward slopes over the true ones, .5 to 1.5 mm from the edge."""
    recording, reader = read_recording(SAMPLE), rendered_reconstructor()
    totals = np.zeros((2, 2))  # lit, dark: read, true
    for number, step in enumerate(TRUTH["step"], start=1):
        if step["face_mm"] < 0.25:
            continue
        frame = read_frame(recording, number)
        reached = lit(found_lamps(), reader.height_map(frame).depth_mm, MM_PER_PX)
        slopes = reader.slope_map(frame)
        with np.load(SAMPLE / "truth" / f"frame_{number:05d}.npz") as file:
            dz_dy, dz_dx = np.gradient(file["depth_mm"].astype(float), MM_PER_PX[0])
        inside, x, y = ring(step, (0.5, 1.5), dz_dx.shape)
        for row, part in enumerate((inside & reached, inside & ~reached)):
            totals[row] += (
                np.sum((slopes.dz_dx * x + slopes.dz_dy * y)[part]),
                np.sum((dz_dx * x + dz_dy * y)[part]),
            )
    lit_ratio, dark_ratio = totals[:, 0] / totals[:, 1]
    assert lit_ratio == pytest.approx(1.0, abs=0.1)
    assert dark_ratio > 1.3


def test_a_block_throws_a_shadow_as_long_as_it_is_high_over_the_lamp_s_tangent() -> None:
    lamp = Lamp(0.0, 400.0, 200.0, 1e-3, 0.0, (1.0, 1.0, 1.0))  # far: rays are parallel
    block = np.zeros((200, 300), np.float32)
    block[90:110, 190:200] = 1.0
    far = Lamps((lamp, lamp, lamp), 2.0, 0.0)
    (seen, _, _) = visibility(far, block, (0.1, 0.1))
    dark = np.flatnonzero(seen[100] < 0.5)
    assert len(dark) == pytest.approx(20, abs=3), "1 mm high, tangent .5: 2 mm, of .1 mm a pixel"
    assert dark.max() < 192
    assert seen[100, 205:].min() == 1.0
    assert seen[50].min() == 1.0
    assert np.all(visibility(far, np.zeros_like(block), (0.1, 0.1)) == 1.0)


def test_a_lamp_shines_as_lambert_has_it() -> None:
    leans = np.array([[[0.6], [0.0]]])
    assert shading(leans, np.array([0.0]), np.array([0.0]))[0, 0] == pytest.approx(1.0, abs=0.001)
    assert shading(leans, np.array([-0.3]), np.array([0.1]))[0, 0] == pytest.approx(1.18 / np.sqrt(1.1), abs=0.001)
    assert shading(leans, np.array([5.0]), np.array([0.0]))[0, 0] < 0.001


def test_too_few_samples_tell_no_lamps() -> None:
    reference = make_reference([np.full((32, 43, 3), 90, np.uint8)])
    few = np.zeros((50, 2))
    assert fit_lamps(np.zeros((50, 3)), few, place=few, reference=reference, mm_per_px=MM_PER_PX) is None


def test_grey_pictures_tell_no_lamps() -> None:
    rng = np.random.default_rng(0)
    place, slopes = rng.uniform(-1, 1, (2, 400, 2))
    grey = make_reference([np.full((32, 43, 3), 90, np.uint8)])
    change = np.repeat(slopes[:, :1], 3, axis=1)
    assert fit_lamps(change, slopes, place=place, reference=grey, mm_per_px=MM_PER_PX) is None
