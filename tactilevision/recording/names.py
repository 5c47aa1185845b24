"""Names in messages: the first of many, and which known one was probably meant by an unknown one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def nearest(name: str, among: Iterable[str]) -> str:
    """The name that was probably meant: the same but for a unit or a slip of the pen; "" where none is."""
    folded = {other.casefold(): other for other in among}
    for other in folded:
        if other.rpartition("_")[0] == name.casefold() or name.casefold().rpartition("_")[0] == other:
            return folded[other]
    close = difflib.get_close_matches(name.casefold(), list(folded), n=1, cutoff=0.8)
    return folded[close[0]] if close else ""


def some(names: Sequence[str]) -> str:
    """The first three, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
