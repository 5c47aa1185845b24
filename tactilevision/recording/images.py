"""Decode picture files and video frames to RGB with 8 bits a channel."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.arrays import read_array
from tactilevision.files.child import Answer, Answers, asked
from tactilevision.files.opening import check, read_bytes
from tactilevision.files.pictures import check_picture, decode, is_cut, is_grey, is_stack, upright, why_no_colours
from tactilevision.records.measured import Bytes

EVEN_GREY = 8  # grey levels: the range of an even picture, black or white, which is not a grey copy
_SPARSE = 8  # px: every eighth pixel shows most pictures to be coloured
_REMEDY_TORN = "Copy it again from its source, or remove it from the list."


class TornImageError(RecordingError):
    """The file is missing, damaged, cut short or not a single frame; other pictures may be sound."""


def read_image(path: Path | str, *, white_level: float | None = None) -> Bytes:
    """Read a picture as (height, width, 3) uint8 in the order red, green, blue.

    8-bit pictures are unchanged; 16-bit integers are scaled so that `white_level` (None: 65535) becomes 255;
    floating point pictures run from 0 to 1. Transparency and orientation tags are ignored. Grey pictures, also as
    three equal colours, and palettes are refused, since slopes are read from small changes of colour. A .npy file
    holds (height, width, 3 or 4) in the order red, green, blue.

    Raises TornImageError for a file that is missing, cut short or damaged, RecordingError for one that is grey or
    of an unsupported kind.
    """
    path = Path(path)
    return as_rgb(read_stored(path), path, white_level=white_level)


def read_stored(path: Path) -> npt.NDArray[Any]:
    """Read the picture as the file has it, grey levels of any shape and type, red first.

    Raises as `read_image` does.
    """
    with _torn(path):
        return _stored(read_bytes(path), path)


def decode_image(data: bytes, path: Path) -> Bytes:
    """Decode the bytes of a file as `read_image` does; `path` names them in errors."""
    with _torn(path):
        return as_rgb(_stored(data, path), path)


@contextmanager
def _torn(path: Path) -> Iterator[None]:
    """Raise TornImageError for a file that is missing, of another kind, beyond a limit or damaged."""
    try:
        yield
    except FileNotFoundError as fault:
        raise TornImageError("the file is missing", where=path, remedy=_REMEDY_TORN) from fault
    except OSError as fault:
        raise RecordingError(f"cannot be read: {fault.strerror}", where=path) from fault
    except RecordingError:
        raise
    except InputError as fault:
        remedy = fault.remedy or _REMEDY_TORN
        raise TornImageError(fault.what, where=path, value=fault.value, remedy=remedy) from fault


def _stored(data: bytes, path: Path) -> npt.NDArray[Any]:
    if not data:
        raise InputError("the picture is empty", where=path)
    if path.suffix.lower() == ".npy":
        return _array(data, path)
    check_picture(data, where=path)
    if is_stack(data):
        remedy = "Save each as its own file, or all as a video."
        raise InputError("the file holds several pictures instead of one", where=path, remedy=remedy)
    picture = _decoded(upright(data), path)
    if is_grey(data):
        return picture[..., 0] if picture.ndim == 3 else picture
    if picture.ndim == 3 and (why := why_no_colours(data)):
        raise RecordingError(
            f"the picture's colours are not those of the sensor: {why}",
            where=path,
            remedy="Record again with 8 bits or more of red, green and blue.",
        )
    if picture.ndim == 3 and picture.shape[2] in (3, 4):
        picture = np.asarray(cv2.merge(cv2.split(picture)[2::-1]))
    return picture


def as_rgb(picture: npt.NDArray[Any], path: Path, *, white_level: float | None = None) -> Bytes:
    """Bring an array (H, W, 3) in the order red, green, blue to grey levels of 8 bits.

    `path` is for the messages.
    """
    if picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] in (1, 2)):
        raise _grey(path, picture.shape)
    if picture.ndim != 3 or picture.shape[2] not in (3, 4):
        turned = picture.ndim == 3 and picture.shape[0] in (3, 4)
        raise RecordingError(
            "a picture has the shape (height, width, 3)",
            where=path,
            value=picture.shape,
            remedy="Put the colours last: numpy.moveaxis(picture, 0, -1)." if turned else "",
        )
    picture = picture[..., :3].astype(picture.dtype.newbyteorder("="), copy=False)
    return check_coloured(_levels(picture, path, white_level), path)


def _levels(picture: npt.NDArray[Any], path: Path, white_level: float | None) -> Bytes:
    """Convert to grey levels (H, W, 3) of 8 bits. Raises RecordingError for a type that holds none."""
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    if picture.dtype == np.uint16:
        return _scaled(picture, white_level or 65535)
    if picture.dtype.kind == "f":
        if not (np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1):
            raise RecordingError(
                "a picture of floating point numbers runs from 0 to 1",
                where=path,
                value=(float(picture.min()), float(picture.max())),
                remedy="Divide it by its white, or store 8 or 16 bit integers.",
            )
        return _scaled(picture, 1.0)
    raise RecordingError(
        "pictures hold 8 or 16 bit unsigned integers, or floating point numbers from 0 to 1",
        where=path,
        value=str(picture.dtype),
        remedy="Convert it.",
    )


def check_coloured(rgb: Bytes, where: Path | str) -> Bytes:
    """Return the picture (H, W, 3); raise RecordingError for a grey one whose three colours are equal."""
    for few in (rgb[::_SPARSE, ::_SPARSE], rgb):
        if not ((few[..., 0] == few[..., 1]) & (few[..., 1] == few[..., 2])).all():
            return rgb
    if int(rgb[..., 0].max()) - int(rgb[..., 0].min()) > EVEN_GREY:
        raise _grey(where, "three equal colours")
    return rgb


def _grey(where: Path | str, found: object) -> RecordingError:
    return RecordingError(
        "the picture is grey, but photometric stereo needs the colours of the lights",
        where=where,
        value=found,
        remedy="Record in colour.",
    )


def _scaled(picture: npt.NDArray[Any], white: float) -> Bytes:
    scaled = np.rint(picture.astype(np.float32) * np.float32(255 / white))
    bounded: Bytes = np.minimum(scaled, 255).astype(np.uint8)
    return bounded


def _array(data: bytes, path: Path) -> npt.NDArray[Any]:
    array = read_array(data, where=path)
    check(array.size / 3, "MAX_PIXELS", what="the array's pixels", where=path)
    if not array.size:
        raise InputError("the picture is empty", where=path, value=array.shape)
    return array


def _decoded(data: bytes, path: Path) -> npt.NDArray[Any]:
    """Decode the picture in OpenCV's order of colours."""
    if is_cut(data):
        raise InputError("the picture is cut short", where=path)
    picture, damage = decode(data)
    if picture is None:
        raise InputError("the picture cannot be decoded", where=path)
    if damage:
        raise InputError("the picture is damaged", where=path, value=damage)
    return picture


# Frames of one video file by their index. Seeking is inexact at a varying frame rate, so frames are counted from
# the start of the file, in a child process, which is kept: successive windows cost one pass.

_CONTAINER = re.compile(
    rb"....(ftyp|moov|mdat|free|skip|wide)|RIFF....AVI |\x1aE\xdf\xa3", re.S
)  # MP4, AVI, Matroska
_END = 1 << 62  # index beyond the last frame of any video
_AHEAD = 4  # frames asked for at a time
_REPORTED = 32  # frames that are passed in one answer
_Key = tuple[Path, int, int, int]
_kept: dict[_Key, Answers] = {}  # one at most
_lock = Lock()


def iter_video(path: Path, indices: Sequence[int]) -> Iterator[tuple[int, Bytes | None]]:
    """Yield (index, rgb) for rising `indices`; rgb is None if the video ends before, or cannot be decoded."""
    with _film(path) as film:
        for number, index in enumerate(indices):
            _, _, picture = film.ask(*indices[number : number + _AHEAD])
            yield index, None if picture is None else rgb_of(picture, path)


def count_frames(path: Path) -> int:
    """Count the frames by reading all of them: the number in the container is an estimate."""
    with _film(path) as film:
        return int(film.ask(_END)[1])


def stated_frames(path: Path) -> int:
    """Return the number of frames that the container states: often exact, at times an estimate, 0 if unknown."""
    with _film(path) as film:
        return int(film.ask(-1)[0])


@contextmanager
def _film(path: Path) -> Iterator[Answers]:
    """Open a video; one that failed fails again."""
    about = path.stat()
    key = path, about.st_mtime_ns, about.st_size, os.getpid()  # a file that was rewritten is another video
    with _lock:
        film = _kept.pop(key, None)
    film = film or Answers(film_frames, str(path), files=[path])
    try:
        yield film
    finally:
        with _lock:
            _kept.clear()
            _kept[key] = film


def film_frames(path: str) -> Iterator[Answer]:
    """Yield, in a child process, for each index asked for: frames stated, frames counted so far, BGR picture."""
    capture, count, going = _open(path), 0, True
    for index in asked():
        if 0 <= index < count - 1:  # before the last one read
            capture, count, going = _open(path), 0, True
        while going and count <= index:
            going = capture.grab()
            count += going
            if count % _REPORTED == 0:
                yield ()
        picture = capture.retrieve()[1] if index == count - 1 else None
        yield max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0), count, picture


def _open(path: str) -> cv2.VideoCapture:
    with open(path, "rb") as file:
        known = _CONTAINER.match(file.read(12))
    capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG) if known else None
    if capture is None or not capture.isOpened():
        raise RecordingError(
            "the video cannot be opened",
            where=path,
            remedy="FFV1 in .mkv or .avi is lossless and read everywhere.",
        )
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # do not follow the orientation tag
    return capture


def rgb_of(bgr: npt.NDArray[Any], where: Path | str, *, source: str = "the video", remedy: str = "") -> Bytes:
    """Return a picture (H, W, 3), grey levels, blue first, as red first. Raises RecordingError for other kinds."""
    if bgr.ndim != 3 or bgr.shape[2] != 3 or bgr.dtype != np.uint8:
        found = f"{bgr.shape} {bgr.dtype}"
        raise RecordingError(f"{source} gives no colours of 8 bits", where=where, value=found, remedy=remedy)
    return check_coloured(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8), where)
