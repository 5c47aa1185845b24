"""Numbers that files state: finite, and below what any sensor gives; truth values and text are none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactilevision.door.limits import check
from tactilevision.errors import InputError


def number(value: object, *, what: str, where: object) -> float | None:
    """A number of a parsed document, in its unit; None where there is none (null).

    Raises InputError where it is text, a truth value or a list, not finite, or beyond the limit MAX_NUMBER.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{what} is no number", where=where, value=str(value)[:40])
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{what} is no finite number", where=where, value=value)
    check(abs(value), "MAX_NUMBER", what=what, where=where)
    return float(value)


def read_cells(cells: Sequence[str], *, where: object) -> list[float]:
    """The numbers of a row of text, in their units; an empty cell is NaN.

    Raises InputError for text that is none, and as `check_numbers` does.
    """
    try:
        found = [float(cell or "nan") for cell in cells]
    except ValueError as fault:
        raise InputError("a cell holds no number", where=where, value=str(fault)[:80]) from fault
    check_numbers(np.array(found), what="a cell", where=where)
    return found


def check_numbers(values: npt.NDArray[np.number], *, what: str, where: object) -> None:
    """Raise InputError where a number of an array, of any shape and in any unit, is infinite or too large.

    NaN passes: whether a gap may be there is for the reader to say.
    """
    if values.dtype in (np.int64, np.uint64):
        values = values.astype(np.float64)
    if values.dtype.kind == "f":
        largest = np.abs(values).max(initial=0.0, where=~np.isnan(values))
        check(float(largest), "MAX_NUMBER", what=what, where=where)
