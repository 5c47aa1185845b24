"""What certified faces taught of walls as the arrays of a method's file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records import Floats
from tactilevision.records.taught_walls import TaughtWalls, WallLessons

NUMBERS = 8  # share, growth; their two variances and covariance; least and greatest depth in mm; scatter
NAMES = {"left": "walls_left", "undone": "walls_undone"}  # by what became of cast shadows
SHAPES: Mapping[str, tuple[int, ...]] = dict.fromkeys(NAMES.values(), (NUMBERS,))
MAX_CHANGE = 3.0  # of what a wall hides: two thirds of a face are no wall's; light is then to be calibrated anew


def wall_arrays(walls: WallLessons) -> dict[str, Floats]:
    """The numbers (8,) of each lesson by its name in the file, depths in mm; none where nothing was taught."""
    lessons = {name: getattr(walls, key) for key, name in NAMES.items()}
    return {
        name: np.array([one.share, one.growth, *one.covariance, *one.limits_mm, one.scatter])
        for name, one in lessons.items()
        if one is not None
    }


def walls_of(arrays: Mapping[str, npt.NDArray[Any]], *, where: Path) -> WallLessons | None:
    """The lessons of arrays (8,), finite, depths in mm; older files, and methods that no face taught, have none.

    Raises InputError for numbers that no faces teach.
    """
    found = {key: _lesson(arrays[name], where) for key, name in NAMES.items() if name in arrays}
    return WallLessons(**found) if found else None


def _lesson(numbers: npt.NDArray[Any], where: Path) -> TaughtWalls:
    share, growth, of_share, of_growth, between, low, high, scatter = (float(one) for one in numbers)
    known = max(abs(share), abs(growth)) <= MAX_CHANGE and 0 < low <= high and scatter >= 0
    if not known or min(of_share, of_growth) < 0 or between**2 > of_share * of_growth:
        raise InputError("what faces taught of walls is of no face", where=where, value=numbers.tolist())
    return TaughtWalls(share, growth, (of_share, of_growth, between), (low, high), scatter)
