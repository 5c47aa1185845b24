"""What files state is checked before it is believed: names, kinds, sizes, shapes, numbers."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from hypothesis import example, given, settings, strategies as st

from tactilevision.errors import InputError
from tactilevision.files.arrays import read_archive, read_array, read_arrays
from tactilevision.files.documents import parse_toml, read_json
from tactilevision.files.opening import check_numbers, inside, limit, number, open_regular, read_bytes
from tactilevision.files.pictures import UnknownPictureError, check_picture, is_cut, picture_size

OUTWARD = ["../a.png", "a/../../b.png", "/etc/passwd", "~/a.png", "C:\\a.png", "..\\a.png", ""]


def png(width: int, height: int) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", width, height, 8, 2, 0, 0, 0)


def npy(header: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()


@each("name", OUTWARD)
def test_a_name_that_leads_out_of_its_folder_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="leads out of its folder"):
        inside(tmp_path, name, where="frames.csv")


@each("mark", list("\n\x1b\x7f\x85\x9b\u2028\u2029\u202e\u2066"))
def test_a_name_that_breaks_lines_or_turns_them_round_is_refused(mark: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds a control character"):
        inside(tmp_path, f"a{mark}b.png", where="frames.csv")
    assert inside(tmp_path, "a\tb\u00a0\u00fc.png", where="frames.csv").name == "a\tb\u00a0\u00fc.png"


def test_a_link_may_lead_within_the_folder_and_not_out_of_it(tmp_path: Path) -> None:
    folder, beside = tmp_path / "in", tmp_path / "beside.png"
    folder.mkdir()
    beside.write_bytes(b"victim")
    (folder / "own.png").write_bytes(b"own")
    (folder / "near.png").symlink_to("own.png")
    (folder / "far.png").symlink_to(beside)
    (folder / "up").symlink_to(tmp_path)
    assert inside(folder, "near.png", where="") == folder / "near.png"
    for name in ("far.png", "up/beside.png"):
        with pytest.raises(InputError, match="leads out of its folder"):
            inside(folder, name, where="frames.csv")


@given(name=st.text(st.characters(exclude_categories=["Cs"]), max_size=30))
@settings(max_examples=300, deadline=None)
def test_whatever_passes_stays_inside(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp()
    try:
        path = inside(folder, name, where="")
    except InputError:
        return
    assert Path(os.path.normpath(path)).is_relative_to(folder)


def test_only_regular_files_are_opened_and_none_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, kind in ((tmp_path / "pipe", "a pipe"), (Path("/dev/zero"), "a device"), (tmp_path, "a folder")):
        with pytest.raises(InputError, match=f"is {kind}, not a file"):
            open_regular(path)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "nothing")


def test_a_limit_is_raised_in_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="TACTILEVISION_MAX_PIXELS"):
        check_picture(png(30_000, 30_000), where="a.png")
    monkeypatch.setenv("TACTILEVISION_MAX_PIXELS", "1000000000")
    check_picture(png(30_000, 30_000), where="a.png")
    monkeypatch.setenv("TACTILEVISION_MAX_PIXELS", "-3")
    with pytest.raises(InputError, match="whole number above 0"):
        limit("MAX_PIXELS")


@given(
    width=st.integers(1, 300),
    height=st.integers(1, 300),
    suffix=st.sampled_from([".png", ".jpg", ".tiff", ".bmp"]),
)
@settings(max_examples=60, deadline=None)
def test_the_header_states_the_size_that_opencv_decodes(width: int, height: int, suffix: str) -> None:
    done, data = cv2.imencode(suffix, np.zeros((height, width, 3), np.uint8))
    assert done
    assert picture_size(data.tobytes()) == (width, height)


@given(
    st.binary(max_size=200),
    st.sampled_from([b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"II*\0", b"MM\0*", b"II+\0", b"BM"]),
)
@settings(max_examples=300, deadline=None)
def test_a_damaged_header_has_no_size_and_no_fault(data: bytes, magic: bytes) -> None:
    size = picture_size(magic + data)
    assert size is None or len(size) == 2


@each(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }\n",
        "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }\n",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-3,), }\n",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (",
        "{'descr': 7, 'fortran_order': False, 'shape': (3,), }\n",
        "(" * 500,
    ],
)
def test_an_array_is_refused_by_its_header(header: str) -> None:
    with pytest.raises(InputError, match=r"damaged|beyond the limit"):
        read_array(npy(header), where="a.npy")


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("map_x.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (900000000,), }\n"))
    with pytest.raises(InputError, match="beyond the limit"):
        read_arrays(path)


@example(place=304, value=1)  # the mark of an encrypted member
@given(place=st.integers(0, 400), value=st.integers(0, 255))
@settings(max_examples=200, deadline=None)
def test_a_flipped_byte_never_gets_through_as_another_error(
    place: int, value: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, map_x=np.arange(12.0).reshape(3, 4), map_y=np.ones((3, 4), np.float32))
    data = bytearray(buffer.getvalue())
    data[place % len(data)] = value
    path = tmp_path_factory.getbasetemp() / "flipped.npz"
    path.write_bytes(data)
    try:
        arrays = read_arrays(path)
    except InputError:
        return
    assert all(isinstance(array, np.ndarray) for array in arrays.values())


@each(
    "text, why",
    [
        (".".join(["a"] * 20_000) + " = 1", "parts of a key"),
        ("[" + ".".join(['"a"'] * 20_000) + "]", "parts of a key"),
        ("a = " + "[" * 2_000, "recursion"),
        ("a = " + "9" * 5_000, "digits"),
        ("a = [{b = " + "9" * 400 + "}]", "digits"),
        ("a = 0x" + "F" * 400, "digits"),
        ("a = [", "is not TOML"),
        ("a = 1\na = 2", "twice"),
    ],
)
def test_toml_beyond_the_limits_is_refused(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse_toml(text, where="recording.toml")


def test_ordinary_toml_passes() -> None:
    text = "# [[[[ 1.2.3\nnumber = 1.5\nlist = [[1, 2], [3, 4]]\ntext = '[[[['\n[sensor.gel]\nthickness_mm = 3.0\n"
    assert parse_toml(text, where="")["sensor"] == {"gel": {"thickness_mm": 3.0}}


DEEP, LONG, LARGE = '{"a": ' + "[" * 100_000, '{"a": ' + "9" * 5_000 + "}", '{"a": ' + "9" * 400 + "}"


@each("text", ['{"a": 1e400}', '{"a": NaN}', DEEP, LONG, LARGE, "[1]", "{", '"a"', "\ufeff"])
def test_json_that_is_no_table_of_finite_numbers_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"is not JSON|is not a table"):
        read_json(path)


def test_json_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("\ufeff" + json.dumps({"a": [1.5, None]}), encoding="utf-8")
    assert read_json(path) == {"a": [1.5, None]}


def test_truth_values_and_text_are_no_numbers() -> None:
    assert number(3, what="x", where="a") == 3.0
    assert number(None, what="x", where="a") is None
    for value in (True, "3", [3], {"value": 3}):
        with pytest.raises(InputError, match="a: x is no number"):
            number(value, what="x", where="a")


@each("value", [float("nan"), float("inf"), -1e13, 10**250])
def test_a_number_that_no_sensor_gives_is_refused(value: float) -> None:
    with pytest.raises(InputError):
        number(value, what="x", where="a")


def test_a_gap_passes_where_an_infinite_number_does_not() -> None:
    check_numbers(np.array([np.nan, 1.0]), what="x", where="a")
    check_numbers(np.full(3, np.nan), what="x", where="a")
    with pytest.raises(InputError, match="TACTILEVISION_MAX_NUMBER"):
        check_numbers(np.array([np.nan, -np.inf]), what="x", where="a")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_picture_without_its_end_is_cut(suffix: str) -> None:
    data = cv2.imencode(suffix, np.zeros((9, 7, 3), np.uint8))[1].tobytes()
    assert not is_cut(data)
    assert not is_cut(data + b"what a camera adds")
    assert all(is_cut(data[:length]) for length in range(len(data) - 20, len(data) - 1))


def test_a_chunk_longer_than_its_file_is_cut() -> None:
    data = cv2.imencode(".png", np.zeros((9, 7, 3), np.uint8))[1].tobytes()
    assert is_cut(data[:33] + b"\xfe" + data[34:])


# a GIF of 35 bytes that a decoder gives 7 GB
BOMB = b"GIF89a" + struct.pack("<HHBBB", 30_000, 30_000, 0xF0, 0, 0) + b"\0\0\0\xff\xff\xff,"


@each("data", [BOMB, b"RIFF\0\0\0\0WEBPVP8L", b"P6 30000 30000 255\n", b"<html>", png(9, 9)[:20]])
def test_a_picture_that_states_no_size_never_reaches_a_decoder(data: bytes) -> None:
    with pytest.raises(UnknownPictureError, match="is no PNG, JPEG, TIFF or BMP"):
        check_picture(data, where="a.png")


def tiff(*entries: tuple[int, int, bytes]) -> bytes:
    """The start of a TIFF with these entries: tag, type, value."""
    listed = b"".join(struct.pack("<HHI", tag, kind, 1) + value.ljust(4, b"\0") for tag, kind, value in entries)
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + listed


@pytest.mark.parametrize("kind", [4, 9])
def test_the_size_of_a_tiff_is_the_one_that_libtiff_takes(kind: int) -> None:
    large, small = struct.pack("<i", 30_000), struct.pack("<H", 8)
    data = tiff((256, kind, large), (257, kind, large), (256, 3, small), (257, 3, small))
    with pytest.raises(InputError, match="30000 x 30000"):
        check_picture(data, where="a.tiff")


def test_stray_bytes_do_not_hide_the_size_of_a_jpeg() -> None:
    data = cv2.imencode(".jpg", np.zeros((9, 7, 3), np.uint8))[1].tobytes()
    stray = data[:2] + b"\x00\x17" + data[2:]
    assert picture_size(stray) == picture_size(data) == (7, 9)


def test_members_of_an_archive_that_share_their_bytes_are_refused(tmp_path: Path) -> None:
    """Every entry of the directory points to the first member: 40 times what the file has."""
    path = tmp_path / "a.tvs"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("000", bytes(10_000))
        for number in range(1, 40):
            packed.writestr(f"{number:03d}", b"")
        first = packed.infolist()[0]
        for about in packed.infolist()[1:]:
            about.header_offset = first.header_offset
            about.file_size, about.compress_size, about.CRC = first.file_size, first.compress_size, first.CRC
    with pytest.raises(InputError, match="the archive states more than the file has"):
        read_archive(path)
