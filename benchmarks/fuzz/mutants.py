"""Mutants of a valid file: some keep its form and change what it says, others change its bytes."""

from __future__ import annotations

import copy
import csv
import io
import json
import random
import struct
import zipfile
from typing import Any

import cv2
import numpy as np
import tomli_w
from hypothesis import strategies as st

from benchmarks.fuzz.readers import Form

Draw = st.DrawFn

_EDITS = st.sampled_from((1, 1, 1, 2, 4))  # most mutants have one fault: of several, the first alone is told
_RAW = "@raw:"  # a text that is written without its quotes: what no library would write
CELLS = (
    "nan", "inf", "-inf", "1e400", "-1e400", "1e300", "-1e13", "9" * 400, "", " ", "x", "0", "-1", "0x10", "1_000",
    "true", "../x.png", "/etc/passwd", "~/x", "a/../../x.png", "\0", "1,5", '"', "é", "\u0660", "a" * 200_000,
    "a" * 5000, "1e-320", "2026-13-40", "..", "C:\\x.png", "link.png", "0.5", "p1", "A",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    float("nan"), float("inf"), -float("inf"), 1e300, -1e13, 0, -1, 1, 0.5, 10**30, 10**309, True, None, "", "x",
    "nan", "../x.npz", "/etc/passwd", "a\0b", "x" * 100_000, [], {}, [1], [1.0, 2.0], [[1.0, 2.0], [2.0, 1.0]],
    [None], ["x"], {"value": None}, {"value": "x"}, {"value": float("nan")}, [[]], f"{_RAW}1e400",
    f"{_RAW}{'9' * 5000}", f"{_RAW}{'[' * 2000}{']' * 2000}", f"{_RAW}{'[' * 60}{']' * 60}",
    f"{_RAW}1979-05-27", f"{_RAW}0x7fffffffffffffffffff",
    1e-320, "{0}", "{x}", 2**63, "disc", "sphere", "custom", "stage",
)  # fmt: skip
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


def mutants(form: Form, data: bytes) -> st.SearchStrategy[bytes]:
    """Files of this form that say something else than `data`; a few are `data` with other bytes."""
    made = {
        "table": _tables,
        "toml": _documents,
        "json": _documents,
        "npy": _arrays,
        "npz": _archives,
        "tiff": _depths,
        "picture": _pictures,
        "bytes": _fields,
    }[form]
    return made(form, data) if form in ("toml", "json", "picture") else made(data)  # type: ignore[operator,no-any-return]


@st.composite
def _tables(draw: Draw, data: bytes) -> bytes:
    rows = [list(row) for row in csv.reader(io.StringIO(data.decode()))]
    for _ in range(draw(_EDITS)):
        kind = draw(
            st.sampled_from(("cell", "cell", "cell", "head", "drop", "double", "row", "less", "many", "wide"))
        )
        row = draw(st.integers(0, max(len(rows) - 1, 0)))
        width = max((len(one) for one in rows), default=0)
        column = draw(st.integers(0, max(width - 1, 0)))
        cell = draw(st.sampled_from(CELLS) | st.floats().map(str) | st.text(max_size=5))
        if not rows:
            break
        if kind == "cell" and column < len(rows[row]):
            rows[row][column] = cell
        elif kind == "head" and column < len(rows[0]):
            rows[0][column] = cell
        elif kind == "drop":
            rows = [one[:column] + one[column + 1 :] for one in rows]
        elif kind == "double":
            rows = [one[: column + 1] + one[column:] for one in rows]
        elif kind == "row":
            rows.insert(row, list(rows[draw(st.integers(0, len(rows) - 1))]))
        elif kind == "less":
            del rows[row]
        elif kind == "many" and sum(map(len, rows[row])) < 1000:
            rows += [list(rows[row]) for _ in range(draw(st.sampled_from((10, 3000))))]
        elif kind == "wide" and len(rows) < 100:
            rows = [one + ["1"] * 3000 for one in rows]
    text = io.StringIO()
    csv.writer(
        text, lineterminator="\n", quoting=draw(st.sampled_from((csv.QUOTE_MINIMAL, csv.QUOTE_ALL)))
    ).writerows(rows)
    said = text.getvalue()
    if draw(st.integers(0, 9)) == 0:
        return said.encode(draw(st.sampled_from(("utf-16", "utf-8-sig", "latin-1"))), errors="replace")
    if draw(st.integers(0, 9)) == 0:
        said = said.replace(",", draw(st.sampled_from((";", "\t", ",,", '"'))))
    return said.encode(errors="replace")


@st.composite
def _documents(draw: Draw, form: Form, data: bytes) -> bytes:
    tree = _parsed(form, data)
    for _ in range(draw(_EDITS)):
        tree = _edited(draw, tree)
    said = _written(form, tree)
    if form == "toml" and draw(st.integers(0, 9)) == 0:
        said += draw(
            st.sampled_from(("a" + ".b" * 20_000 + " = 1\n", "[[indenter]]\n", "x = 1\nx = 2\n", "[a.b.c]\n" * 3))
        )
    if form == "json" and draw(st.integers(0, 19)) == 0:
        said = draw(st.sampled_from((f"[{said}]", '{"a":' * 5000, "3", "null", said + said, "")))
    return said.encode(errors="replace")


def _parsed(form: Form, data: bytes) -> Any:
    if form == "json":
        return json.loads(data)
    import tomllib

    return tomllib.loads(data.decode())


def _written(form: Form, tree: Any) -> str:
    if form == "json":
        said = json.dumps(tree)
    else:
        try:
            said = tomli_w.dumps(_without_none(tree))
        except (TypeError, AttributeError, ValueError):
            said = "x = 1"
    parts = said.split(f'"{_RAW}')
    return parts[0] + "".join(part.replace('"', "", 1) for part in parts[1:])


def _without_none(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _without_none(value) for key, value in tree.items() if value is not None}
    return [_without_none(value) for value in tree if value is not None] if isinstance(tree, list) else tree


def _edited(draw: Draw, tree: Any) -> Any:
    tree = copy.deepcopy(tree)
    places = list(_places(tree))
    if not places:
        return tree
    holder, key = draw(st.sampled_from(range(len(places))).map(places.__getitem__))
    kind = draw(st.sampled_from(("put", "put", "put", "drop", "rename", "add", "swap")))
    value = draw(st.sampled_from(VALUES) | st.floats() | st.integers() | st.text(max_size=5))
    if kind == "drop":
        del holder[key]
    elif kind == "rename" and isinstance(holder, dict):
        holder[draw(st.sampled_from(("x", "", "name", "a.b", "é", "value", "y" * 10_000)))] = holder.pop(key)
    elif kind == "add" and isinstance(holder, dict):
        holder[draw(st.sampled_from(("x", "name", "value", "std", "unit", "radius_mm", "size_mm")))] = value
    elif kind == "swap":
        other, name = places[draw(st.integers(0, len(places) - 1))]
        holder[key] = copy.deepcopy(other[name])
    else:
        holder[key] = copy.deepcopy(value)
    return tree


def _places(tree: Any) -> Any:
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in list(pairs):
        yield tree, key
        yield from _places(value)


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
def _arrays(draw: Draw, data: bytes) -> bytes:
    array = np.load(io.BytesIO(data))
    return _npy(draw, _damaged(draw, array) if draw(st.booleans()) else _array(draw))


@st.composite
def _archives(draw: Draw, data: bytes) -> bytes:
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
    import warnings

    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", way) as packed:
        warnings.simplefilter("ignore")
        for called, content in members:
            packed.writestr(called, content)
    return file.getvalue()


@st.composite
def _pictures(draw: Draw, form: Form, data: bytes) -> bytes:
    if draw(st.booleans()):
        return draw(_fields(data))
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
def _depths(draw: Draw, data: bytes) -> bytes:
    import tifffile

    about = json.dumps(
        {"quantity": "depth", "unit": "mm", "mm_per_px": [0.06, 0.06], "positions": "deformed", "flags": []}
    )
    if draw(st.integers(0, 3)) == 0:
        return draw(_fields(data))
    array = _array(draw)
    if draw(st.booleans()):
        array = _damaged(draw, tifffile.imread(io.BytesIO(data)))
    file = io.BytesIO()
    try:
        said = draw(_documents("json", about.encode())).decode(errors="replace")
        tifffile.imwrite(file, array, description=said.encode("ascii", "replace").decode(), metadata=None)
    except Exception:  # what tifffile cannot write is no mutant
        return data
    return file.getvalue()


@st.composite
def _fields(draw: Draw, data: bytes) -> bytes:
    """Numbers of the header overwritten with extreme ones; the end cut off, bytes left out or doubled."""
    found = bytearray(data)
    for _ in range(draw(_EDITS)):
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
