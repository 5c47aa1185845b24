"""Light calibrated on contacts of unknown shape: planted lights are found, but for their scale; real ones too."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from shared_scenes import scenes, shared

from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.self_calibration import (
    MIN_CONTACTS,
    Contact,
    Prior,
    calibrate_on_contacts,
    contact_of,
    contradict,
)
from tactilevision.photometric.ball_pictures import BallPicture, locate
from tactilevision.photometric.ball_samples import ball_samples
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.methods.network import find_model
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_network
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import ASSUMED_SCALE, REFERENCE
from tactilevision.records.measured import Floats, Picture
from tactilevision.records.rig import Sensor
from tactilevision.sensors import get_sensor
from tactilevision.sensors.rectification import rectify

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"
REAL = Path(__file__).parents[2] / ".." / "shared" / "real"
SIZE = (160, 200)
SCALE = (0.0634, 0.0634)
LIGHT = np.array([[0.9, 0.3], [-0.7, 0.6], [0.1, -0.8]])  # change of three colours with the two slopes


def bumps(rng: np.random.Generator, *, many: int) -> tuple[Floats, Floats]:
    """Slopes (H, W) of a dent of several ellipses, of no shape in particular."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    depth = np.zeros(SIZE)
    middle = rng.uniform((60, 50), (140, 110))
    for _ in range(many):
        cx, cy = middle + rng.uniform(-8, 8, 2)
        wide, turn = rng.uniform(6, 14, 2), rng.uniform(0, np.pi)
        a = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn)
        b = (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
        depth += rng.uniform(1.5, 3.0) * np.exp(-0.5 * ((a / wide[0]) ** 2 + (b / wide[1]) ** 2))
    q, p = np.gradient(depth)
    return p, q


def shown(p: Floats, q: Floats, rng: np.random.Generator, *, noise: float = 0.01) -> Picture:
    """Relative change (3, H, W) of colour under LIGHT, which turns a little over the picture."""
    x = np.linspace(-1, 1, SIZE[1])[None]
    turned = np.stack([p - 0.1 * x * q, q + 0.1 * x * p])
    change = np.einsum("ck,khw->chw", LIGHT, turned) - 0.3 * (p * p + q * q)
    return np.asarray(change + noise * rng.standard_normal(change.shape), np.float32)


def contacts(count: int, seed: int) -> list[Contact]:
    rng = np.random.default_rng(seed)
    found = [contact_of(shown(*bumps(rng, many=3), rng), np.ones(SIZE, bool), rng) for _ in range(count)]
    assert all(one is not None for one in found)
    return [one for one in found if one is not None]


@each("count", [1, 2, MIN_CONTACTS, 10, 30])
def test_a_planted_light_is_found_but_for_its_scale(count: int) -> None:
    law = calibrate_on_contacts(contacts(count, seed=count), None)
    assert law is not None
    rng = np.random.default_rng(99)
    p, q = bumps(rng, many=3)
    steep = np.hypot(p, q) > 0.1
    change = shown(p, q, rng)[:, steep].T.astype(float)
    y, x = np.nonzero(steep)
    place = np.stack([2 * x / (SIZE[1] - 1) - 1, 2 * y / (SIZE[0] - 1) - 1], axis=1)
    true = np.stack([p[steep], q[steep]], axis=1)
    off = direction_error_deg(law.at(change, place), true)
    assert np.median(off) < (
        10.0 if count < MIN_CONTACTS else 5.0 if count < 24 else 3.0
    )  # a dent, not a bump: the sign is right, too


def test_the_scale_is_that_of_the_prior() -> None:
    given = contacts(10, seed=3)
    steeper = 3.0 * np.linalg.pinv(LIGHT)  # three times as steep as it is
    law = calibrate_on_contacts(given, lambda change, place: change @ steeper.T)
    assert law is not None
    change = np.concatenate([one.change for one in given])
    place = np.concatenate([one.place for one in given])
    slopes, wanted = law.at(change, place), change @ steeper.T
    assert np.sum(slopes * wanted) / np.sum(wanted**2) == pytest.approx(1.0, abs=0.02)


def turned(degrees: float) -> Prior:
    """The right law but for a turn of its slopes, as of a network made for lamps that stand a little elsewhere."""
    angle = np.radians(degrees)
    law = np.linalg.pinv(LIGHT).T @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return lambda change, place: change @ law


@pytest.mark.parametrize(("count", "most_deg"), [(1, 15.0), (3, 10.0), (10, 6.0)])
def test_contacts_correct_a_prior_that_is_turned(count: int, most_deg: float) -> None:
    law = calibrate_on_contacts(contacts(count, seed=20 + count), turned(25.0))
    assert law is not None
    rng = np.random.default_rng(98)
    p, q = bumps(rng, many=3)
    steep = np.hypot(p, q) > 0.1
    y, x = np.nonzero(steep)
    place = np.stack([2 * x / (SIZE[1] - 1) - 1, 2 * y / (SIZE[0] - 1) - 1], axis=1)
    found = law.at(shown(p, q, rng)[:, steep].T.astype(float), place)
    assert np.median(direction_error_deg(found, np.stack([p[steep], q[steep]], axis=1))) < most_deg


def test_contacts_contradict_swapped_colours_and_mirrored_pictures() -> None:
    right = turned(0.0)
    for count in (1, 4):
        seen = contacts(count, seed=30 + count)
        assert not contradict(seen, right)
        assert not contradict(seen, turned(30.0))
        assert contradict(seen, lambda change, place: right(change[:, ::-1], place))
        assert contradict(seen, lambda change, place: right(change, place) * np.array([-1.0, 1.0]))
    assert not contradict([], right)


def test_too_few_contacts_and_white_light_tell_nothing() -> None:
    few = contacts(MIN_CONTACTS - 1, seed=0)
    assert calibrate_on_contacts([], None) is None
    assert calibrate_on_contacts(few, None) is not None
    rng = np.random.default_rng(5)
    grey = []
    for _ in range(8):
        p, _ = bumps(rng, many=3)
        white = np.broadcast_to(0.8 * p, (3, *SIZE)) + 0.01 * rng.standard_normal((3, *SIZE))
        grey.append(contact_of(np.asarray(white, np.float32), np.ones(SIZE, bool), rng))
    assert calibrate_on_contacts([one for one in grey if one is not None], None) is None


def test_one_ridge_does_not_tell_the_light() -> None:
    """Its slopes lie along one line: a law that reads them well may turn all others."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    q, p = np.gradient(3.0 * np.exp(-0.5 * (((x - 100) / 6) ** 2 + ((y - 80) / 40) ** 2)))
    ridge = contact_of(shown(p, q, rng), np.ones(SIZE, bool), rng)
    assert ridge is not None
    assert calibrate_on_contacts([ridge], None) is None


def test_an_untouched_frame_has_no_contact() -> None:
    rng = np.random.default_rng(1)
    still = np.asarray(0.01 * rng.standard_normal((3, *SIZE)), np.float32)
    assert contact_of(still, np.ones(SIZE, bool), rng) is None


def bare_folder(folder: Path, sensor: Sensor, *, swapped: bool = False) -> Recording:
    """Ball pictures of the sample as frames of a sensor; nobody says that they are balls."""
    sample = read_recording(SAMPLE)
    (folder / "untouched").mkdir()
    targets = {ball.path: folder / ball.path.name for ball in sample.balls}
    for source, target in {**targets, sample.flats[0]: folder / "untouched" / "flat.png"}.items():
        picture = cv2.imread(str(source))
        assert picture is not None
        rectified = rectify(sample.sensor, picture)
        cv2.imwrite(str(target), rectified[..., ::-1] if swapped else rectified)
    return read_folder(folder, sensor, reference=folder / "untouched")


@shared
def marker_folder() -> tuple[Recording, Reconstructor]:
    """Those frames as of a GelSlim with markers, and what reads them."""
    folder = scenes() / "marker_folder"
    folder.mkdir()
    recording = bare_folder(folder, get_sensor("gelslim3_markers"))
    return recording, build_reconstructor(recording)


def test_a_bare_folder_is_read_by_its_own_contacts(tmp_path: Path) -> None:
    sample = read_recording(SAMPLE)
    sensor = get_sensor("custom", width_px=427, height_px=320, mm_per_px=0.0634)
    found = build_reconstructor(bare_folder(tmp_path, sensor))
    assert "16 contacts in the frames" in " ".join(found.warnings)
    assert "factor of two or three" in " ".join(found.warnings)
    flat = cv2.imread(str(tmp_path / "untouched" / "flat.png"))
    assert flat is not None
    assert ASSUMED_SCALE in found.rectified_map(np.ascontiguousarray(flat[..., ::-1])).flags
    law, off = found.method.law, []  # type: ignore[attr-defined]
    change, rng = ColourChange(found.method.reference), np.random.default_rng(0)  # type: ignore[attr-defined]
    for number, ball in enumerate(sample.balls[::4]):
        raw = cv2.imread(str(tmp_path / ball.path.name))
        assert raw is not None
        picture = BallPicture(np.ascontiguousarray(raw[..., ::-1]), ball.ball_radius_mm)
        u, _, valid = change.measure(picture.rgb)
        place = locate(u, valid, picture=picture, mm_per_px=SCALE)
        seen = ball_samples(u, place, mm_per_px=SCALE, number=number, most=300, valid=valid, rng=rng)
        off.append(direction_error_deg(law.at(seen.change, seen.place), seen.slopes))
    assert np.median(np.concatenate(off)) < 12.0


def test_red_changed_for_blue_is_named_by_the_contacts(tmp_path: Path) -> None:
    swapped = build_reconstructor(bare_folder(tmp_path, get_sensor("gelslim3_markers"), swapped=True))
    right, wrong = (" ".join(found.warnings) for found in (marker_folder()[1], swapped))
    assert "the scale is that of a usual gelslim3_markers" in right
    assert "contradict" not in right
    assert "contradict the ready network" in wrong
    assert "red changed for blue" in wrong


def test_a_first_frame_that_is_pressed_gives_way_to_the_median(tmp_path: Path) -> None:
    """Balls at sixteen places and no untouched picture: maps are as by one, where the first frame makes hills."""
    sensor = get_sensor("gelslim3_markers")
    bare_folder(tmp_path, sensor)
    shutil.rmtree(tmp_path / "untouched")
    stated = marker_folder()[1]
    recording = read_folder(tmp_path, sensor, guess=True)
    found = build_reconstructor(recording)
    said = " ".join(found.warnings)
    assert f"{recording.frame_names[0]} shows a contact" in said
    assert "the median of 16 frames" in said
    assert "contradict" not in said
    for number in (0, 7):
        rgb = read_frame(recording, number).rgb
        depth, true = (one.rectified_map(rgb).depth_mm for one in (found, stated))
        assert np.corrcoef(depth.ravel(), true.ravel())[0, 1] > 0.95


def test_a_median_that_is_pressed_itself_is_no_reference(tmp_path: Path) -> None:
    """Eleven of sixteen frames press one place, the first another: free frames would show a dent, unflagged."""
    sensor, free = get_sensor("gelslim3_markers"), (3, 6, 10, 13)
    stated = bare_folder(tmp_path, sensor)
    first, often = (read_frame(stated, number).rgb for number in (0, 7))
    flat = cv2.imread(str(tmp_path / "untouched" / "flat.png"))
    assert flat is not None
    rng = np.random.default_rng(0)
    for number, name in enumerate(stated.frame_names):
        rgb = flat[..., ::-1] if number in free else often
        grainy = np.clip(rgb + rng.normal(0.0, 1.0, rgb.shape), 0, 255).round().astype(np.uint8)
        cv2.imwrite(str(tmp_path / name), (grainy if number else first)[..., ::-1])
    shutil.rmtree(tmp_path / "untouched")
    recording = read_folder(tmp_path, sensor, guess=True)
    found = build_reconstructor(recording)
    said = " ".join(found.warnings)
    assert "the median of" not in said
    assert "most frames show a hill" in said
    for number in (1, 3):
        assert REFERENCE in found.rectified_map(read_frame(recording, number).rgb).flags


def test_a_stated_reference_that_is_pressed_is_named_and_turns_no_dent() -> None:
    sensor = get_sensor("gelslim3_markers")
    stated, reader = marker_folder()
    pressed = stated.path / stated.frame_names[0]
    found = build_reconstructor(read_folder(stated.path, sensor, reference=pressed))
    said = " ".join(found.warnings)
    assert "most frames show a hill" in said
    assert "contradict" not in said
    height = found.rectified_map(read_frame(stated, 7).rgb)
    true = reader.rectified_map(read_frame(stated, 7).rgb).depth_mm
    assert REFERENCE in height.flags
    assert height.depth_mm.max() == pytest.approx(true.max(), rel=0.3)
    assert np.argmax(height.depth_mm) == pytest.approx(np.argmax(true), abs=10 * true.shape[1])


@pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not at hand")
def test_real_frames_are_read_better_than_by_the_network() -> None:
    """Ten presses of a GelSlim as contacts, each half read by the law of the other: 5.2 degrees, the network 6."""
    where = REAL / "gelslim_heightmap" / "test_data"
    with np.load(where.parent / "abe_corr.npz", allow_pickle=False) as table:
        x, y = table["x"], table["y"]
    flat = cv2.imread(str(where / "ref.jpg"))
    assert flat is not None
    reference = make_reference([np.ascontiguousarray(flat[x, y, ::-1])])
    path = find_model("gelslim3")
    assert path is not None
    network = load_network(path, reference).law
    change, rng = ColourChange(reference), np.random.default_rng(0)
    seen, samples = [], []
    for number, name in enumerate(sorted(where.glob("sample_*.jpg"))):
        raw = cv2.imread(str(name))
        assert raw is not None
        picture = BallPicture(np.ascontiguousarray(raw[x, y, ::-1]), 3.8)
        u, _, valid = change.measure(picture.rgb)
        seen.append(contact_of(u, valid, rng))
        ball = locate(u, valid, picture=picture, mm_per_px=SCALE)
        samples.append(ball_samples(u, ball, mm_per_px=SCALE, number=number, most=200, valid=valid, rng=rng))
    own, ready = [], []
    for half in (0, 1):
        law = calibrate_on_contacts([one for one in seen[1 - half :: 2] if one is not None], network.at)
        assert law is not None
        for one in samples[half::2]:
            own.append(direction_error_deg(law.at(one.change, one.place), one.slopes))
            ready.append(direction_error_deg(network.at(one.change, one.place), one.slopes))
    assert np.median(np.concatenate(own)) < 0.95 * np.median(np.concatenate(ready))
