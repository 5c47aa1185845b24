"""Results on disk become named values: numbers, short words, and lists of these. Sentences are left out."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Scalar: TypeAlias = float | int | str | bool | None
Value: TypeAlias = Scalar | list[Scalar]
Values: TypeAlias = dict[str, Value]

WORD = re.compile(r"[\w.+:/-]{0,40}")
NOT_RESULTS = frozenset({"versions", "path", "recordings", "command", "date", "why", "files", "figures"})
STATISTICS: dict[str, Callable[[Floats], np.floating]] = {"min": np.min, "max": np.max, "mean": np.mean}
MAX_VALUES = 48  # values of a list or rows of a table that are kept; of longer ones every n-th


def of_json(path: Path, prefix: str, skip: Collection[str] = ()) -> Values:
    """The numbers and words of a JSON file under dotted names; `skip` names keys, at any depth, to leave out."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return dict(_flatten(content, prefix, NOT_RESULTS | set(skip)))


def of_table(path: Path, prefix: str, columns: Sequence[str] = (), skip: str = "$^") -> Values:
    """The columns of a CSV file, all but those that match `skip`; every n-th row of a long one."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [{key: _scalar(text) for key, text in row.items()} for row in csv.DictReader(file)]
    if not rows:
        return {f"{prefix}.rows": 0}
    names = columns or [name for name in rows[0] if not re.match(skip, name)]
    found: Values = {f"{prefix}.rows": len(rows)}
    for name in names:
        found |= dict(_listed([row[name] for row in rows], f"{prefix}.{name}"))
    return found


def of_map(array: NDArray[np.floating], prefix: str, every: int) -> Values:
    """A map by its least, largest and mean value, its count of NaN, and every n-th pixel both ways."""
    finite = array[np.isfinite(array)].astype(np.float64)
    few = array[every // 2 :: every, every // 2 :: every]
    found: Values = {f"{prefix}.shape": list(array.shape), f"{prefix}.nan": int(np.isnan(array).sum())}
    if finite.size == 0:
        return found
    found |= {f"{prefix}.{name}": float(of(finite)) for name, of in STATISTICS.items()}
    return found | {f"{prefix}.grid": [_number(one) for one in few.ravel()]}


def _number(value: np.floating) -> float | None:
    """The shortest number that is the same in the array's own precision; None for NaN."""
    return float(str(value)) if np.isfinite(value) else None


def _scalar(text: str) -> Scalar:
    if text in ("true", "false", ""):
        return {"true": True, "false": False, "": None}[text]
    try:
        number = float(text)
    except ValueError:
        return text
    return None if math.isnan(number) else number


def _flatten(content: object, name: str, skip: Collection[str]) -> Iterator[tuple[str, Value]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            if key not in skip:
                yield from _flatten(value, f"{name}.{key}", skip)
    elif isinstance(content, list):
        yield from _flatten_list(content, name, skip)
    elif _is_plain(content) and (not isinstance(content, str) or WORD.fullmatch(content)):
        yield name, content


def _flatten_list(content: list[object], name: str, skip: Collection[str]) -> Iterator[tuple[str, Value]]:
    """Numbers in rows become one list, records of the same keys become columns.

    A screen's rows are sorted by key: ranks that tie are others on another processor.
    """
    if content and all(isinstance(row, list) and all(_is_plain(one) for one in row) for row in content):
        content = [one for row in content if isinstance(row, list) for one in row]
    if all(_is_plain(one) for one in content):
        yield from _listed(content, name)
    elif all(isinstance(row, dict) and all(_is_plain(one) for one in row.values()) for row in content):
        rows = [row for row in content if isinstance(row, dict)]
        if name.endswith(".screen"):
            rows.sort(key=lambda row: str(row["key"]))
        for key in dict.fromkeys(key for row in rows for key in row if key not in skip):
            yield from _listed([row.get(key) for row in rows], f"{name}.{key}")
    else:
        for number, one in enumerate(content):
            yield from _flatten(one, f"{name}.{number}", skip)


def _is_plain(one: object) -> TypeGuard[Scalar]:
    return one is None or isinstance(one, bool | int | float | str)


def _listed(content: Sequence[object], name: str) -> Iterator[tuple[str, Value]]:
    """A list of numbers and words; one that holds sentences is only counted."""
    values = [one for one in content if _is_plain(one)]
    if any(isinstance(one, str) and not WORD.fullmatch(one) for one in values):
        yield f"{name}.count", len(values)
        return
    step = -(-len(values) // MAX_VALUES) or 1
    if step > 1:
        yield f"{name}.count", len(values)
    yield name, values[::step]
