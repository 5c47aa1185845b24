"""One picture from its bytes, and whether the decoder had to make up a part of it.

libjpeg, libpng and libtiff report damage to stderr alone, and fill up what is lost. So what they say is listened
to instead of shown. Descriptor 2 belongs to the whole program: one picture at a time is decoded.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

_STDERR = 2  # the descriptor of the standard error stream
_MOST_HEARD = 4096  # bytes: one line is enough
_HARMLESS = re.compile(r"libpng warning|TIFF_Warning|Unknown field|Corrupt JPEG data: \d extraneous bytes|^\s*$")
_NUMBERS = re.compile(r"[\d.:]+")  # of a line: times differ from one decoding to the next
_LOCK = Lock()


def decode(data: bytes) -> tuple[npt.NDArray[Any] | None, str]:
    """The picture (H, W) or (H, W, 3 or 4), grey levels in OpenCV's order, or None; and what is said of damage.

    Colour profiles, unknown fields and fewer than ten stray bytes, as many cameras leave, are no damage.
    """
    picture, said = _decode(data)
    if said:  # a decoder repeats itself; another thread's line of progress is heard once
        again = {_NUMBERS.sub("", line) for line in _decode(data)[1]}
        said = [line for line in said if _NUMBERS.sub("", line) in again]
    return None if picture is None else np.asarray(picture), said[0] if said else ""


def _decode(data: bytes) -> tuple[npt.NDArray[Any] | None, list[str]]:
    """The picture, and the lines that were heard meanwhile."""
    with _LOCK, _listening() as words:
        try:
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            picture = None
    lines = b"".join(words).decode(errors="replace").splitlines()
    return picture, [line for line in lines if not _HARMLESS.search(line)]


@contextmanager
def _listening() -> Iterator[list[bytes]]:
    """A list that holds, afterwards, what was written to stderr; it stays empty where there is no stderr."""
    words: list[bytes] = []
    try:
        before = os.dup(_STDERR)
    except OSError:
        yield words
        return
    with tempfile.TemporaryFile() as heard:
        os.dup2(heard.fileno(), _STDERR)
        try:
            yield words
        finally:
            os.dup2(before, _STDERR)
            os.close(before)
            heard.seek(0)
            words.append(heard.read(_MOST_HEARD))
