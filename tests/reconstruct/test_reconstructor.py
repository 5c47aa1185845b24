"""Frames to depth, end to end: planted surfaces, the stated deviation, and real frames where they are at hand."""

from __future__ import annotations

import dataclasses
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from shared_scenes import SAMPLE, sample_reconstructor

from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import InputError
from tactilevision.heightmap.build import (
    build_reconstructor,
    subtract_background,
    tare,
    untouched_around_balls,
    untouched_of,
)
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import BEYOND_BALLS, Frame, SlopeMap
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import (
    MM_PER_PX,
    SENSOR,
    SHAPE,
    ball,
    ball_pictures,
    flat,
    picture,
    places,
    presses,
    room_calibration,
)

from tactilevision.heightmap.ball_validation import held_out_depth
from tactilevision.heightmap.deviation import hidden_step_mm

REAL = Path(__file__).parents[3] / "shared" / "real"


def calibrated() -> Calibration:
    return room_calibration(12)


@lru_cache
def reconstructor() -> Reconstructor:
    return Reconstructor(SENSOR, calibrated().method, calibration=calibrated())


@pytest.mark.parametrize("contact_mm", [0.7, 1.2, 2.0])
def test_balls_are_as_deep_as_they_are(contact_mm: float) -> None:
    rng = np.random.default_rng(5)
    depth, p, q = ball((0.8, -0.6), contact_mm, 4.0)
    height = reconstructor().height_map(Frame(picture(p, q, rng), 1.5, "a.png"))
    assert height.time_s == 1.5
    assert height.name == "a.png"
    x, y = places()
    r = np.hypot(x - 0.8, y + 0.6)
    error = height.depth_mm - depth
    assert abs(error[r < 0.3].mean()) < max(0.04 * depth.max(), 0.010)
    assert np.sqrt(np.mean(error[r > 4.0] ** 2)) < 0.012


def test_the_deviation_of_a_contact_beyond_the_balls_grows_and_is_flagged() -> None:
    """The balls of this card lie in the left half."""
    rng, method = np.random.default_rng(6), calibrated().method
    card = dataclasses.replace(method.card, extrapolated_gain_std=[[0.0, 0.0, 0.2, 0.6]])
    before = dataclasses.replace(card, extrapolated_gain_std=None)
    far, older = (Reconstructor(SENSOR, dataclasses.replace(method, card=one)) for one in (card, before))
    for x_mm, beyond in ((-6.0, False), (8.0, True)):
        depth, p, q = ball((x_mm, 0.0), 1.5, 4.0)
        height = far.height_map(Frame(picture(p, q, rng)))
        contact = find_contact(height, far.error)
        assert (BEYOND_BALLS in contact_flags(contact, far.error)) is beyond
        assert BEYOND_BALLS not in contact_flags(contact, older.error), "a card of before tells nothing of it"
        deepest = np.unravel_index(np.argmax(depth), depth.shape)
        assert height.std_mm is not None
        assert bool(height.std_mm[deepest] > 0.3 * depth.max()) is beyond
    assert contact_flags(np.zeros(SHAPE, np.bool_), far.error) == ()


def test_doubt_beyond_the_balls_leaves_the_dents_among_them_as_they_are() -> None:
    shots, found = ball_pictures(12, np.random.default_rng(1)), []
    for times in (1.0, 10.0):
        wider = tuple(
            held and dataclasses.replace(held, outside_std=times * held.outside_std)
            for held in calibrated().held_out_laws
        )
        doubted = dataclasses.replace(calibrated(), held_out_laws=wider)
        found.append(held_out_depth(doubted, shots, mm_per_px=SENSOR.mm_per_px, seen_gain=0.02))
    assert found[1]["depth_coverage_factor"] == pytest.approx(found[0]["depth_coverage_factor"])
    far = [ball["stated_mm"] for ball in found[1]["held_out_balls"]]
    assert np.mean(far) > 1.2 * np.mean([ball["stated_mm"] for ball in found[0]["held_out_balls"]])


CENTRES = [(-8.2, 0.5), (8.1, -2.0), (1.0, 5.9), (-9.5, 1.0), (2.0, 7.1), (8.3, 6.0)]


def at_border(centre: tuple[float, float], rng: np.random.Generator) -> tuple[float, float, float]:
    """True depth, error and stated deviation (mm) of a contact of 1.3 mm in a view of 19 by 14 mm."""
    depth, p, q = ball(centre, 1.3, 4.0)
    height = reconstructor().height_map(Frame(picture(p, q, rng)))
    assert height.std_mm is not None
    x, y = places()
    middle = np.hypot(x - centre[0], y - centre[1]) < 0.6
    error = height.depth_mm - depth
    untouched = np.hypot(x - centre[0], y - centre[1]) > 6.0
    assert np.sqrt(np.mean(np.square(error[untouched]))) < 0.02, "the rest is not dragged along"
    return float(depth[middle].mean()), float(error[middle].mean()), float(height.std_mm[middle].mean())


def test_a_contact_at_the_border_is_right_or_says_how_far_off_it_may_be() -> None:
    """Contacts that touch the border, are cut by it, or sit in a corner: one in four may leave two deviations."""
    within = 0
    for number, centre in enumerate(CENTRES):
        for seed in (11, 12):
            true, off, stated = at_border(centre, np.random.default_rng((seed, number)))
            assert stated < 0.5 * true, "flagged, not given up"
            assert abs(off) < max(0.05 * true, 3.0 * stated)
            within += abs(off) < max(0.05 * true, 2.0 * stated)
    assert within >= 9


def test_light_five_grey_levels_off_changes_little() -> None:
    rng = np.random.default_rng(6)
    depth, p, q = ball((0.8, -0.6), 1.6, 4.0)
    height = reconstructor().height_map(Frame(picture(p, q, rng, gain=0.96)))
    inside = depth > 0.5 * depth.max()
    error = np.sqrt(np.mean((height.depth_mm - depth)[inside] ** 2))
    assert error < max(0.015, 0.04 * depth.max())


def test_untouched_gel_is_flat_and_the_waves_are_stated() -> None:
    rng = np.random.default_rng(7)
    height = reconstructor().height_map(Frame(flat(rng)))
    assert np.sqrt(np.mean(height.depth_mm**2)) < 0.004
    shots = ball_pictures(12, np.random.default_rng(1))
    card = untouched_around_balls(SENSOR, calibrated(), calibrated().method.card, shots)
    assert card.untouched_depth_rms_mm is not None
    assert 0.0 < card.untouched_depth_rms_mm < 0.1
    assert 0.0 < np.max(card.untouched_std_mm or 0.0) < 0.2


def tinted(rgb: Bytes, rng: np.random.Generator) -> Bytes:
    """The picture with a tint on the right that no drift of the lamps explains, another one each time."""
    x, y = places()
    near = np.exp(-0.5 * ((x - 8.0) ** 2 + (y - rng.uniform(-4, 4)) ** 2) / 2.5**2)
    return np.asarray(np.clip(rgb * (1 + 0.04 * near[..., None] * rng.standard_normal(3)), 0, 255), np.uint8)


def test_the_deviation_grows_where_gel_is_unsteady_and_no_ball_was_pressed() -> None:
    rng, here, others = np.random.default_rng(21), [], []
    for x, y in [(-7.0, -4.0), (-6.5, 0.0), (-7.5, 4.0), (-4.5, -5.0), (-4.0, 2.0), (-5.0, 5.0), (-3.0, -1.5)]:
        here.append(BallPicture(tinted(picture(*ball((x, y), 1.3, 4.0)[1:], rng), rng), 4.0))
        others.append(tinted(picture(*ball((x + 0.7, y - 0.8), 1.2, 4.0)[1:], rng), rng))
    reference = make_reference([flat(rng) for _ in range(2)])
    fit, heard = PHOTOMETRIC["polynomial"], list[tuple[int, int, str]]()
    made = calibrate_from_balls(
        reference, here, mm_per_px=SENSOR.mm_per_px, fit=fit, progress=lambda *step: heard.append(step)
    )
    passes = dict.fromkeys(what for _, _, what in heard)
    assert [*passes][:2] == ["balls", "circles of balls, round 1 of at most 6"]
    assert {"laws of the light", "uncertainty of the scale", "checks of the balls"} <= passes.keys()
    assert all(0 <= done < total for done, total, _ in heard)
    card = untouched_around_balls(SENSOR, made, made.method.card, here)
    stated = np.array(card.untouched_std_mm)
    assert stated[:, -2:].max() > 2.0 * np.median(stated[:, :3])
    reader = Reconstructor(SENSOR, dataclasses.replace(made.method, card=card))
    maps = [reader.rectified_map(rgb) for rgb in others]
    right = places()[0] > 6.0
    off = [(one.depth_mm / one.std_mm)[right] for one in maps if one.std_mm is not None]
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_the_stated_deviation_covers_the_error() -> None:
    rng = np.random.default_rng(8)
    shares = []
    for centre, contact in presses(6, rng):
        depth, p, q = ball(centre, contact, 4.0)
        height = reconstructor().height_map(Frame(picture(p, q, rng)))
        assert height.std_mm is not None
        inside = depth > 0.3 * depth.max()
        shares.append(np.mean((np.abs(height.depth_mm - depth) < height.std_mm)[inside]))
    assert np.mean(shares) > 0.6


def test_steep_walls_are_confessed() -> None:
    error = reconstructor().error
    assert error is not None
    depth = np.zeros(SHAPE, np.float32)
    depth[60:120, 80:160] = 0.5
    gentle = SlopeMap(np.zeros(SHAPE), np.zeros(SHAPE))
    along_x, along_y = (np.asarray(np.gradient(depth, MM_PER_PX, axis=axis)) for axis in (1, 0))
    steep = SlopeMap(along_x, along_y)
    assert hidden_step_mm(depth, gentle, steepest=error.steepest, every=1, mm_per_px=(MM_PER_PX, MM_PER_PX)) == 0.0
    assert hidden_step_mm(depth, steep, steepest=error.steepest, every=1, mm_per_px=(MM_PER_PX, MM_PER_PX)) > 0.02


def test_any_object_with_slopes_is_a_method() -> None:
    class Bowl:
        name = "bowl"

        def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
            _, p, q = ball((0.0, 0.0), 1.5, 4.0)
            return SlopeMap(p, q)

    depth, _, _ = ball((0.0, 0.0), 1.5, 4.0)
    height = Reconstructor(SENSOR, Bowl()).height_map(Frame(np.zeros((*SHAPE, 3), np.uint8)))
    assert height.depth_mm.dtype == np.float64
    assert height.std_mm is None
    assert np.abs(height.depth_mm - depth).max() < 0.02 * depth.max()


def test_a_reference_is_renewed_by_free_frames_only() -> None:
    rng = np.random.default_rng(9)
    method = calibrated().method
    touched = picture(*ball((0.0, 0.0), 1.5, 4.0)[1:], rng)
    assert tare(method, untouched_of(method, [flat(rng), touched, touched, flat(rng)])) is method.reference
    renewed = tare(method, untouched_of(method, [flat(rng) for _ in range(5)] + [touched]))
    assert renewed is not method.reference
    assert np.abs(renewed.rgb - method.reference.rgb).mean() < 1.0


def test_a_reference_stays_where_free_frames_disagree() -> None:
    """A patch of .5 % of one frame, as a block of a compressed video is."""
    rng = np.random.default_rng(9)
    method, free = calibrated().method, [flat(rng) for _ in range(5)]
    rows, columns = (round(0.07 * size) for size in SHAPE)
    free[2][:rows, :columns] += 12
    with pytest.raises(InputError, match="a flat frame shows a contact"):
        make_reference(free)
    assert tare(method, free) is method.reference


def test_free_frames_take_off_slopes_that_are_not_there() -> None:
    rng = np.random.default_rng(10)
    free = [flat(rng) for _ in range(12)]
    background = calibrated().method.current_background
    bias = np.array([0.01, 0.0, 0.0], np.float32)[:, None, None]
    leaning = dataclasses.replace(calibrated().method, background=background - bias)
    settled = subtract_background(leaning, free)
    fresh = [flat(rng) for _ in range(6)]
    means = [np.mean([method.slopes(rgb).dz_dx for rgb in fresh]) for method in (leaning, settled)]
    assert means[0] > 0.008
    assert abs(means[1]) < 0.001
    assert subtract_background(leaning, free[:2]) is leaning


@pytest.mark.parametrize("given", [SAMPLE, str(SAMPLE), SENSOR])
def test_what_is_no_recording_is_told_how_to_become_one(given: object) -> None:
    with pytest.raises(InputError, match="read_recording"):
        build_reconstructor(given)  # type: ignore[arg-type]


def test_pixels_alone_are_a_frame() -> None:
    """As they come from a camera; what is no picture is told so."""
    rgb = np.asarray(ball_pictures(1, np.random.default_rng(5))[0].rgb)
    one, other = (reconstructor().height_map(given) for given in (rgb, Frame(rgb)))
    assert np.array_equal(one.depth_mm, other.depth_mm)
    assert np.array_equal(reconstructor().rectified(rgb), reconstructor().rectified(Frame(rgb)))
    with pytest.raises(InputError, match="grey levels"):
        reconstructor().height_map(rgb / 255.0)  # type: ignore[arg-type]


def test_a_frame_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match="not as its sensor"):
        reconstructor().height_map(Frame(np.zeros((10, 12, 3), np.uint8)))


def read(path: Path) -> Bytes:
    return np.asarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB))


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="real frames are not at hand")
def test_real_gelsight_mini_goes_the_same_way() -> None:
    folder = REAL / "taxim_gelsight_mini"
    sensor = get_sensor("gelsight_mini", width_px=640, height_px=480, mm_per_px=0.0317)
    images = sorted(folder.glob("img_*.png"))
    flats = [path for path in folder.glob("*.png") if not path.name.startswith("img_")]
    shots = [BallPicture(read(path), 4.0, name=path.name) for path in images]
    reference = make_reference([read(path) for path in flats])
    found = calibrate_from_balls(reference, shots, mm_per_px=sensor.mm_per_px, fit=PHOTOMETRIC["polynomial"])
    assert found.direction_error_deg < 15.0
    height = Reconstructor(sensor, found.method).height_map(Frame(shots[3].rgb))
    assert 0.05 < height.depth_mm.max() < 1.0


def test_threads_that_share_a_reconstructor_get_the_maps_of_one() -> None:
    """Gentle and deep presses in turn, four threads at a time: each map is that of its own picture."""
    reconstructor = sample_reconstructor()
    recording = read_recording(SAMPLE)
    pictures = [reconstructor.rectified(read_frame(recording, k)) for k in range(80, 120, 8)]
    alone = [reconstructor.rectified_map(picture).depth_mm.copy() for picture in pictures]
    turns = [*range(len(pictures))] * 3
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda k: reconstructor.rectified_map(pictures[k]).depth_mm, turns))
    for k, depth_mm in zip(turns, together, strict=True):
        np.testing.assert_allclose(depth_mm, alone[k], atol=1e-6)
    again = pickle.loads(pickle.dumps(reconstructor))  # noqa: S301 - a worker's copy
    np.testing.assert_allclose(again.rectified_map(pictures[0]).depth_mm, alone[0], atol=1e-6)


def test_a_map_is_the_same_to_the_last_bit_wherever_in_memory_it_is_made() -> None:
    frame, reader = read_frame(read_recording(SAMPLE), 73), sample_reconstructor()
    rng, kept, seen = np.random.default_rng(0), [], set()
    for _ in range(12):
        kept.append((np.empty(rng.integers(1, 5_000), np.uint8), bytearray(int(rng.integers(1, 300_000)))))
        seen.add(reader.height_map(frame).depth_mm.tobytes())
    assert len(seen) == 1
