"""What happened to pictures since their reference is told by name; of real frames nothing is said."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from each import each
from shared_scenes import rendered_reconstructor

from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor, free_frames, press_starts, with_flats
from tactilevision.heightmap.reference_match import some_frames
from tactilevision.heightmap.scene_faults import able_to_renew, check_order, scene_faults
from tactilevision.photometric.reference import COLOURS, make_reference
from tactilevision.recording.images import read_image
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image
from tactilevision.records.measured import Bytes
from tactilevision.sensors.rectification import rectify

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared" / "real"
SETS = {
    "gelslim3_mcubelab/markers": "ref.jpg",
    "gelslim_heightmap/test_data": "ref.jpg",
    "taxim_gelsight_mini": "f0.png",
}

Picture = npt.NDArray[np.floating]


@pytest.fixture(scope="module", params=["gelslim3", "rendered_shadows"])
def scene(request: pytest.FixtureRequest) -> tuple[Picture, list[Bytes]]:
    recording = read_recording(ROOT / "sample_frames" / request.param)
    flats = [rectify(recording.sensor, read_image(path)) for path in recording.flats]
    return np.mean(flats, axis=0, dtype=np.float32), some_frames(recording)


def as_light(rgb: Bytes, change: Callable[[Picture], Picture]) -> Bytes:
    light = (rgb.astype(np.float32) / 255) ** 2.2
    return (255 * np.clip(change(light), 0, 1) ** (1 / 2.2)).astype(np.uint8)


def torn(rgb: Bytes) -> Bytes:
    torn = rgb.copy()
    torn[96:128, 256:290] = torn[96:128, 256:290] // 2
    return torn


def _times(factors: Picture, rgb: Bytes, k: int) -> Bytes:
    return np.rint(rgb * factors).astype(np.uint8)


FAULTS: dict[str, tuple[str, Callable[[Bytes, int], Bytes]]] = {
    "swapped": ("BGR for RGB", lambda rgb, k: rgb[..., ::-1]),
    "mirrored": ("mirrored left to right", lambda rgb, k: rgb[:, ::-1]),
    "flipped": ("mirrored top to bottom", lambda rgb, k: rgb[::-1]),
    "both": ("turned by 180 degrees and have red and blue swapped", lambda rgb, k: rgb[::-1, ::-1, ::-1]),
    "lamp": (
        "blue has 0.[56].* a lamp failed",
        lambda rgb, k: as_light(rgb, lambda x: x * np.array([1, 0.9, 0.3], np.float32)),
    ),
    "gamma": ("to the power 1.2", lambda rgb, k: (255 * (rgb / 255.0) ** 1.25).astype(np.uint8)),
    "exposure": ("exposure on automatic", lambda rgb, k: as_light(rgb, lambda x: x * np.float32(1 + 0.04 * k))),
    "torn": (r"a mark near \(27\d, 1[01]\d\) px", lambda rgb, k: torn(rgb)),
    "torn later": (
        r"all frames looked at from number 4 on show a mark near \(27\d, 1[01]\d\) px",
        lambda rgb, k: torn(rgb) if k > 2 else rgb,
    ),
    "lamp later": (
        "in 2 of 9 frames looked at, red has 0.[23].* a lamp failed",
        lambda rgb, k: as_light(rgb, lambda x: x * np.array([0.05, 1, 1], np.float32)) if k > 6 else rgb,
    ),
}
for k, colour in enumerate(("red", "green", "blue")):
    weaker = np.where(np.arange(3) == k, 0.7, 1.0)
    FAULTS[f"{colour} weaker"] = (f"{colour} has 0.7. .* a lamp failed", partial(_times, weaker))
OF_SOME = ("exposure", "torn", "torn later", "lamp later")  # the others spoil all maps


@each("name", FAULTS)
def test_each_fault_is_told_by_its_name(scene: tuple[Picture, list[Bytes]], name: str) -> None:
    reference, pictures = scene
    said, change = FAULTS[name]
    found = scene_faults(reference, [change(rgb, k) for k, rgb in enumerate(pictures)])
    assert len(found) == 1
    assert re.search(said, found[0].sentence)
    assert found[0].spoils == (name not in OF_SOME)


def test_sound_pictures_show_none(scene: tuple[Picture, list[Bytes]]) -> None:
    assert scene_faults(*scene) == ()
    reference, pictures = scene
    drifted = [as_light(rgb, lambda x: x * np.array([1.1, 0.92, 1.0], np.float32)) for rgb in pictures]
    assert scene_faults(reference, drifted) == ()
    assert scene_faults(reference[:-1], pictures) == ()


@each("name", ["swapped", "mirrored", "flipped", "both"])
def test_ball_pictures_of_another_order_are_refused(scene: tuple[Picture, list[Bytes]], name: str) -> None:
    reference, pictures = scene
    said, change = FAULTS[name]
    with pytest.raises(InputError, match=f"the ball pictures (are|have) .*{said.removeprefix('are ')}"):
        check_order(reference, [change(rgb, 0) for rgb in pictures])
    check_order(reference, pictures)


def test_a_calibration_refuses_a_mirrored_reference(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "sample_frames" / "rendered_shadows", tmp_path / "copy")
    for path in (tmp_path / "copy" / "reference" / "flat").iterdir():
        write_image(path, np.ascontiguousarray(read_image(path)[:, ::-1]))
    with pytest.raises(
        InputError, match="flat: the reference is not of the frames' view: the frames are mirrored left to right"
    ):
        build_reconstructor(read_recording(tmp_path / "copy"))


@pytest.mark.skipif(not REAL.is_dir(), reason="real frames are not here")
@pytest.mark.parametrize("name", SETS)
def test_real_presses_show_none(name: str) -> None:
    folder = REAL / name
    reference = read_image(folder / SETS[name]).astype(np.float32)
    pictures = [
        read_image(path)
        for path in sorted(folder.iterdir())
        if path.name[:3] in ("sam", "rec", "img") and path.suffix != ".csv"
    ]
    assert len(pictures) > 10
    assert scene_faults(reference, pictures) == ()
    assert not any(scene_faults(reference, [rgb]) for rgb in pictures)


def test_a_reconstructor_warns_and_flags_its_maps() -> None:
    recording = read_recording(ROOT / "sample_frames" / "rendered_shadows")
    found = rendered_reconstructor()
    pictures = some_frames(recording)
    assert "light" not in found.rectified_map(pictures[0]).flags
    found = found.look([rgb[:, ::-1].copy() for rgb in pictures])
    assert any("mirrored left to right" in line for line in found.warnings)
    assert "light" in found.rectified_map(pictures[0]).flags


@pytest.mark.parametrize("name", ["swapped", "mirrored"])
def test_an_exchange_against_the_methods_own_pictures_is_named(name: str) -> None:
    recording = read_recording(ROOT / "sample_frames" / "rendered_shadows")
    flats = [FAULTS[name][1](read_image(path), 0).copy() for path in recording.flats]
    assert recording.sensor.rectification is None
    found = with_flats(recording.sensor, rendered_reconstructor().method, flats=flats)
    assert any(FAULTS[name][0] in line and "the method was made of" in line for line in found.warnings)
    assert found.match is not None
    assert found.match.other_light


def test_spoiled_frames_do_not_renew_the_reference() -> None:
    recording = read_recording(ROOT / "sample_frames" / "gelslim3")
    reference = make_reference([rectify(recording.sensor, read_image(path)) for path in recording.flats]).rgb
    free = free_frames(recording)[:6]
    assert able_to_renew(reference, free) == free
    dark, mirrored = ([FAULTS[name][1](rgb, 0) for rgb in free] for name in ("lamp", "mirrored"))
    assert able_to_renew(reference, [*dark[:3], *free[3:]]) == free[3:]
    assert able_to_renew(reference, dark) == dark  # what is left of the light is all there is
    assert able_to_renew(reference, mirrored) == []


def test_the_press_of_a_frame_is_told() -> None:
    recording = read_recording(ROOT / "sample_frames" / "gelslim3")
    first, frame = recording.presses[0], press_starts(recording)[0]
    assert first.start_s <= frame.time_s <= first.end_s
    assert frame.name.endswith(f"(press {first.press})")


@each("colour", range(3))
def test_stray_light_hides_no_lamp(scene: tuple[Picture, list[Bytes]], colour: int) -> None:
    reference, pictures = scene
    room = [0.75 * rgb.astype(np.float64) + 40.0 for rgb in (reference, *pictures)]  # all of it in 8 bits
    weaker = np.where(np.arange(3) == colour, 0.7, 1.0)
    later = [weaker * (rgb - 40.0) + 40.0 if k > 4 else rgb for k, rgb in enumerate(room[1:])]
    assert scene_faults(room[0], [np.rint(rgb).astype(np.uint8) for rgb in room[1:]]) == ()
    said = scene_faults(room[0], [np.rint(rgb).astype(np.uint8) for rgb in later])
    assert len(said) == 1
    assert re.search(f"in 4 of 9 .*, {COLOURS[colour]} has 0.(69|7.) .* a lamp failed", said[0].sentence)


def test_frames_that_lack_different_colours_name_no_lamp(scene: tuple[Picture, list[Bytes]]) -> None:
    reference, pictures = scene
    lacking = [
        np.where(np.arange(3) == colour, 0.4, 1.0) * rgb for colour, rgb in zip((0, 2), pictures, strict=False)
    ]
    said = scene_faults(reference, [*pictures[2:], *(rgb.astype(np.uint8) for rgb in lacking)])
    assert not any("lamp failed" in fault.sentence for fault in said)
