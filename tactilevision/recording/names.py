"""Which known name was probably meant by an unknown one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(name: str, among: Iterable[str]) -> str:
    """The name that was probably meant: the same but for a unit or a slip of the pen; "" where none is."""
    folded = {other.casefold(): other for other in among}
    for other in folded:
        if other.rpartition("_")[0] == name.casefold() or name.casefold().rpartition("_")[0] == other:
            return folded[other]
    close = difflib.get_close_matches(name.casefold(), list(folded), n=1, cutoff=0.8)
    return folded[close[0]] if close else ""
