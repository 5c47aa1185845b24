"""Pictures of another light, moved ones, and gel touched nearly all over are flagged; ordinary ones are not."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each

from tactilevision.heightmap.build import build_reconstructor, tuned
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.recording.model import Recording
from tactilevision.records.maps import BALLS, LIGHT, MEANING, MOVED, REFERENCE, Frame, add
from tactilevision.records.measured import Bytes, Pair
from tactilevision.robots.live import Stream

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import LAMPS, MM_PER_PX, SENSOR, SHAPE, ball, ball_pictures, flat, in_px, picture, places, presses
from shared_scenes import shared

SEED = 61


def grain() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    rough = cv2.GaussianBlur(np.random.default_rng(SEED).standard_normal(SHAPE), (0, 0), 1.0)
    return np.asarray(1.0 + 0.015 * rough / rough.std())[..., None]


@lru_cache
def shots() -> tuple[BallPicture, ...]:
    return tuple(ball_pictures(8, np.random.default_rng(SEED), gain=grain()))


@lru_cache
@shared
def made() -> Reconstructor:
    rng = np.random.default_rng(SEED)
    reference = make_reference([flat(rng, gain=grain()) for _ in range(3)], may_have_marks=False)
    balls = list(shots())
    calibration = calibrate_from_balls(reference, balls, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC["polynomial"])
    return tuned(SENSOR, calibration, pictures=balls, free=[flat(rng, gain=grain()) for _ in range(6)])


def reader() -> Reconstructor:
    return Reconstructor(SENSOR, made().method)


def moved(rgb: Bytes, shift: Pair) -> Bytes:
    return np.roll(rgb, (int(shift[1]), int(shift[0])), axis=(0, 1))


@pytest.mark.parametrize(
    ("gain", "radius_mm"),
    [
        pytest.param(gain, mm, marks=() if (gain, mm) in ((0.75, 2.2), (1.15, 0.0)) else pytest.mark.slow)
        for gain in (0.75, 1.0, 1.15)
        for mm in (0.0, 1.0, 2.2)
    ],
)
def test_ordinary_pictures_are_not_flagged(gain: float, radius_mm: float) -> None:
    rng = np.random.default_rng(SEED + 1)
    for place in ((0.0, 0.0), (-4.0, 2.0), (3.0, -2.5)):
        p, q = ball(place, radius_mm, 4.0)[1:] if radius_mm else (np.zeros(SHAPE), np.zeros(SHAPE))
        assert reader().rectified_map(picture(p, q, rng, gain=gain * grain())).flags == ()


def test_a_lamp_that_was_moved_is_another_light() -> None:
    rng = np.random.default_rng(SEED + 2)
    for radius_mm, y in ((0.0, 10.0), (0.0, 14.0), (1.5, 14.0), (0.0, 25.0)):
        elsewhere = ((-30.0, y, 18.0), *LAMPS[1:])
        p, q = ball((1.0, 1.0), radius_mm, 4.0)[1:] if radius_mm else (np.zeros(SHAPE), np.zeros(SHAPE))
        assert LIGHT in reader().rectified_map(picture(p, q, rng, at=elsewhere)).flags


@pytest.mark.slow
def test_maps_of_a_light_known_in_one_corner_alone_are_flagged() -> None:
    rng = np.random.default_rng(SEED + 9)
    corner = [
        BallPicture(picture(*ball((x, y), 1.4, 4.0)[1:], rng, gain=grain()), 4.0)
        for x in (-7.0, -5.5, -4.0)
        for y in (-4.5, -3.0, -2.0)
    ]
    method = made().referenced
    assert method is not None
    calibration = calibrate_from_balls(
        method.reference, corner, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC["polynomial"]
    )
    assert any("of the picture only" in line for line in calibration.warnings)
    found = Reconstructor(SENSOR, calibration.method).rectified_map(flat(rng, gain=grain()))
    assert BALLS in found.flags
    assert BALLS not in reader().rectified_map(flat(rng, gain=grain())).flags


def test_daylight_from_a_side_is_another_light() -> None:
    rng = np.random.default_rng(SEED + 3)
    day = 25.0 * np.linspace(0.0, 1.0, SHAPE[1]) ** 2
    lit = np.clip(flat(rng) + day[None, :, None], 0, 255).astype(np.uint8)
    assert LIGHT in reader().rectified_map(lit).flags


def test_a_ball_over_more_than_half_of_the_picture_is_flagged() -> None:
    """Its slopes pass for the light's drift: two thirds of its depth are missing."""
    rng = np.random.default_rng(SEED + 4)
    x, y = places()
    contact, radius = 6.8, 28.0
    assert np.mean(np.hypot(x, y) < contact) > 0.5
    _, p, q = ball((0.0, 0.0), contact, radius)
    assert LIGHT in reader().rectified_map(picture(p, q, rng)).flags


def recording(folder: Path, frames: list[Bytes]) -> Recording:
    (folder / "frames").mkdir(parents=True)
    names = [f"{k}.png" for k in range(len(frames))]
    for name, rgb in zip(names, frames, strict=True):
        cv2.imwrite(str(folder / "frames" / name), rgb[..., ::-1])
    return Recording(
        folder,
        "r",
        SENSOR,
        frames_path=folder / "frames",
        frame_names=tuple(names),
        frame_times_s=np.arange(len(frames), dtype=np.float64),
    )


def test_a_recording_whose_camera_was_knocked_says_by_how_much(tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED + 5)
    still = [flat(rng, gain=grain()), *(shot.rgb for shot in shots()[:3])]
    found = build_reconstructor(recording(tmp_path / "still", still), made().method)
    assert not any("beside the untouched reference" in line for line in found.warnings)
    assert found.rectified_map(still[0]).flags == ()
    knocked = [moved(rgb, (7, -4)) for rgb in still]
    found = build_reconstructor(recording(tmp_path / "knocked", knocked), made().method)
    assert any("(+7.0, -4.0) px (right, down) beside" in line for line in found.warnings)
    assert MOVED in found.rectified_map(knocked[0]).flags


@pytest.mark.parametrize("first", [0, 4])
def test_a_recording_whose_gel_tears_says_from_which_frame_on(tmp_path: Path, first: int) -> None:
    rng = np.random.default_rng(SEED + 13)
    frames = [picture(*ball((k - 4.0, 2.0), 1.4, 4.0)[1:], rng, gain=grain()) for k in range(8)]
    for rgb in frames[first:]:
        cv2.line(rgb, (60, 140), (90, 150), (20, 20, 20), 9)
    found = build_reconstructor(recording(tmp_path, frames), made().method)
    said = [line for line in found.warnings if "torn gel" in line]
    assert len(said) == 1
    assert said[0].startswith(
        f"all frames looked at from {first}.png on show a mark" if first else "all frames show"
    )


def test_a_stream_sees_it_with_its_first_frame() -> None:
    rng = np.random.default_rng(SEED + 6)
    still = Stream(reader(), renew=0.0)
    assert still.take(Frame(flat(rng, gain=grain()))).height.flags == ()
    knocked = Stream(reader(), renew=0.0)
    for _ in range(2):
        assert MOVED in knocked.take(Frame(moved(flat(rng, gain=grain()), (5, 0)))).height.flags


def touched(place: Pair, contact_mm: float, rng: np.random.Generator) -> Reconstructor:
    """The method against a reference that was taken with a ball on the gel."""
    method = made().referenced
    assert method is not None
    flats = [picture(*ball(place, contact_mm, 4.0)[1:], rng, gain=grain())]
    return Reconstructor(SENSOR, method.with_reference(make_reference(flats, may_have_marks=False)))


@each("place, contact_mm", [((-3.5, 2.0), 1.0), ((4.0, -1.5), 1.6), ((0.5, 0.5), 2.2)])
@each("lamps", [(1.0, 1.0, 1.0), (0.93, 1.0, 1.04)])
def test_a_ready_method_sees_a_contact_in_its_reference(
    place: Pair, contact_mm: float, lamps: tuple[float, ...]
) -> None:
    rng = np.random.default_rng(SEED + 8)
    found = touched(place, contact_mm, rng)
    slopes = [ball(c, a, 4.0)[1:] for c, a in presses(3, rng)] + 2 * [(np.zeros(SHAPE), np.zeros(SHAPE))]
    frames = [picture(*one, rng, gain=grain(), lamps=lamps) for one in slopes]
    found = found.look(frames)
    assert found.match is not None
    assert found.match.pressed_px is not None
    assert np.hypot(*np.subtract(found.match.pressed_px, in_px(place))) < contact_mm / MM_PER_PX
    assert any("a contact in the untouched reference" in line for line in found.warnings)
    assert all(REFERENCE in found.rectified_map(rgb).flags for rgb in frames)


@each("lamps", [(1.0, 1.0, 1.0), (0.93, 1.0, 1.04), (0.8, 0.8, 0.8)])
@each("radius_mm", [0.0, 1.0, 2.2])
def test_no_contact_in_the_reference_is_seen_where_there_is_none(
    lamps: tuple[float, ...], radius_mm: float
) -> None:
    """Not where every frame is pressed at one place either."""
    rng = np.random.default_rng(SEED + 9)
    p, q = ball((-2.0, 1.0), radius_mm, 4.0)[1:] if radius_mm else (np.zeros(SHAPE), np.zeros(SHAPE))
    found = reader().look(
        [picture(p, q, rng, gain=grain(), lamps=lamps, stray_grey=stray) for stray in (15, 20, 20, 12)]
    )
    assert found.match is not None
    assert found.match.pressed_px is None
    assert not any("contact" in line for line in found.warnings)  # that stray light changes is told


def test_a_single_frame_says_nothing_of_its_reference() -> None:
    rng = np.random.default_rng(SEED + 10)
    found = touched((-3.5, 2.0), 1.6, rng)
    found = found.look([flat(rng, gain=grain())])
    assert found.match is not None
    assert found.match.pressed_px is None


def test_a_contact_that_the_calibration_saw_in_its_reference_is_flagged() -> None:
    rng = np.random.default_rng(SEED + 11)
    reference = make_reference([picture(*ball((-5.0, 3.0), 1.4, 4.0)[1:], rng)], may_have_marks=False)
    balls = [BallPicture(picture(*ball((4.0 - k, 3.0 - k), 1.8, 4.0)[1:], rng), 4.0) for k in range(7)]
    calibration = calibrate_from_balls(reference, balls, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC["polynomial"])
    assert REFERENCE in tuned(SENSOR, calibration, pictures=balls, free=[]).rectified_map(flat(rng)).flags


def test_what_is_usual_is_told_by_the_calibration() -> None:
    method = made().referenced
    assert method is not None
    assert 0.2 < method.card.to_json()["baseline"]["misfit"] < 1.5
    assert 0.0002 < method.card.to_json()["baseline"]["zero_std_mm"] < 0.003
    rough = replace(method, card=method.card.extended({"baseline": {"misfit": 40.0, "zero_std_mm": 0.2}}))
    level = np.zeros(SHAPE)
    still = picture(level, level, np.random.default_rng(SEED + 7), at=((-30.0, 14.0, 18.0), *LAMPS[1:]))
    assert LIGHT not in Reconstructor(SENSOR, rough).rectified_map(still).flags


def test_flags_have_a_meaning_and_an_order() -> None:
    assert add((LIGHT,), [MOVED, LIGHT]) == (MOVED, LIGHT)
    assert all(len(said) > 20 for said in MEANING.values())


def face(radius_mm: float, length_mm: float, place: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of a face in a steep wall, beside which the gel slopes by .1 at first, over `length_mm`."""
    x, y = (at - own for at, own in zip(places(), place, strict=True))
    r = np.hypot(x, y)
    beside = np.where(r < radius_mm, 0.0, 0.1 * np.exp(-np.maximum(r - radius_mm, 0.0) / length_mm))
    steep = (beside + 0.5 * np.exp(-0.5 * ((r - radius_mm) / 0.2) ** 2)) / np.maximum(r, 1e-9)
    return -steep * x, -steep * y


@each("radius_mm, length_mm", [(2.2, 4.0), (2.8, 2.5)])
@each("place", [(0.0, 0.0), (-2.0, 1.0)])
def test_gel_that_slopes_beside_a_face_is_no_other_light(radius_mm: float, length_mm: float, place: Pair) -> None:
    rng = np.random.default_rng(SEED + 12)
    slopes, found = face(radius_mm, length_mm, place), reader()
    assert found.match is not None
    seen = found.read_rectified(picture(*slopes, rng, gain=grain()))
    assert LIGHT not in seen.height.flags
    misfit, std_mm = seen.surface.residuals
    usual_misfit, usual_std_mm = found.match.baseline
    assert misfit * std_mm > 15 * usual_misfit * usual_std_mm  # more than a lamp that was moved may leave
    elsewhere = ((-30.0, 14.0, 18.0), *LAMPS[1:])
    assert LIGHT in found.rectified_map(picture(*slopes, rng, gain=grain(), at=elsewhere)).flags
