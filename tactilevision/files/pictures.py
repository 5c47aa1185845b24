"""Check a picture by its header, decode it, and detect damage that the decoder filled."""

from __future__ import annotations

import io
import logging
import os
import re
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.opening import check

# Headers: the size of a picture before it is unpacked, its colours and its orientation.
#
# PNG: IHDR (ISO 15948, 11.2.2), acTL and eXIf (11.3.8, 11.3.4.6 of its third edition). JPEG: SOF (ITU T.81,
# B.2.2), APP1 (Exif 2.3, 4.5.4). TIFF: tags 254, 256, 257, 262, 274 (TIFF 6.0, p. 36, 18, 37, 36), by tifffile,
# which takes the first of a repeated tag, as libtiff does. BMP: the information header.

_PNG, _JPEG, _BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"BM"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # also BigTIFF, either order of bytes
_FRAME_STARTS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers of JPEG that state a size
_GREY = frozenset((0, 4))  # colour types of PNG: grey, without and with transparency
_OS2_HEADER = 12  # bytes of BMP's oldest header, whose sides have 16 bits
_TURN = 274  # tag of TIFF: the orientation
_READ_SPACES = (0, 1, 2, 3, 5, 6)  # of tag 262: grey, RGB, palette, inks, YCbCr, which decoders convert to RGB
_PALETTE = 3  # colour type of PNG, and of tag 262
_MARK = 0xFF  # of JPEG: the first byte of a marker
_APP1 = 0xE1  # of JPEG: the marker of the segment that may hold Exif's tags
_UPRIGHT = 1  # of tag 274: not turned

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # it reports damage to stderr where nobody listens


class UnknownPictureError(InputError):
    """The bytes are not a picture of a supported format, or their header is damaged."""


def check_picture(data: bytes, *, where: object) -> None:
    """Raise InputError where a picture's header states more pixels than the limit.

    Raises UnknownPictureError without a header that states a size: decoders of other formats (GIF, WebP, JPEG
    2000) take gigabytes for a few bytes.
    """
    size = picture_size(data)
    if size is None:
        raise UnknownPictureError(
            "the picture is no PNG, JPEG, TIFF or BMP, or its header is damaged",
            where=where,
            value=bytes(data[:8]),
            remedy="Save it as PNG, or copy it again from its source.",
        )
    check(size[0] * size[1], "MAX_PIXELS", what=f"a picture of {size[0]} x {size[1]} pixels", where=where)


def is_grey(data: bytes) -> bool:
    """Return whether a PNG holds no colours; decoders make colours of grey with transparency."""
    return data.startswith(_PNG) and len(data) > 25 and data[25] in _GREY


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in px from the header; None if it is of another kind, or cut short."""
    try:
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
            return int(width), int(height)
        if data.startswith(_JPEG):
            return _jpeg(data)
        if data.startswith(_BMP):
            old = struct.unpack_from("<I", data, 14)[0] == _OS2_HEADER
            width, height = struct.unpack_from("<HH" if old else "<ii", data, 18)
            return abs(int(width)), abs(int(height))
        if data.startswith(_TIFF):
            page = _pages(data)[0]
            return (page.imagewidth, page.imagelength) if page.imagewidth and page.imagelength else None
    except Exception:  # of any kind, as tifffile raises for damage
        return None
    return None


def why_no_colours(data: bytes) -> str:
    """Return what keeps decoders from the colours that the sensor saw, "" for nothing.

    For bytes that `check_picture` has passed.
    """
    space = 2
    if data.startswith(_PNG) and len(data) > 25:
        space = data[25]
    elif data.startswith(_BMP) and len(data) > 30:
        old = int.from_bytes(data[14:18], "little") == _OS2_HEADER
        space = _PALETTE if data[24 if old else 28] <= 8 else space
    elif data.startswith(_TIFF):
        space = _pages(data)[0].photometric
        if space not in _READ_SPACES:
            return "its numbers are not red, green and blue (TIFF's tag 262)"
    return "it has a palette of few colours" if space == _PALETTE else ""


def upright(data: bytes) -> bytes:
    """Return the same bytes without a TIFF's orientation tag, which OpenCV follows in TIFF alone.

    For bytes that `check_picture` has passed.
    """
    if not data.startswith(_TIFF):
        return data
    lying, page = bytearray(data), _pages(data)[0]
    for tag in page.tags.getall(_TURN, []):
        with suppress(struct.error):  # beyond the end, or no number: libtiff does not follow it
            struct.pack_into(f"{page.parent.byteorder}{tag.dataformat[-1]}", lying, tag.valueoffset, _UPRIGHT)
    return bytes(lying)


def orientation(data: bytes) -> int:
    """Return the orientation that a file states (tag 274 of Exif and TIFF), 1 to 8; 1, unturned, without one."""
    try:
        return int(_pages(_exif(data))[0].tags.valueof(_TURN, _UPRIGHT))
    except Exception:  # as in `picture_size`
        return _UPRIGHT


def _exif(data: bytes) -> bytes:
    """Return a file's Exif, in the form of a TIFF; a TIFF itself as it is."""
    if data.startswith(_PNG):
        place = data.find(b"eXIf", 0, max(data.find(b"IDAT"), 0))
        return data[place + 4 :] if place > 0 else b""
    if not data.startswith(_JPEG):
        return data
    place = 2
    while data[place] == _MARK and data[place + 1] not in _FRAME_STARTS:
        length = int(struct.unpack_from(">H", data, place + 2)[0])
        if data[place + 1] == _APP1 and data[place + 4 : place + 10] == b"Exif\0\0":
            return data[place + 10 : place + 2 + length]
        place += 2 + length
    return b""


def is_stack(data: bytes) -> bool:
    """Return whether a PNG is a film, or a TIFF holds a second picture, which is neither a smaller copy nor a mask
    of the first (TIFF 6.0, p. 36: tag 254).
    """
    if data.startswith(_PNG):
        film = data.find(b"acTL", 0, max(data.find(b"IDAT"), 0))
        return film > 0 and int.from_bytes(data[film + 4 : film + 8], "big") > 1
    if not data.startswith(_TIFF):
        return False
    try:
        second = _pages(data)[1]
    except Exception:  # none, or damaged: its decoder reports it
        return False
    return not (second.is_reduced or second.is_mask)


def is_cut(data: bytes) -> bool:
    """Return whether a PNG or a JPEG lacks its end: decoders fill up what is lost, or reserve what a chunk
    states.
    """
    if data.startswith(_JPEG):  # the end marker follows the last start of a scan
        return data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
    place, kind = len(_PNG), b""
    while data.startswith(_PNG) and kind != b"IEND":
        kind = data[place + 4 : place + 8]
        place += 12 + int.from_bytes(data[place : place + 4], "big")
        if place > len(data):
            return True
    return False


def _jpeg(data: bytes) -> tuple[int, int] | None:
    place = 2
    while place + 9 < len(data):
        if data[place] != _MARK:  # stray bytes, which decoders skip
            place = data.index(_MARK, place)
            continue
        marker = data[place + 1]
        if marker in _FRAME_STARTS:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return int(width), int(height)
        alone = marker == 0xFF or marker == 0x01 or 0xD0 <= marker <= 0xD8
        place += (1 if marker == 0xFF else 2) if alone else 2 + struct.unpack_from(">H", data, place + 2)[0]
    return None


def _pages(data: bytes) -> Any:
    """Return the directories of a TIFF, or of Exif, which has its form; reading one raises errors of any kind."""
    import tifffile

    return tifffile.TiffFile(io.BytesIO(data)).pages


# Decoding. libjpeg, libpng and libtiff report damage to stderr alone, and fill up what is lost, so stderr is
# captured. Descriptor 2 belongs to the whole program: one picture is decoded at a time.

_STDERR = 2  # the descriptor of the standard error stream
_MAX_CAPTURED = 4096  # bytes: one line is enough
_HARMLESS = re.compile(r"libpng warning|TIFF_Warning|Unknown field|Corrupt JPEG data: \d extraneous bytes|^\s*$")
_NUMBERS = re.compile(r"[\d.:]+")  # of a line: times differ from one decoding to the next
_LOCK = Lock()


def decode(data: bytes) -> tuple[npt.NDArray[Any] | None, str]:
    """Decode the picture (H, W) or (H, W, 3 or 4), grey levels in OpenCV's order, or None.

    Return it and messages of damage. Colour profiles, unknown fields and fewer than ten stray bytes, as many
    cameras leave, are not damage.
    """
    picture, messages = _decode(data)
    if messages:  # a decoder repeats its messages; those of another thread occur once
        again = {_NUMBERS.sub("", line) for line in _decode(data)[1]}
        messages = [line for line in messages if _NUMBERS.sub("", line) in again]
    return None if picture is None else np.asarray(picture), messages[0] if messages else ""


def _decode(data: bytes) -> tuple[npt.NDArray[Any] | None, list[str]]:
    """Decode the picture; return it and the lines written to stderr meanwhile."""
    with _LOCK, _captured_stderr() as words:
        try:
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            picture = None
    lines = b"".join(words).decode(errors="replace").splitlines()
    return picture, [line for line in lines if not _HARMLESS.search(line)]


@contextmanager
def _captured_stderr() -> Iterator[list[bytes]]:
    """Collect what is written to stderr in a list; it stays empty if there is no stderr."""
    words: list[bytes] = []
    try:
        before = os.dup(_STDERR)
    except OSError:
        yield words
        return
    with tempfile.TemporaryFile() as captured:
        os.dup2(captured.fileno(), _STDERR)
        try:
            yield words
        finally:
            os.dup2(before, _STDERR)
            os.close(before)
            captured.seek(0)
            words.append(captured.read(_MAX_CAPTURED))
