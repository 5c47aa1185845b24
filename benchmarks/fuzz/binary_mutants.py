"""Mutants of arrays, archives, pictures and height maps, and of the bytes of any file."""

from __future__ import annotations

import io
import json
import random
import struct
import warnings
import zipfile
from typing import Any

import cv2
import numpy as np
import tifffile
from hypothesis import strategies as st

from benchmarks.fuzz.readers import Form
from benchmarks.fuzz.text_mutants import EDITS, Draw, documents

EXTREMES = (
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    2**63 - 1,
    2**64 - 1,
    30_000,
)
SHAPES: tuple[tuple[int, ...], ...] = (
    (),
    (0,),
    (1,),
    (3,),
    (4,),
    (2, 0),
    (0, 3),
    (1, 1),
    (10, 12),
    (12, 10),
    (3, 1, 1),
    (10, 12, 3),
    (10, 12, 1),
    (10, 12, 4),
    (2, 19, 21),
    (3, 10, 12),
    (1, 1, 1, 1),
    (1, 5000),
    (2,) * 33,
)
KINDS = ("u1", "u2", "i8", "f2", "f4", "f8", "c16", "?", "U3", "S2", "M8[s]", "m8[D]", ">f8", "O", "V4")
FILLS = (0.0, 1.0, -1.0, 255.0, 1e30, float("nan"), float("inf"))
HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (9223372036854775807, 3), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': [('a', '<f8')], 'fortran_order': 1, 'shape': (2,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1," * 100 + "), }",
    "(" * 300,
    "{'descr': '<f8'}",
    "__import__('os').system('x')",
)


def _array(draw: Draw) -> np.ndarray[Any, Any]:
    shape, kind = draw(st.sampled_from(SHAPES)), draw(st.sampled_from(KINDS))
    fill = draw(st.sampled_from(FILLS))
    with np.errstate(all="ignore"):
        array = np.full(shape if len(shape) < 33 else (1,) * 32, fill)
        try:
            return array.astype(kind)
        except (TypeError, ValueError):
            return np.zeros(array.shape, kind)


def _damaged(draw: Draw, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The array with one number of another kind in it, or of another type or order."""
    kind = draw(st.sampled_from(("one", "type", "turn", "cut")))
    if kind == "one" and array.size and array.dtype.kind == "f":
        array = array.copy()
        array.flat[draw(st.integers(0, array.size - 1))] = draw(
            st.sampled_from((np.nan, np.inf, -np.inf, 1e30, -1e13))
        )
        return array
    if kind == "type" and array.dtype.kind in "fiub":
        with np.errstate(all="ignore"):
            return array.astype(draw(st.sampled_from(("f2", "f4", "f8", ">f8", "i8", "c16", "U9"))))
    return array.T if kind == "turn" else array[: draw(st.integers(0, 3))] if array.ndim else array


def _npy(draw: Draw, array: np.ndarray[Any, Any]) -> bytes:
    if draw(st.integers(0, 9)) == 0:
        header = draw(st.sampled_from(HEADERS)).encode() + b"\n"
        return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + b"\0" * 64
    file = io.BytesIO()
    np.lib.format.write_array(file, array, allow_pickle=True)
    return file.getvalue()


@st.composite
def arrays(draw: Draw, data: bytes) -> bytes:
    array = np.load(io.BytesIO(data))
    return _npy(draw, _damaged(draw, array) if draw(st.booleans()) else _array(draw))


@st.composite
def archives(draw: Draw, data: bytes) -> bytes:
    with np.load(io.BytesIO(data)) as found:
        arrays = dict(found)
    members: list[tuple[str, bytes]] = []
    chosen = draw(st.sets(st.sampled_from(sorted(arrays)), min_size=1, max_size=2))
    for name, array in arrays.items():
        if name not in chosen:
            file = io.BytesIO()
            np.lib.format.write_array(file, array)
            members.append((f"{name}.npy", file.getvalue()))
            continue
        kind = draw(
            st.sampled_from(("other", "other", "damaged", "damaged", "gone", "renamed", "doubled", "rubbish"))
        )
        if kind == "gone":
            continue
        content = _npy(draw, _array(draw) if kind == "other" else _damaged(draw, array))
        if kind == "rubbish":
            content = draw(st.binary(max_size=100))
        called = draw(st.sampled_from(("../x", "/etc/x", "", "é"))) if kind == "renamed" else name
        members += [(f"{called}.npy", content)] * (2 if kind == "doubled" else 1)
    file, way = io.BytesIO(), draw(st.sampled_from((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)))
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", way) as packed:
        warnings.simplefilter("ignore")
        for called, content in members:
            packed.writestr(called, content)
    return file.getvalue()


@st.composite
def pictures(draw: Draw, form: Form, data: bytes) -> bytes:
    if draw(st.booleans()):
        return draw(fields(data))
    suffix = next(
        (s for m, s in ((b"\x89PNG", ".png"), (b"\xff\xd8", ".jpg"), (b"BM", ".bmp")) if data.startswith(m)),
        ".tiff",
    )
    shape = (
        draw(st.integers(1, 40)),
        draw(st.sampled_from((1, 2, 12, 40, 5000))),
        draw(st.sampled_from((1, 3, 4))),
    )
    kind = draw(st.sampled_from(("u1", "u2", "f4", "f8")))
    array = np.full(shape, draw(st.sampled_from((0, 1, 255))), kind)
    if kind.startswith("f"):
        array.flat[0] = draw(st.sampled_from(FILLS))
    try:
        done, made = cv2.imencode(suffix, array)
    except cv2.error:
        return data
    return bytes(made.tobytes()) if done else data


@st.composite
def depths(draw: Draw, data: bytes) -> bytes:
    about = json.dumps(
        {"quantity": "depth", "unit": "mm", "mm_per_px": [0.06, 0.06], "positions": "deformed", "flags": []}
    )
    if draw(st.integers(0, 3)) == 0:
        return draw(fields(data))
    array = _array(draw)
    if draw(st.booleans()):
        array = _damaged(draw, tifffile.imread(io.BytesIO(data)))
    file = io.BytesIO()
    try:
        said = draw(documents("json", about.encode())).decode(errors="replace")
        tifffile.imwrite(file, array, description=said.encode("ascii", "replace").decode(), metadata=None)
    except Exception:  # what tifffile cannot write is no mutant
        return data
    return file.getvalue()


@st.composite
def fields(draw: Draw, data: bytes) -> bytes:
    """Numbers of the header overwritten with extreme ones; the end cut off, bytes left out or doubled."""
    found = bytearray(data)
    for _ in range(draw(EDITS)):
        size = draw(st.sampled_from((1, 2, 4, 8)))
        last = max(len(found) - size, 0)
        place = draw(st.integers(0, min(last, 100)) | st.integers(0, last))
        value = draw(st.sampled_from(EXTREMES) | st.integers(0, 2 ** (8 * size) - 1)) % 2 ** (8 * size)
        found[place : place + size] = value.to_bytes(size, draw(st.sampled_from(("little", "big"))))
    kind = draw(st.sampled_from(("as it is", "as it is", "cut", "hole", "twice")))
    if kind == "cut":
        del found[draw(st.integers(0, len(found))) :]
    elif kind != "as it is":
        start = draw(st.integers(0, len(found)))
        end = min(start + draw(st.integers(1, 64)), len(found))
        found[start:end] = found[start:end] * 2 if kind == "twice" else b""
    return bytes(found)


def mutated_bytes(data: bytes, rng: random.Random) -> bytes:
    """The file with one to six changes of its bytes, drawn blindly."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        place, kind = rng.randint(0, len(found)), rng.randrange(5)
        size = rng.choice((1, 2, 4, 8))
        if kind == 0 and place < len(found):
            found[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            value = rng.choice(EXTREMES) % 2 ** (8 * size)
            found[place : place + size] = value.to_bytes(size, rng.choice(("little", "big")))
        elif kind == 2:
            del found[place : place + rng.choice((1, 4, 50))]
        elif kind == 3:
            found[place:place] = found[place : place + rng.choice((4, 50, 500))]
        else:
            found[place:place] = rng.randbytes(size)
    return bytes(found)
