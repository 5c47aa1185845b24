"""Depth of flat faces by the reach of their shadows: a path tracer's pictures, and what a map makes of it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rendered_light import MM_PER_PX, SAMPLE, TRUTH, found_lamps, rendered_reconstructor

from tactilevision.heightmap import faces_by_shadow
from tactilevision.heightmap.depth_by_shadow import ShadowDepth, _Beside, depth_by_shadow
from tactilevision.heightmap.faces_by_shadow import with_shadow_depths
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.interreflection import reflected
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import CONTRARY
from tactilevision.records.measured import Floats

THICKNESS_MM = TRUTH["gel"]["thickness_mm"]


def drawn_mm(number: int) -> Floats:
    with np.load(SAMPLE / "truth" / f"frame_{number:05d}.npz") as file:
        return np.asarray(file["depth_mm"], np.float64)


def wall(number: int, shape: tuple[int, ...], depth_mm: float) -> PunchEdge:
    step = TRUTH["step"][number - 1]
    x, y = (at + 0.5 * (n - 1) * mm for at, n, mm in zip(step["centre_mm"], shape[::-1], MM_PER_PX, strict=True))
    places = np.array([-0.2, 0.0, 0.2, 0.4])
    fall = depth_mm * np.array([0.0, 0.2, 0.5, 0.6])
    return PunchEdge((x, y), step["radius_mm"], 0.4, places, fall, depth_mm, 0.1, 0.02)


def told(number: int, *, scale: float, lamps: Lamps, usable: bool = True) -> ShadowDepth | None:
    """What shadows tell of a face whose map has `scale` times the drawn depth."""
    reader, frame = rendered_reconstructor(), read_frame(read_recording(SAMPLE), number)
    assert reader.referenced is not None
    now, before = (
        cv2.GaussianBlur(np.asarray(one, np.float32), (0, 0), 1.0)
        for one in (frame.rgb, reader.referenced.reference.rgb)
    )
    surface = scale * drawn_mm(number)
    field = LightField.of(found_lamps(), surface.shape, MM_PER_PX)
    return depth_by_shadow(
        wall(number, surface.shape, 0.3),
        surface,
        light=(now / np.maximum(before, 1.0)) ** np.float32(lamps.power),
        usable=np.full(now.shape[:2], usable),
        reflected=reflected(field, surface) ** np.float32(found_lamps().power) - 1.0,
        lamps=lamps,
        mm_per_px=MM_PER_PX,
        thickness_mm=THICKNESS_MM,
    )


@pytest.mark.parametrize("scale", [0.85, 1.2])
@pytest.mark.parametrize("number", [2, 4])
def test_shadows_tell_a_face_s_depth_whatever_the_map_has(number: int, scale: float) -> None:
    refined = found_lamps().refined
    assert refined is not None
    seen, true_mm = told(number, scale=scale, lamps=refined), TRUTH["step"][number - 1]["face_mm"]
    assert seen is not None
    assert seen.depth_mm == pytest.approx(true_mm, rel=0.07)
    assert abs(seen.depth_mm - true_mm) < 2.5 * seen.std_mm < 0.12 * true_mm


def test_lamps_a_fifth_higher_make_faces_as_much_deeper() -> None:
    refined = found_lamps().refined
    assert refined is not None
    first, second, third = (replace(lamp, height_mm=1.2 * lamp.height_mm) for lamp in refined.lamps)
    high = replace(refined, lamps=(first, second, third))
    usual, deeper = told(4, scale=1.0, lamps=refined), told(4, scale=1.0, lamps=high)
    assert usual is not None
    assert deeper is not None
    assert deeper.depth_mm / usual.depth_mm == pytest.approx(1.2, abs=0.08)


def test_a_gentle_face_and_one_without_a_picture_of_its_gel_tell_nothing() -> None:
    refined = found_lamps().refined
    assert refined is not None
    assert told(1, scale=1.0, lamps=refined) is None, ".15 mm throws too short a shadow"
    assert told(4, scale=1.0, lamps=refined, usable=False) is None
    level = np.zeros((120, 160))
    edge = PunchEdge((0.0, 0.0), 2.5, 0.4, np.array([-0.2, 0.4]), np.array([0.0, 0.2]), 0.3, 0.1, 0.02)
    light = np.ones((120, 160, 3))
    seen = depth_by_shadow(
        edge,
        level,
        light=light,
        usable=np.ones(level.shape, bool),
        reflected=0 * light,
        lamps=refined,
        mm_per_px=MM_PER_PX,
        thickness_mm=3.0,
    )
    assert seen is None


def pressed() -> tuple[Floats, PunchEdge]:
    """A face .4 mm deep of radius 1.5 mm whose wall falls by .2 mm, half of it within the edge, and its edge."""
    y, x = np.indices((80, 80)) * 0.1
    beyond = np.hypot(x - 4.0, y - 4.0) - 1.5
    places, fall = np.array([-0.2, -0.1, 0.0, 0.1, 0.2, 0.3]), np.array([0.0, 0.0, 0.1, 0.16, 0.18, 0.2])
    depth = np.interp(beyond, [*places, 2.0], [*(0.4 - fall), 0.0])
    edge = PunchEdge((4.0, 4.0), 1.5, 0.3, places, fall, 0.4, 0.1, 0.02)
    return depth, edge


@pytest.mark.parametrize(("by_shadow_mm", "contrary"), [(0.41, False), (0.6, True)])
def test_a_face_takes_the_mean_by_what_both_state(
    by_shadow_mm: float, contrary: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(faces_by_shadow, "depth_by_shadow", lambda *_, **__: ShadowDepth(by_shadow_mm, 0.01))
    depth, edge = pressed()
    field = LightField.of(found_lamps(), (80, 80), (0.1, 0.1))
    picture, std = np.full((80, 80, 3), 90, np.uint8), np.full((80, 80), 0.02)
    mapped = depth, np.ones((80, 80), np.bool_), std, ()
    seen, _, told_std, flags = with_shadow_depths(
        mapped, picture, picture.astype(float), field, [edge], thickness_mm=3.0
    )
    assert seen[40, 40] == pytest.approx((0.4 / 0.02**2 + by_shadow_mm / 0.01**2) / (0.02**-2 + 0.01**-2))
    assert np.array_equal(seen[:, :20], depth[:, :20]), "gel beside stays"
    beyond = np.hypot(*(np.indices((80, 80)) - 40)) * 0.1 - 1.5
    wall = np.abs(beyond + 0.05) < 0.01
    assert np.all(np.abs((seen - depth)[wall] / (seen - depth)[40, 40] - 0.6) < 0.2), "and its wall carries it"
    if not contrary:
        assert np.allclose(seen[beyond > 0.02], depth[beyond > 0.02]), "a small change stays where it is steepest"
    assert told_std is not None
    both = (0.02**-2 + 0.01**-2) ** -0.5
    assert told_std[40, 40] == pytest.approx(both * max(1.0, (by_shadow_mm - 0.4) / np.hypot(0.02, 0.01)))
    assert told_std[0, 0] == 0.02
    assert (CONTRARY in flags) is contrary


def test_lamps_of_before_leave_a_map_as_it_is() -> None:
    depth, edge = pressed()
    field = LightField.of(replace(found_lamps(), refined=None), (80, 80), (0.1, 0.1))
    picture = np.full((80, 80, 3), 90, np.uint8)
    mapped = depth, np.ones((80, 80), np.bool_), np.full((80, 80), 0.02), ()
    assert with_shadow_depths(mapped, picture, picture.astype(float), field, [edge], thickness_mm=3.0) is mapped


def test_a_face_half_out_of_the_picture_tells_nothing() -> None:
    refined = found_lamps().refined
    assert refined is not None
    y, x = np.indices((120, 160)) * 0.1
    surface = np.where(np.hypot(x, y - 6.0) < 2.5, 0.4, 0.0)
    edge = PunchEdge((0.0, 6.0), 2.5, 0.4, np.array([-0.2, 0.4]), np.array([0.0, 0.2]), 0.3, 0.1, 0.02)
    places = _Beside.of(
        edge, surface, np.ones(surface.shape, bool), lamps=refined, mm_per_px=(0.1, 0.1), thickness_mm=3.0
    )
    assert places is None
