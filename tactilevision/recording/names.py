"""Names in messages: the first of many, and which known one was probably meant by an unknown one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence


def nearest(name: str, among: Iterable[str]) -> str:
    """The name that was probably meant: the same but for brackets, a unit or a slip; "" where none is."""
    plain, folded = _folded(name), {_folded(other): other for other in among}
    for other in folded:
        if other.rpartition("_")[0] == plain or plain.rpartition("_")[0] == other:
            return folded[other]
    close = difflib.get_close_matches(plain, list(folded), n=1, cutoff=0.8)
    return folded[close[0]] if close else ""


def _folded(name: str) -> str:
    """In small letters, `Depth (mm)` being depth_mm."""
    return re.sub(r"[^\w./-]+", "_", name.casefold()).strip("_")


def some(names: Sequence[str]) -> str:
    """The first three, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
