"""Read TOML and JSON of bounded size and depth; write and read cells of CSV tables safely."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from tactilevision.errors import InputError, one_line
from tactilevision.files.opening import MB, check, is_plain, limit, read_bytes

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
    _check_nesting(_STRINGS.sub('""', text), where)
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as fault:
        line = re.search(r"line (\d+)", str(fault))
        place = f"{where}, line {line[1]}" if line else f"{where}, at its end"
        if "overwrite" in str(fault) or "twice" in str(fault):
            raise InputError(
                "a key or a table is stated twice", where=place, remedy="Keep one of them."
            ) from fault
        raise InputError(
            f"is not TOML: {fault}",
            where=place,
            remedy="Put text in quotes, the name of a table in [brackets]; write numbers with a decimal point.",
        ) from fault
    except (ValueError, RecursionError, OverflowError) as fault:
        raise InputError(f"is not TOML: {fault}", where=where) from fault
    _check_keys(content, where)
    return content


def _check_keys(content: object, where: object) -> None:
    """Raise InputError for a key with a control character."""
    for key, value in content.items() if isinstance(content, dict) else ():
        if not is_plain(key):
            raise InputError("a key holds a control character", where=where, value=key, remedy="Remove it.")
        for one in value if isinstance(value, list) else [value]:
            _check_keys(one, where)


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
    if len(text) > limit("MAX_DIGITS"):
        raise ValueError(f"a number of {len(text)} digits")
    return int(text)


def _check_nesting(text: str, where: object) -> None:
    """Raise InputError for deep nesting, keys of many parts, and numbers of many digits."""
    depth = deepest = 0
    for mark in re.findall(r"[\[\]{}]", text):
        depth += 1 if mark in "[{" else -1
        deepest = max(deepest, depth)
    check(deepest, "MAX_DEPTH", what="brackets within brackets", where=where)
    parts = max((key[0].count(".") + 1 for key in re.finditer(r"[\w\"-][\w.\" -]*", text)), default=0)
    check(parts, "MAX_DEPTH", what="the parts of a key", where=where)
    digits = max((len(number) for number in re.findall(r"[0-9_]+", text)), default=0)
    check(digits, "MAX_DIGITS", what="the digits of a number", where=where)


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
