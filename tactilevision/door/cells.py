"""Cells of CSV tables: text that a spreadsheet would run as a formula is written as text, and read as it was.

An apostrophe goes before a text that begins with = + - @ (wide ones, too), a tab or a return, as spreadsheets
mark text themselves; numbers stay as they are. Source: OWASP, CSV Injection.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence

_FORMULA = re.compile(r"'*[=+\-@\t\r＝＋－＠]")  # after marks of its own; the wide signs run, too


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """The rows as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_marked(cell) for cell in row] for row in rows)
    return text.getvalue()


def cell_text(cell: str) -> str:
    """What stands in a cell that was read, without the mark that `csv_text` may have put before it."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell


def _marked(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and _FORMULA.match(cell) and not _is_number(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
