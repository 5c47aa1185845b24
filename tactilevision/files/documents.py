"""Read TOML and JSON of bounded size; write and read cells of CSV tables safely."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from tactilevision.errors import InputError, one_line
from tactilevision.files.opening import MB, check, is_plain, read_bytes

_STRINGS = re.compile(  # and comments of TOML; one that is not closed ends with its line or the text: no way back
    r'''"""(?:\\.|[^\\"]|"(?!""))*+(?:""")?|"(?:\\.|[^"\\\n])*+"?|#[^\n]*+|'''
    r"""'''(?:[^']|'(?!''))*+(?:''')?|'[^'\n]*+'?""",
    re.S,
)


def read_text(path: Path | str) -> str:
    """Read UTF-8 text, with or without a byte order mark.

    Raises InputError, and OSError as `open_regular` does.
    """
    data = read_bytes(path, limit="MAX_TEXT_MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise InputError("is not UTF-8 text", where=path, remedy="Save it as UTF-8.") from fault


def parse_toml(text: str, *, where: object) -> dict[str, Any]:
    """Parse the table of a TOML text. Raises InputError with the line if it is not one, or beyond the limits."""
    keys = re.finditer(r"[\w\"-][\w.\" -]*", _STRINGS.sub('""', text))
    check(
        max((key[0].count(".") + 1 for key in keys), default=0),
        "MAX_DEPTH",
        what="the parts of a key",
        where=where,
    )
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError, OverflowError) as fault:
        line = re.search(r"line (\d+)", str(fault))
        place = f"{where}, line {line[1]}" if line else f"{where}, at its end"
        what = f"is not TOML: {fault}"
        remedy = "Put text in quotes, the name of a table in [brackets]; write numbers with a decimal point."
        if "overwrite" in str(fault) or "twice" in str(fault):
            what, remedy = "a key or a table is stated twice", "Keep one of them."
        raise InputError(what, where=place, remedy=remedy) from fault
    _check_values(content, where)
    return content


def _check_values(content: object, where: object) -> None:
    """Raise InputError for a key with a control character, and a whole number that no float holds."""
    if isinstance(content, int) and abs(content) > sys.float_info.max:
        raise InputError("a whole number has more than 308 digits", where=where)
    for key, value in content.items() if isinstance(content, dict) else ():
        if not is_plain(key):
            raise InputError("a key holds a control character", where=where, value=key, remedy="Remove it.")
        _check_values(value, where)
    for value in content if isinstance(content, list) else ():
        _check_values(value, where)


def read_json(path: Path | str) -> dict[str, Any]:
    """Read the table of a JSON file, its numbers finite.

    Raises InputError where it is no such table, OSError where the file system refuses.
    """
    return parse_json(read_text(path), where=path)


def parse_json(text: str | bytes, *, where: object) -> dict[str, Any]:
    """Parse the table of a JSON text, its numbers finite. Raises InputError if it is no such table."""
    check(len(text) / MB, "MAX_TEXT_MB", what="its size in MB", where=where)
    try:
        content = json.loads(
            text, parse_float=_finite, parse_int=_whole, parse_constant=_finite, object_pairs_hook=_once
        )
    except (ValueError, RecursionError) as fault:
        raise InputError(f"is not JSON: {str(fault)[:200]}", where=where) from fault
    if not isinstance(content, dict):
        raise InputError("is not a table of JSON", where=where, value=type(content).__name__)
    if "\\u" in text if isinstance(text, str) else b"\\u" in text:
        try:
            json.dumps(content, ensure_ascii=False).encode()
        except UnicodeEncodeError as fault:
            raise InputError("is not JSON: half of a letter stands alone (a surrogate)", where=where) from fault
    return content


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the table, each key once: a repeated key is ambiguous."""
    table = dict(pairs)
    if len(table) < len(pairs):
        (twice, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"the key {twice[:40]!r} occurs twice")
    return table


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is not a finite number")
    return number


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def html_text(text: str) -> str:
    """Return a text for HTML, with control characters spelt out."""
    return html.escape(one_line(text))


# Cells of CSV tables. A text that a spreadsheet would run as a formula, since it begins with = + - @ (also in full
# width), a tab or a return, is written after an apostrophe; reading removes it. Source: OWASP, CSV Injection.

_FORMULA = re.compile(r"'*[=+\-@\t\r＝＋－＠]")


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Format the rows as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_marked(cell) for cell in row] for row in rows)
    return text.getvalue()


def cell_text(cell: str) -> str:
    """Return what a cell holds, without the mark that `csv_text` may have put before it."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell


def _marked(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and _FORMULA.match(cell) and not _is_number(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
