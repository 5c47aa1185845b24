"""Windows of a picture, and what two of them share."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True, slots=True)
class Patch:
    """`values` (h, w) in the `window` of a picture that is 0 elsewhere."""

    window: Window
    values: npt.NDArray[np.float32]


def window_of(where: Bools) -> Window | None:
    """The rows and columns that hold all of a mask (h, w), None for an empty one."""
    left, top, width, height = cv2.boundingRect(where.view(np.uint8))
    return (slice(top, top + height), slice(left, left + width)) if width else None


def common(one: Window, other: Window) -> Window | None:
    """Rows and columns that two windows share; None where they share none."""
    rows, columns = (slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def inside(window: Window, of: Window) -> Window:
    """A window of the picture, counted from the first row and column of another that holds it."""
    rows, columns = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(window, of, strict=True))
    return rows, columns


def outside(window: Window, of: Window) -> Window:
    """A window that is counted from another's first row and column, as one of the picture."""
    rows, columns = (slice(a.start + b.start, a.stop + b.start) for a, b in zip(window, of, strict=True))
    return rows, columns
