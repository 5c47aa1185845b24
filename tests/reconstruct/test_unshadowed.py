"""Height maps of a path tracer's pictures, whose lamps cast shadows; the truth is the surface that was drawn."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from shared_scenes import shared

from tactilevision.heightmap import shadows_seen
from tactilevision.heightmap.build import build_reconstructor, calibrate_light
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.shadows_seen import share_seen, with_shadows
from tactilevision.heightmap.unshadowed import Mapped, undo_shadows
from tactilevision.photometric.illumination.cast_shadow import LightField, dimming, shadow_share
from tactilevision.photometric.illumination.lamps import Lamp, Lamps
from tactilevision.recording.images import read_image
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bytes, Floats

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "rendered_shadows"
TRUTH = tomllib.loads((SAMPLE / "truth.toml").read_text())
UNSHADOWED = Path(__file__).parents[1] / "data" / "rendered" / "unshadowed_step.png"  # frame 8, no light blocked
PRESSED = (1, 2, 5, 6)  # frames of faces .15 and .30 mm deep, of two radii


@shared
def unshadowed_reader() -> Reconstructor:
    return build_reconstructor(read_recording(SAMPLE), shadows=True)


def beyond_mm(number: int, shape: tuple[int, ...]) -> Floats:
    """Distance (H, W) in mm outward from the punch's edge."""
    step = TRUTH["step"][number - 1]
    y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    away = 0.0634 * x[None, :] - step["centre_mm"][0], 0.0634 * y[:, None] - step["centre_mm"][1]
    return np.asarray(np.hypot(*away) - step["radius_mm"])


def drawn_mm(number: int) -> Floats:
    with np.load(SAMPLE / "truth" / f"frame_{number:05d}.npz") as file:
        return np.asarray(file["depth_mm"], np.float64)


@pytest.mark.parametrize("number", PRESSED)
def test_faces_and_the_gel_beside_them_are_right_without_a_certificate(number: int) -> None:
    reader, frame = unshadowed_reader(), read_frame(read_recording(SAMPLE), number)
    seen, truth = reader.height_map(frame), drawn_mm(number)
    beyond = beyond_mm(number, truth.shape)
    face, beside = beyond < -0.8, (beyond > 0.5) & (beyond < 3.0)
    assert seen.depth_mm[face].mean() == pytest.approx(truth[face].mean(), rel=0.05)
    assert np.sqrt(np.mean((seen.depth_mm - truth)[beside] ** 2)) < 0.011
    assert seen.std_mm is not None
    off = np.abs(seen.depth_mm - truth) / seen.std_mm
    assert np.mean(off[face | beside] < 2) > 0.92


def test_shadows_that_stay_are_told_in_the_warnings_and_in_deep_maps() -> None:
    reader, recording = build_reconstructor(read_recording(SAMPLE)), read_recording(SAMPLE)
    assert reader.shadows is None
    assert sum("they stay" in one for one in reader.warnings) == 1
    assert "shadow" in reader.height_map(read_frame(recording, 8)).flags
    assert "shadow" not in reader.height_map(read_frame(recording, 0)).flags
    undone = unshadowed_reader()
    assert not any("they stay" in one for one in undone.warnings)
    assert "shadow" not in undone.height_map(read_frame(recording, 8)).flags


def test_lamps_that_do_not_explain_the_light_widen_faces(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, reader = read_recording(SAMPLE), calibrate_light(read_recording(SAMPLE))
    frame = read_frame(recording, 6)
    plain = reader.height_map(frame)
    lamp = Lamp(0.1, 20.0, 9.0, 15.0, 0.5, (0.9, 0.2, 0.1))
    some = Lamps((lamp, lamp, lamp), 2.2, 1.0, unexplained=0.08)
    monkeypatch.setattr(shadows_seen, "find_lamps", lambda *_: some)
    assert with_shadows(recording, reader).shadows is None
    assert sum("unknown_lamps" in one for one in reader.warnings) == 1
    seen = reader.height_map(frame)
    assert "unknown_lamps" in seen.flags
    assert np.array_equal(seen.depth_mm, plain.depth_mm)
    assert seen.std_mm is not None
    assert plain.std_mm is not None
    face = beyond_mm(6, seen.depth_mm.shape) < -0.8
    more = np.sqrt(seen.std_mm**2 - plain.std_mm**2)[face] / seen.depth_mm[face]
    assert np.median(more) == pytest.approx(0.1, abs=0.01)
    assert reader.error is not None
    few = (slice(None, None, reader.error.every),) * 2
    whole = np.hypot.reduce(list(reader.depth_terms(seen).values()))
    assert np.allclose(whole[face[few]], seen.std_mm[few][face[few]], rtol=0.05), "its terms hold that"
    assert "unknown_lamps" not in reader.height_map(read_frame(recording, 0)).flags


@pytest.mark.slow
def test_what_is_given_back_is_part_of_the_deviation_and_of_its_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, plain = unshadowed_reader(), calibrate_light(read_recording(SAMPLE))
    assert reader.shadows is not None
    monkeypatch.setattr(reader, "shadows", reader.shadows.unrefined)
    frame = read_frame(read_recording(SAMPLE), 6)
    seen = reader.height_map(frame)
    changed = np.abs(seen.depth_mm - plain.height_map(frame).depth_mm)
    given_back = reader.depth_terms(seen)["cast shadow"]
    assert given_back.max() == pytest.approx(0.35 * changed.max(), rel=0.2)
    assert seen.std_mm is not None
    assert np.count_nonzero(changed > 0.02) > 100
    assert np.all(seen.std_mm[changed > 0.02] > 0.3 * 0.02)
    free = reader.height_map(read_frame(read_recording(SAMPLE), 0))
    assert np.array_equal(free.depth_mm, plain.height_map(read_frame(read_recording(SAMPLE), 0)).depth_mm)
    assert "cast shadow" not in reader.depth_terms(free)


def test_shadows_are_looked_for_before_they_are_undone() -> None:
    """The same faces drawn by direct light that passes through what stands in its way show none."""
    reader = unshadowed_reader()
    assert reader.shadows is not None
    assert reader.referenced is not None
    assert any("--no-shadows" in line for line in reader.warnings)
    reference = reader.referenced.reference.rgb
    shaded = read_frame(read_recording(SAMPLE), 8).rgb
    assert shadow_share(reader.shadows, [(shaded, drawn_mm(8))], reference=reference) > 0.5
    direct = read_image(UNSHADOWED)
    assert abs(shadow_share(reader.shadows, [(direct, drawn_mm(8))], reference=reference)) < 0.1
    level = np.zeros(shaded.shape[:2])
    assert np.isnan(shadow_share(reader.shadows, [(shaded, level)], reference=reference))


@pytest.mark.parametrize("number", [3, 6])
def test_shadows_too_short_to_darken_whole_squares_are_told_by_all_of_them(number: int) -> None:
    reader, recording = unshadowed_reader(), read_recording(SAMPLE)
    assert reader.shadows is not None
    assert reader.referenced is not None
    reference = reader.referenced.reference.rgb
    shown = [(read_frame(recording, number).rgb, drawn_mm(number))]
    assert shadow_share(reader.shadows, shown, reference=reference) > 0.5
    gentle = [(read_frame(recording, 1).rgb, drawn_mm(1))]
    assert np.isnan(shadow_share(reader.shadows, gentle, reference=reference)), "hardly any is forecast"


def small_field() -> LightField:
    lamps = tuple(
        Lamp(angle, 20.0, 8.0, 10.0, 0.0, tuple(np.eye(3)[k])) for k, angle in enumerate((0.0, 2.09, 4.19))
    )
    return LightField.of(Lamps((lamps[0], lamps[1], lamps[2]), 2.2, 1.0), (120, 160), (0.1, 0.1))


def test_maps_that_jump_come_to_their_mean_and_those_that_settle_to_the_last() -> None:
    """A map that is .6 mm deep after one of less than .5 mm, else .4 mm: no depth is its own map."""
    faces: list[float] = []

    def undone(jump: float) -> tuple[float, float]:
        faces[:] = [0.3]

        def mapped(rgb: Bytes) -> Mapped:
            depth = np.zeros(rgb.shape[:2])
            depth[40:80, 60:100] = faces[-1]
            return depth, np.ones(depth.shape, np.bool_), np.full(depth.shape, 0.001), ()

        def again(rgb: Bytes) -> Mapped:
            middle = 0.5
            faces.append(middle + jump if faces[-1] < middle else middle - jump)
            return mapped(rgb)

        picture = np.full((120, 160, 3), 90, np.uint8)
        (depth, _, std, _), _ = undo_shadows(
            mapped, picture, small_field(), again=again, taught=None, edges=lambda: (), thickness_mm=3.0
        )
        assert std is not None
        return float(depth[60, 80]), float(std[60, 80])

    depth, std = undone(0.1)
    assert depth == pytest.approx(0.5, abs=0.03)
    assert std > 0.08
    depth, std = undone(0.001)
    assert depth == pytest.approx(0.5, abs=0.002)
    assert std == pytest.approx(0.35 * 0.2, abs=0.01)


def test_what_faces_taught_is_added_to_the_map_that_is_kept_and_moves_no_forecast() -> None:
    maps: list[float] = []

    def deep(mm: float) -> Mapped:
        maps.append(mm)
        depth = np.zeros((120, 160))
        depth[40:80, 60:100] = mm
        return depth, np.ones(depth.shape, np.bool_), np.full(depth.shape, 0.001), ()

    def jumping(_: Bytes) -> Mapped:
        return deep(0.6 if maps[-1] < 0.5 else 0.4)

    picture, deepest = np.full((120, 160, 3), 90, np.uint8), []
    for lesson in (None, lambda _: deep(maps[-1] + 0.02)):
        maps.clear()
        (depth, *_), _ = undo_shadows(
            lambda _: deep(0.3),
            picture,
            small_field(),
            again=jumping,
            taught=lesson,
            edges=lambda: (),
            thickness_mm=3,
        )
        deepest.append(float(depth.max()))
    assert deepest[0] == pytest.approx(0.5, abs=0.03)
    assert deepest[1] - deepest[0] == pytest.approx(0.02)


def test_a_flat_gel_dims_nothing_and_a_wall_dims_the_side_away_from_the_lamp() -> None:
    field = small_field()
    assert np.allclose(dimming(field, np.zeros((120, 160))), 1.0)
    wall = np.zeros((120, 160))
    wall[40:80, 60:100] = 0.5
    factor = dimming(field, wall)
    assert factor[60, 55, 0] < 0.6  # left of the block; red comes from the right
    assert factor[60, 55, 1] > 0.95
    assert factor[60, 105, 0] > 0.95
    assert np.all(factor[:, 130:] > 0.97)


def test_a_black_frame_shows_no_shadow_and_stops_nothing() -> None:
    recording = read_recording(SAMPLE)
    reader, deep = calibrate_light(recording), read_frame(recording, 8)
    rgb = [(seen := reader.rectified(deep)), np.zeros_like(seen)]
    assert share_seen(recording, reader, frames=rgb) == share_seen(recording, reader, frames=rgb[:1])


def test_in_pictures_of_another_light_no_shadow_is_undone() -> None:
    """Nonsense that is deep in all of the picture casts shadows over all of it: minutes for ten such frames."""
    recording = read_recording(SAMPLE)
    reader, mirrored = unshadowed_reader(), [read_frame(recording, k).rgb[:, ::-1].copy() for k in (2, 6, 8)]
    assert reader.reference_match is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader.reference_match, "other_light", False)  # given back at the end, as are the next two
        patch.setattr(reader.reference_match, "contact_px", reader.reference_match.contact_px)
        patch.setattr(reader, "warnings", reader.warnings)
        reader.look(mirrored)
        assert any("mirrored" in line for line in reader.warnings)
        told = reader.rectified_map(mirrored[1])
        patch.setattr(reader, "shadows", None)
        assert np.array_equal(told.depth_mm, reader.rectified_map(mirrored[1]).depth_mm)
