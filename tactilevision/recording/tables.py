"""CSV tables with a header: columns in any order, unknown ones kept, errors with their line."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import RecordingError
from tactilevision.files.documents import cell_text
from tactilevision.files.opening import check, check_numbers, is_plain, open_regular
from tactilevision.recording.layout import Columns, nearest
from tactilevision.recording.units import BRACKETS, fault_of_unit, same_quantity, scaled, with_own_unit
from tactilevision.records.measured import Floats
from tactilevision.records.ranges import impossible, outside

_Factors = Mapping[str, tuple[str, Fraction]]  # by name in the format: the file's own name, and the factor
_ROWS_AT_ONCE = 4096  # rows read at once
_MARKED = re.compile(r"[+-]?[0-9]*(?:[,._'’\s][0-9]+)+")  # a number with a decimal comma, or marked thousands


@dataclass(frozen=True, slots=True)
class Table:
    """A table: `numbers` and `words` by column, all of length `len(lines)`; `extra`: unknown columns.

    `lines` (N,) are line numbers of the file, for messages.
    """

    path: Path
    lines: npt.NDArray[np.int64]
    numbers: dict[str, Floats] = field(default_factory=dict)
    words: dict[str, list[str]] = field(default_factory=dict)
    extra: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def fault(self, row: int, what: str, *, value: object = None, remedy: str = "") -> RecordingError:
        """Return the error for one row."""
        return RecordingError(what, where=f"{self.path}, line {self.lines[row]}", value=value, remedy=remedy)

    def optional(self, name: str) -> Floats:
        """Return a column (N,) of numbers, all NaN if the table has none."""
        return self.numbers.get(name, np.full(len(self.lines), np.nan))


def read_table(path: Path, columns: Columns, *, least_rows: int = 1) -> Table:
    """Read one CSV file (UTF-8, a byte order mark is allowed; comma; decimal point).

    An empty number, or nan, in an optional column becomes NaN; in a required one it is an error. Raises
    RecordingError, with file and line, for what is not such a table.
    """
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as stream:
            rows = csv.reader(stream, strict=True)
            try:
                return _read(path, rows, columns, least_rows)
            except csv.Error as fault:
                raise RecordingError(
                    f"is not CSV: {fault}",
                    where=f"{path}, line {rows.line_num}",
                    remedy="A quotation mark must be closed.",
                ) from fault
    except UnicodeDecodeError as fault:
        line = 1 + path.read_bytes().decode(errors="replace").partition("\ufffd")[0].count("\n")
        raise RecordingError(
            "is not UTF-8 text", where=f"{path}, line {line}", remedy="Save it as CSV UTF-8."
        ) from fault
    except FileNotFoundError as fault:
        remedy = f"Add the table: columns {', '.join(columns.required)}."
        raise RecordingError("the table is missing", where=path, remedy=remedy) from fault
    except OSError as fault:
        raise RecordingError(f"cannot be read: {fault.strerror}", where=path) from fault


def _read(path: Path, rows: Any, columns: Columns, least_rows: int) -> Table:
    header, factors = _header(path, next(rows, None), columns)
    lines = array("q")
    numeric = columns.numbers + columns.gap_numbers + columns.maybe_numbers
    numbers = {name: array("d") for name in header if name in numeric}
    texts: dict[str, list[str]] = {name: [] for name in header if name not in numeric}
    for chunk_lines, chunk in _chunks(path, rows, len(header)):
        lines.extend(chunk_lines)
        for name, cells in zip(header, zip(*chunk, strict=True), strict=True):
            if name in numbers:
                empty_allowed = name not in columns.numbers
                numbers[name].extend(_numbers(path, name, cells, chunk_lines, empty_allowed))
            else:
                texts[name].extend(cell_text(cell.strip()).strip() for cell in cells)
    if not lines:
        raise RecordingError("has no rows under its header", where=path)
    if len(lines) < least_rows:
        raise RecordingError(f"has {len(lines)} row, at least {least_rows} are needed", where=path)
    converted = ((name, values, factors.get(name, ("", Fraction(1)))) for name, values in numbers.items())
    table = Table(
        path,
        np.array(lines, dtype=np.int64),
        numbers={name: scaled(np.array(values), factor) for name, values, (_, factor) in converted},
        words={name: texts[name] for name in header if name in columns.words + columns.maybe_words},
        extra={name: _guess(texts[name]) for name in header if name not in columns.known},
        warnings=(*_converted(path, factors), *_misspelt(path, header, columns)),
    )
    _check_cells(table, columns)
    return table


def _check_cells(table: Table, columns: Columns) -> None:
    """Raise RecordingError for missing text, control characters, and impossible numbers."""
    for name, values in table.numbers.items():
        remedy = "Is it in another unit?"
        if name not in columns.numbers:
            remedy += " Leave a cell empty if it is not known."
        for row in np.flatnonzero(outside(values, name))[:1].tolist():
            raise table.fault(row, impossible(name), value=float(values[row]), remedy=remedy)
        check_numbers(values, what=f"a number of column {name}", where=table.path)
    for name, words in table.words.items():
        for row, word in enumerate(words):
            if not word and name in columns.words:
                raise table.fault(row, f"column {name} is empty")
            if not is_plain(word):
                raise table.fault(row, f"column {name} holds a control character", value=word, remedy="Remove it.")


def _header(path: Path, cells: list[str] | None, columns: Columns) -> tuple[list[str], _Factors]:
    """Return the columns' names, those of another unit as the format names them, and their own name and factor."""
    if not cells:
        raise RecordingError("is empty", where=path, remedy=f"Give it a header: {','.join(columns.required)}.")
    check(len(cells), "MAX_COLUMNS", what="its columns", where=f"{path}, line 1")
    header = [cell_text(cell.strip()).strip() or f"column_{index + 1}" for index, cell in enumerate(cells)]
    for mark, called in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            what = f"its columns are separated by {called}"
            remedy = "Save it with commas, and with a decimal point."
            raise RecordingError(what, where=f"{path}, line 1", value=header[0], remedy=remedy)
    if any("\0" in name for name in header):
        raise RecordingError("is not UTF-8 text", where=f"{path}, line 1", remedy="Save it as CSV UTF-8.")
    for name in header:
        if not is_plain(name):
            what = "the name of a column holds a control character"
            raise RecordingError(what, where=f"{path}, line 1", value=name, remedy="Remove it.")
    factors: dict[str, tuple[str, Fraction]] = {}
    for place, name in enumerate(header):
        found = None if name in columns.known else same_quantity(name, columns.known)
        if found is not None:
            header[place], factors[found[0]] = found[0], (name, found[1])
    _check_names(f"{path}, line 1", header, columns, factors)
    return header, factors


def _check_names(where: str, header: list[str], columns: Columns, factors: _Factors) -> None:
    """Raise RecordingError for a column twice, also in two units, a missing one, and an unknown unit."""
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        other = f", once as {factors[twice[0]][0]}" if twice[0] in factors else ""
        raise RecordingError(f"column {twice[0]} occurs twice in the header{other}", where=where)
    missing = [name for name in columns.required if name not in header]
    further = [name for name in header if name not in columns.known]
    if missing:
        near = nearest(missing[0], further)
        remedy = f"Rename {near} to {with_own_unit(near, missing[0])}, if that is what it holds." if near else ""
        remedy = next((f"{fault}." for name in further if (fault := fault_of_unit(name, missing))), remedy)
        if header[0].startswith("#"):
            remedy = "The first line names the columns: remove comments."
        raise RecordingError(
            f"column {', '.join(missing)} is missing; there are {', '.join(header)}", where=where, remedy=remedy
        )
    for name in filter(BRACKETS.fullmatch, further):  # without brackets it may be the name of another quantity
        if fault := fault_of_unit(name, columns.known):
            raise RecordingError(f"column {fault}", where=where)


def _converted(path: Path, factors: _Factors) -> Iterator[str]:
    """Yield a sentence for each column of another unit."""
    for name, (own, factor) in factors.items():
        if factor != 1:
            yield f"{path.name}: column {own} is read as {name}, times {float(factor):g}"


def _chunks(path: Path, rows: Any, width: int) -> Iterator[tuple[list[int], list[list[str]]]]:
    numbered = ((rows.line_num, row) for row in rows)
    filled = ((line, row) for line, row in numbered if row and (row[0].strip() or any(map(str.strip, row))))
    while some := list(itertools.islice(filled, _ROWS_AT_ONCE)):
        for line, row in some:
            if len(row) != width:
                what = f"the row has {len(row)} cells, the header {width}"
                remedy = "Is the file cut short, or has it decimal commas?"
                raise RecordingError(what, where=f"{path}, line {line}", value=",".join(row)[:80], remedy=remedy)
        yield [line for line, _ in some], [row for _, row in some]


def _numbers(path: Path, name: str, cells: Sequence[str], lines: list[int], empty_allowed: bool) -> Floats:
    try:
        if "_" in "".join(cells):
            raise ValueError  # float() ignores it
        values = np.array([float(cell or "nan") for cell in cells])
    except ValueError:
        values = np.array([_number(cell) for cell in cells])
    faults = np.flatnonzero(np.isinf(values) if empty_allowed else ~np.isfinite(values))
    # _number has turned text into an infinity
    if faults.size:
        first = int(faults[0])
        what, where = f"column {name} holds no finite number", f"{path}, line {lines[first]}"
        remedy = _remedy(cells[first].strip(), line=lines[first])
        raise RecordingError(what, where=where, value=cells[first], remedy=remedy)
    return values


def _number(cell: str) -> float:
    try:
        return math.inf if "_" in cell else float(cell.strip() or "nan")
    except ValueError:
        return math.inf


def _remedy(cell: str, *, line: int) -> str:
    """Return the remedy for a cell that holds no finite number."""
    if _MARKED.fullmatch(cell):
        return "Write it with a decimal point and without thousands separators."
    if line == 2:
        return "Correct the cell; if the line holds units, remove it: the columns' names hold them."
    return "Correct the cell, or remove the row."


def _guess(cells: list[str]) -> npt.NDArray[Any]:
    """Return numbers if every cell is one or empty, text otherwise."""
    try:
        return np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return np.array(cells, np.dtypes.StringDType())  # not as wide as the longest


def _misspelt(path: Path, header: Iterable[str], columns: Columns) -> tuple[str, ...]:
    absent = [name for name in columns.maybe_numbers + columns.maybe_words if name not in header]
    pairs = ((name, nearest(name, absent)) for name in header if name not in columns.known)
    return tuple(f"{path.name}: column {name} has no meaning here; {near} has" for name, near in pairs if near)
