"""Every kind of picture becomes (H, W, 3) of 8 bits, red first; the file's type decides, never what it shows."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from each import each
from PIL import Image
from small_recording import edit, picture, write_small

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.images import read_image
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image


def save(array: npt.NDArray[Any], path: Path) -> Path:
    """Write an array in the order red, green, blue (and opacity) as it is."""
    if path.suffix == ".npy":
        np.save(path, array)
    else:
        order = [2, 1, 0, 3][: array.shape[2]] if array.ndim == 3 else slice(None)
        assert cv2.imwrite(str(path), np.ascontiguousarray(array[..., order]))
    return path


@each("suffix", [".png", ".tif", ".tiff", ".bmp", ".npy", ".PNG"])
def test_pictures_without_loss_come_back_as_they_were(tmp_path: Path, suffix: str) -> None:
    write_image(tmp_path / f"a{suffix}", picture(1))
    np.testing.assert_array_equal(read_image(tmp_path / f"a{suffix}"), picture(1))


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg"])
def test_jpeg_keeps_its_colours_in_order(tmp_path: Path, suffix: str) -> None:
    orange = np.full((16, 16, 3), (250, 120, 10), dtype=np.uint8)
    write_image(tmp_path / f"a{suffix}", orange)
    np.testing.assert_allclose(read_image(tmp_path / f"a{suffix}").astype(int), orange.astype(int), atol=3)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".npy"])
def test_sixteen_bits_are_scaled_by_their_type_alone(tmp_path: Path, suffix: str) -> None:
    deep = picture(2).astype(np.uint16) * 257
    np.testing.assert_array_equal(read_image(save(deep, tmp_path / f"a{suffix}")), picture(2))
    dark = np.full((8, 8, 3), 4095, dtype=np.uint16)  # white of a camera of 12 bits
    path = save(dark, tmp_path / f"dark{suffix}")
    assert read_image(path).max() == round(4095 / 257)
    assert read_image(path, white_level=4095).min() == 255


def test_what_another_thread_says_while_a_picture_is_decoded_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, decoded = save(picture(1), tmp_path / "a.png"), cv2.imdecode
    said = iter((b"reading, 10 s\n", b"reading, 20 s at p03\n"))

    def overheard(data: npt.NDArray[np.uint8], how: int) -> npt.NDArray[Any]:
        os.write(2, next(said))
        return np.asarray(decoded(data, how))

    monkeypatch.setattr("tactilevision.files.pictures.cv2.imdecode", overheard)
    np.testing.assert_array_equal(read_image(path), picture(1))


@each("dtype", [np.float32, np.float64])
@each("suffix", [".tiff", ".npy"])
def test_floating_point_runs_from_0_to_1(tmp_path: Path, suffix: str, dtype: type) -> None:
    path = save((picture(3) / 255).astype(dtype), tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(read_image(path), picture(3))


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".npy"])
def test_transparency_is_dropped(tmp_path: Path, suffix: str) -> None:
    opaque = np.dstack([picture(4), np.full((24, 32), 7, np.uint8)])
    np.testing.assert_array_equal(read_image(save(opaque, tmp_path / f"a{suffix}")), picture(4))


@each(
    "array, suffix, said",
    [
        (picture()[..., 0], ".png", "grey"),
        (picture()[..., 0], ".jpg", "grey"),
        (picture()[..., :1], ".npy", "grey"),
        (picture()[..., 0].astype(np.uint16), ".tiff", "grey"),
        (picture().astype(np.int64), ".npy", "8 or 16 bit unsigned integers"),
        (picture() / 10.0, ".npy", "runs from 0 to 1"),
        (np.full((4, 4, 3), np.nan), ".npy", "runs from 0 to 1"),
        (np.zeros((3, 24, 32), np.uint8), ".npy", r"has the shape \(height, width, 3\)"),
        (np.array([{}]), ".npy", "the array is damaged"),
        (np.zeros((0, 5, 3), np.float32), ".npy", "the picture is empty"),
    ],
)
def test_pictures_of_no_use_are_named(tmp_path: Path, array: npt.NDArray[Any], suffix: str, said: str) -> None:
    path = save(array, tmp_path / f"a{suffix}")
    with pytest.raises(RecordingError, match=f"a{suffix}: .*{said}"):
        read_image(path)


@each("mode, suffix", [("P", ".png"), ("P", ".tif"), ("P", ".bmp"), ("LAB", ".tif")])
def test_colours_that_a_file_has_changed_are_refused(tmp_path: Path, mode: str, suffix: str) -> None:
    """A palette of 256 colours is tens of grey levels off a real frame; L*, a*, b* are no red, green and blue."""
    Image.fromarray(picture(5)).convert(mode).save(tmp_path / f"a{suffix}")
    with pytest.raises(RecordingError, match=rf"a{suffix}: the picture's colours are not those of the sensor"):
        read_image(tmp_path / f"a{suffix}")


@each("suffix", [".png", ".npy", ".tiff"])
@each("dtype", [np.uint8, np.uint16])
def test_grey_in_three_equal_colours_is_grey(tmp_path: Path, suffix: str, dtype: type) -> None:
    grey: npt.NDArray[Any] = np.repeat(picture(6)[..., :1], 3, axis=2).astype(dtype) * (
        257 if dtype is np.uint16 else 1
    )
    with pytest.raises(RecordingError, match="the picture is grey"):
        read_image(save(grey, tmp_path / f"a{suffix}"))
    even: npt.NDArray[Any] = np.full(
        (24, 32, 3), np.iinfo(dtype).max, dtype
    )  # overexposed: the light is at fault, no copy
    assert read_image(save(even, tmp_path / f"a{suffix}")).min() == 255


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_an_orientation_that_is_stated_is_not_followed(tmp_path: Path, suffix: str) -> None:
    smooth = cv2.resize(picture(7)[::8, ::8], (32, 24), interpolation=cv2.INTER_CUBIC)
    exif = Image.Exif()
    for turn in range(1, 9):
        exif[274] = turn
        how: dict[str, Any] = {"tiffinfo": exif} if suffix == ".tif" else {"exif": exif}
        Image.fromarray(smooth).save(tmp_path / f"a{suffix}", quality=98, **how)
        np.testing.assert_allclose(read_image(tmp_path / f"a{suffix}"), smooth.astype(float), atol=20)


def test_a_film_of_png_is_refused(tmp_path: Path) -> None:
    one, two = Image.fromarray(picture(1)), Image.fromarray(picture(2))
    one.save(tmp_path / "film.png", save_all=True, append_images=[two])
    with pytest.raises(RecordingError, match="holds several pictures instead of one"):
        read_image(tmp_path / "film.png")


@pytest.mark.parametrize("mode", ["LA", "L"])
def test_grey_with_transparency_is_grey(tmp_path: Path, mode: str) -> None:
    """OpenCV makes four equal channels of it."""
    Image.fromarray(picture()).convert(mode).save(tmp_path / "a.png")
    with pytest.raises(RecordingError, match="the picture is grey"):
        read_image(tmp_path / "a.png")


def test_numbers_of_another_processor_are_read(tmp_path: Path) -> None:
    path = save(picture().astype(">u2") * 257, tmp_path / "a.npy")
    np.testing.assert_array_equal(read_image(path), picture())


def test_a_picture_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"gone.png: the file is missing"):
        read_image(tmp_path / "gone.png")


def test_a_kind_that_is_not_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pictures are written as .png"):
        write_image(tmp_path / "a.gif", picture())


def test_the_white_of_a_camera_is_read_from_the_settings(tmp_path: Path) -> None:
    folder = write_small(tmp_path / "small")
    deep = picture(0).astype(np.uint16) * 16
    save(deep, folder / "frames/f0.png")
    assert any("white_level" in warning for warning in read_recording(folder).warnings)
    edit(folder / "recording.toml", "width_px", "white_level = 4080\nwidth_px")
    recording = read_recording(folder)
    assert recording.warnings == ()
    np.testing.assert_array_equal(read_frame(recording, 0).rgb, picture(0))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tiff"])
def test_damage_is_named_and_the_decoder_says_nothing_of_its_own(
    tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """A flipped stretch in the middle: libjpeg and libtiff fill up what is lost, and only mutter."""
    rgb = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (320, 427, 3)).astype(np.uint8), (0, 0), 3)
    data = bytearray(cv2.imencode(suffix, rgb)[1].tobytes())
    third = len(data) // 3
    data[third : third + 40] = bytes(255 - value for value in data[third : third + 40])
    path = tmp_path / f"torn{suffix}"
    path.write_bytes(bytes(data))
    with pytest.raises(RecordingError, match=r"damaged|cannot be decoded"):
        read_image(path)
    assert capfd.readouterr().err == ""


def test_a_stack_of_tiffs_is_refused_and_thumbnails_and_masks_are_none(tmp_path: Path) -> None:
    one, two = Image.fromarray(picture(1)), Image.fromarray(picture(2))
    one.save(tmp_path / "stack.tiff", save_all=True, append_images=[two])
    with pytest.raises(RecordingError, match="holds several pictures instead of one"):
        read_image(tmp_path / "stack.tiff")
    for kind, second in ((1, two.resize((8, 8))), (4, two.convert("1"))):
        second.encoderinfo = {"tiffinfo": {254: kind}}
        one.save(tmp_path / "second.tiff", save_all=True, append_images=[second])
        np.testing.assert_array_equal(read_image(tmp_path / "second.tiff"), picture(1))


def test_an_array_with_its_colours_first_is_told_how_to_turn(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((3, 40, 50), np.uint8))
    with pytest.raises(RecordingError, match="colours last"):
        read_image(tmp_path / "a.npy")
