"""Folders as people have them: a first picture of another size, pictures further down, none that is read."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from each import each
from PIL import Image
from small_recording import picture, write_small

from tactilevision.errors import InputError, RecordingError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import BadFrame
from tactilevision.recording.pictures import iter_frames
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image


def pictures(folder: Path, sizes: list[tuple[int, int]]) -> Path:
    folder.mkdir(parents=True)
    for number, (width, height) in enumerate(sizes):
        rgb = np.random.default_rng(number).integers(60, 200, (height, width, 3), dtype=np.uint8)
        write_image(folder / f"{number}.png", rgb)
    return folder


def test_the_size_that_most_pictures_have_counts_not_that_of_the_first(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(64, 48), (64, 48), *[(32, 24)] * 6])
    found = read_folder(folder, "gelsight_mini", guess=True)
    assert found.frame_size_px == (32, 24)
    assert found.flat_frames == (2,)
    said = " ".join(found.warnings)
    assert "the first pictures are 64 x 48, most others 32 x 24: 2.png and others of its size are read" in said
    assert "the first frame, 2.png, shows the untouched gel" in said


@pytest.mark.parametrize("sizes", [[(32, 24)] * 5 + [(64, 48)] * 2, [(32, 24), (64, 48)], [(32, 24)]])
def test_the_first_size_stands_where_no_other_is_more_usual(tmp_path: Path, sizes: list[tuple[int, int]]) -> None:
    found = read_folder(pictures(tmp_path / "a", sizes), "gelsight_mini", guess=True)
    assert (found.frame_size_px, found.flat_frames) == ((32, 24), (0,))
    assert "first pictures" not in " ".join(found.warnings)


def test_torn_pictures_have_no_say_in_the_size(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 8)
    for number in (0, 3, 5):
        (folder / f"{number}.png").write_bytes(b"")
    assert read_folder(folder, "gelsight_mini").frame_size_px == (32, 24)


def test_a_reference_is_named_as_the_folder_names_it(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    beside = pictures(tmp_path / "flat", [(32, 24)])
    assert read_folder(folder, "gelsight_mini", reference="1.png").flats == (folder / "1.png",)
    assert read_folder(folder, "gelsight_mini", reference=beside / "0.png").flats == (beside / "0.png",)
    with pytest.raises(RecordingError, match=r"9.png: there is no picture of the untouched gel"):
        read_folder(folder, "gelsight_mini", reference="9.png")


def test_a_folder_without_pictures_says_where_some_lie_or_what_it_holds(tmp_path: Path) -> None:
    below = pictures(tmp_path / "day 0" / "trial ü", [(32, 24)])
    with pytest.raises(RecordingError, match=f"holds no pictures. There are some in {below}. Read are .png"):
        read_folder(tmp_path, "gelsight_mini")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "x.webp").write_bytes(b"")
    with pytest.raises(RecordingError, match=r"holds no pictures. It holds .webp. Read are .*videos: .mp4"):
        read_folder(tmp_path / "b", "gelsight_mini")
    with pytest.raises(RecordingError, match="is neither a picture nor a video of a supported kind"):
        read_folder(tmp_path / "b" / "x.webp", "gelsight_mini")


def test_pictures_of_a_kind_that_is_not_read_are_told_of(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    (folder / "notes.txt").write_text("")
    (folder / "3.WEBP").write_bytes(b"")
    said = " ".join(read_folder(folder, "gelsight_mini").warnings)
    assert "skipped, since pictures of this kind are not read: 3.WEBP" in said
    assert "notes" not in said


@pytest.mark.parametrize("name", [b"caf\xe9.png", b"a\nb.png", b"\x1b[31mred.png"])
def test_a_name_that_no_table_can_hold_is_refused(tmp_path: Path, name: bytes) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    try:
        os.rename(folder / "1.png", os.fsencode(folder) + b"/" + name)
    except OSError:
        pytest.skip("this file system takes no such name")
    with pytest.raises(InputError, match="holds a control character, or is not UTF-8"):
        read_folder(folder, "gelsight_mini")


def test_a_folder_or_a_pipe_with_a_picture_s_name_is_a_lost_picture_only(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    (folder / "00.png").mkdir()
    os.mkfifo(folder / "9.png")
    found = read_folder(folder, "gelsight_mini")
    assert found.frame_size_px == (32, 24)
    lost = [frame.why for frame in iter_frames(found) if isinstance(frame, BadFrame)]
    assert lost == ["is a folder, not a file", "is a pipe, not a file"]


@each("place", ["00", "9"])
@each("kind", ["stack.tiff", "bomb.png", "bomb.npy"])
def test_a_stack_or_a_bomb_is_a_lost_picture_only_first_or_last(
    kind: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    path = folder / f"{place}{kind}"
    monkeypatch.setenv("TACTILEVISION_MAX_PIXELS", "1000")
    if kind == "stack.tiff":
        page = Image.new("RGB", (32, 24), "red")
        page.save(path, save_all=True, append_images=[page])
    elif kind == "bomb.npy":
        np.save(path, np.zeros((48, 64, 3), np.uint8))
    else:
        picture = bytearray((folder / "1.png").read_bytes())
        picture[16:24] = struct.pack(">II", 100_000, 100_000)
        path.write_bytes(picture)
    found = read_folder(folder, "gelsight_mini")
    assert found.frame_size_px == (32, 24)
    bad = [frame for frame in iter_frames(found) if isinstance(frame, BadFrame)]
    assert [frame.name for frame in bad] == [path.name]
    assert ("several pictures" if kind == "stack.tiff" else "beyond the limit") in bad[0].why


def test_where_all_pictures_are_too_large_the_remedy_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    monkeypatch.setenv("TACTILEVISION_MAX_PIXELS", "700")
    with pytest.raises(RecordingError, match=r"none of the first pictures.*set TACTILEVISION_MAX_PIXELS"):
        read_folder(folder, "gelsight_mini")


def test_a_tab_in_a_picture_s_name_is_read(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "a", [(32, 24)] * 3)
    (folder / "1.png").rename(folder / "1\tb.png")
    assert read_folder(folder, "gelsight_mini").frame_names == ("0.png", "1\tb.png", "2.png")


@pytest.mark.parametrize("name", ["flat/v.png", "ball/b2.png"])
def test_every_reference_has_the_size_of_the_frames(tmp_path: Path, name: str) -> None:
    """The first flat is looked at when the recording is read; the others, and balls, when they are."""
    folder = write_small(tmp_path / "small")
    write_image(folder / "reference/flat/untouched.png", np.full((24, 32, 3), (90, 110, 130), np.uint8))
    write_image(folder / "reference/ball/b2.png", picture(2))
    (folder / "reference/ball.csv").write_text("frame,ball_radius_mm\nb1.png,3.0\nb2.png,3.0\n")
    write_image(folder / "reference" / name, picture(3, 16, 12))
    with pytest.raises(RecordingError, match=rf"{name}: the picture is 16 x 12, the others 32 x 24"):
        build_reconstructor(read_recording(folder))


@pytest.mark.parametrize("name", ["flat/untouched.png", "ball/b1.png"])
def test_references_of_twelve_bits_in_sixteen_are_asked_about(tmp_path: Path, name: str) -> None:
    folder = write_small(tmp_path / "small")
    cv2.imwrite(str(folder / "reference" / name), picture(3)[..., ::-1].astype(np.uint16) * 16)
    (warning,) = read_recording(folder).warnings
    assert warning.startswith(f"{name}: its largest value is 40")
    assert "state white_level in recording.toml" in warning


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_references_that_state_another_orientation_than_the_frames_are_named(tmp_path: Path, suffix: str) -> None:
    folder = write_small(tmp_path / "small")
    exif = Image.Exif()
    exif[274] = 3
    how: dict[str, Any] = {"tiffinfo": exif} if suffix == ".tif" else {"exif": exif}
    flat = folder / "reference" / "flat" / f"tagged{suffix}"
    Image.fromarray(picture(20)).save(flat, **how)
    (warning,) = read_recording(folder).warnings
    assert warning.startswith(f"flat/tagged{suffix}: the orientation tag is 3, that of the frames 1")
    exif[274] = 1
    Image.fromarray(picture(20)).save(flat, **how)
    assert read_recording(folder).warnings == ()


def test_frames_and_references_of_one_orientation_agree(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6
    for name in ("frames/0.jpg", "frames/1.jpg", "flat/0.jpg"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.fromarray(picture(1)).save(tmp_path / name, exif=exif)
    found = read_folder(tmp_path / "frames", "gelsight_mini", reference=tmp_path / "flat")
    assert not any("orientation" in warning for warning in found.warnings)
    write_image(tmp_path / "flat" / "1.png", picture(1))
    found = read_folder(tmp_path / "frames", "gelsight_mini", reference=tmp_path / "flat")
    assert any("flat/1.png: the orientation tag is 1, that of the frames 6" in one for one in found.warnings)


def test_listed_frames_of_a_kind_that_is_not_read_are_named(tmp_path: Path) -> None:
    folder = write_small(tmp_path / "small")
    for path in (folder / "frames").iterdir():
        path.rename(path.with_suffix(".gif"))
    with pytest.raises(RecordingError, match=r"none of its 10 files is a picture or a video.*got 'f0.gif'"):
        read_recording(folder)
