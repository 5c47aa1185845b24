"""Text that is four times as long takes about four times as long to read, also where it is made to be slow."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
from each import each

from tactilevision.errors import InputError
from tactilevision.files.documents import parse_json, parse_toml
from tactilevision.files.pictures import orientation, picture_size
from tactilevision.press.certified_faces import read_certified
from tactilevision.recording.layout import POINT_COLUMNS
from tactilevision.recording.read_tables import read_curves, read_frame_table, read_points, read_presses
from tactilevision.recording.tables import read_table
from tactilevision.records.rig import Indenter

SMALL = 4000  # parts of the shorter text
MOST = 9.0  # times longer: 16 where each part looks at all others, 4 where none does
LEAST_S = 0.02  # of processor time, below which nothing is compared

TOML: dict[str, Callable[[int], str]] = {
    "escaped quotes": lambda n: 'a = "' + '\\"' * n + '"',
    "open text": lambda n: 'a = "' + '\\"' * n,
    "open text of lines": lambda n: 'a = """' + 'x"' * n,
    "many open texts": lambda n: "\n".join(['a = "\\"'] * n),
    "three quotes": lambda n: '"""\\"' * n,
    "three single quotes": lambda n: "'''x'" * n,
    "quotes": lambda n: '"' * n,
    "comments": lambda n: "#'\"" * n,
    "keys": lambda n: "".join(f"k{k} = 1\n" for k in range(n)),
    "tables": lambda n: "".join(f"[t{k}]\n" for k in range(n)),
    "lists of tables": lambda n: "[[t]]\n[t.u]\nx = 1\n" * n,
    "dotted keys": lambda n: "".join(f"a.b{k} = 1\n" for k in range(n)),
    "inline tables": lambda n: "a = {" + ",".join(f"k{k} = 1" for k in range(n)) + "}",
    "numbers": lambda n: "a = [" + "1.5," * n + "]",
    "lines": lambda n: "\n" * n + "a",
    "parts of a key": lambda n: "a." * n + "a = 1",
}
JSON: dict[str, Callable[[int], str]] = {
    "one key": lambda n: "{" + ",".join(['"k": 1'] * n) + "}",
    "keys": lambda n: "{" + ",".join(f'"k{k}": 1' for k in range(n)) + "}",
    "the last key again": lambda n: "{" + "".join(f'"k{k}": 1,' for k in range(n)) + f'"k{n - 1}": 1}}',
    "tables": lambda n: '{"a": [' + ",".join(['{"k": 1}'] * n) + "]}",
    "one key in tables": lambda n: '{"a": [' + ",".join(['{"k": 1, "k": 2}'] * n) + "]}",
    "open text": lambda n: '{"a": "' + '\\"' * n,
    "brackets": lambda n: "[" * n,
    "digits": lambda n: '{"a": 1.' + "1" * n + "}",
}
INDENTERS = {"A": Indenter("A", "flat_cylinder", radius_mm=2.0)}
TABLES: dict[str, tuple[Callable[[Path], object], str, Callable[[int], str]]] = {
    "presses": (
        lambda path: read_presses(path, INDENTERS),
        "press,indenter,start_s,end_s,note",
        lambda k: f"p{k},A,{k},{k}.5,x",
    ),
    "one press": (
        lambda path: read_presses(path, INDENTERS),
        "press,indenter,start_s,end_s",
        lambda k: f"p{k},A,0,1",
    ),
    "points": (
        lambda path: read_points(path, INDENTERS),
        "press,indenter,depth_mm,fz_N",
        lambda k: f"p{k},A,.1,1",
    ),
    "certified": (
        lambda path: read_certified(path.with_name("calibration.json")),
        "press,indenter,depth_mm,fz_N,time_s,accepted",
        lambda k: f"p{k},A,.1,1,{k},true",
    ),
    "curves": (read_curves, "press,time_s,depth_mm,fx_N,fy_N,fz_N,phase", lambda k: f"p{k},{k},.1,0,0,1,load"),
    "frames": (read_frame_table, "frame,time_s", lambda k: f"{k}.png,{k}"),
    "quotes": (read_frame_table, "frame,time_s", lambda k: f'"{k}""x""",{k}'),
}


def seconds(act: Callable[[], object]) -> float:
    """Processor time of the faster of two calls."""
    found = []
    for _ in range(2):
        began = time.process_time()
        with suppress(InputError):
            act()
        found.append(time.process_time() - began)
    return min(found)


def check_linear(read: Callable[[str], object], make: Callable[[int], str]) -> None:
    short, long = (seconds(partial(read, make(count))) for count in (SMALL, 4 * SMALL))
    assert long < MOST * max(short, LEAST_S / 4)


@each("name", list(TOML))
def test_toml_is_read_in_linear_time(name: str) -> None:
    check_linear(lambda text: parse_toml(text, where="a.toml"), TOML[name])


@each("name", list(JSON))
def test_json_is_read_in_linear_time(name: str) -> None:
    check_linear(lambda text: parse_json(text, where="a.json"), JSON[name])


@each("name", list(TABLES))
def test_tables_are_read_in_linear_time(name: str, tmp_path: Path) -> None:
    read, header, row = TABLES[name]
    path = tmp_path / "points.csv"

    def reread(text: str) -> object:
        path.write_text(text)
        return read(path)

    check_linear(reread, lambda count: "\n".join([header, *map(row, range(count // 4))]))


@each("made", [b"\xff\xd8" + b"x" * 10, b"\xff\xd8" + b"\xff" * 10, b"\xff\xd8\xff\xe1\0\2", b"\x89PNG\r\n\x1a\n"])
def test_headers_of_pictures_are_read_in_linear_time(made: bytes) -> None:
    def read(text: str) -> object:
        data = text.encode("latin-1")
        return picture_size(data), orientation(data)

    check_linear(read, lambda count: made[:2].decode("latin-1") + made[2:].decode("latin-1") * count)


def test_one_long_cell_does_not_widen_the_others(tmp_path: Path) -> None:
    path, count = tmp_path / "points.csv", 1000
    rows = [f"p{k},A,.1,1,{'x' * 100_000 if k == 0 else 'x'}" for k in range(count)]
    path.write_text("\n".join(["press,indenter,depth_mm,fz_N,note", *rows]))
    notes = read_table(path, POINT_COLUMNS).extra["note"]
    assert notes.nbytes < 100 * count
    points, _ = read_points(path, INDENTERS)
    assert [len(dict(point.extra)["note"]) for point in points] == [100_000, *np.ones(count - 1, int)]
