"""Mutants of tables and documents: they keep the form and change what it says."""

from __future__ import annotations

import copy
import csv
import io
import json
import tomllib
from typing import Any, Literal

import tomli_w
from hypothesis import strategies as st

from benchmarks.fuzz.readers import Form

Draw = st.DrawFn

EDITS = st.sampled_from((1, 1, 1, 2, 4))  # most mutants have one fault: of several, the first alone is told
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


@st.composite
def tables(draw: Draw, data: bytes) -> bytes:
    """The table with other cells, columns or rows; one in ten in another encoding or with another separator."""
    rows = [list(row) for row in csv.reader(io.StringIO(data.decode()))]
    for _ in range(draw(EDITS)):
        if rows:
            rows = _other_table(draw, rows)
    text = io.StringIO()
    quoted: Literal[0, 1] = csv.QUOTE_ALL if draw(st.booleans()) else csv.QUOTE_MINIMAL
    csv.writer(text, lineterminator="\n", quoting=quoted).writerows(rows)
    said = text.getvalue()
    if draw(st.integers(0, 9)) == 0:
        return said.encode(draw(st.sampled_from(("utf-16", "utf-8-sig", "latin-1"))), errors="replace")
    if draw(st.integers(0, 9)) == 0:
        said = said.replace(",", draw(st.sampled_from((";", "\t", ",,", '"'))))
    return said.encode(errors="replace")


def _other_table(draw: Draw, rows: list[list[str]]) -> list[list[str]]:
    kind = draw(st.sampled_from(("cell", "cell", "cell", "head", "drop", "double", "row", "less", "many", "wide")))
    row = draw(st.integers(0, len(rows) - 1))
    column = draw(st.integers(0, max(max(map(len, rows)) - 1, 0)))
    cell = draw(st.sampled_from(CELLS) | st.floats().map(str) | st.text(max_size=5))
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
    return rows


@st.composite
def documents(draw: Draw, form: Form, data: bytes) -> bytes:
    """The TOML or JSON file with values put, dropped, renamed, added or swapped anywhere in its tree."""
    tree = _parsed(form, data)
    for _ in range(draw(EDITS)):
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
    return json.loads(data) if form == "json" else tomllib.loads(data.decode())


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
