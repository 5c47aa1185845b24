"""A method's file keeps what certified faces taught of walls; files of before have none of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.photometric.storage import wall_arrays, walls_of
from tactilevision.records.certified import TaughtWalls, WallLessons

LESSON = TaughtWalls(0.1, 0.4, (0.01, 0.04, -0.002), (0.2, 0.6), 0.03)
FILE = Path("m.npz")


@pytest.mark.parametrize("walls", [WallLessons(LESSON), WallLessons(undone=LESSON), WallLessons(LESSON, LESSON)])
def test_lessons_come_back_as_they_went(walls: WallLessons) -> None:
    assert walls_of(wall_arrays(walls), where=FILE) == walls


def test_older_files_have_none() -> None:
    assert walls_of({}, where=FILE) is None


@each("place, value", [(0, 9.0), (1, -9.0), (2, -0.1), (4, 0.5), (5, 0.9), (5, 0.0), (7, -1.0)])
def test_numbers_that_no_faces_teach_are_refused(place: int, value: float) -> None:
    arrays = wall_arrays(WallLessons(LESSON))
    arrays["walls_left"][place] = value
    with pytest.raises(InputError):
        walls_of(arrays, where=FILE)
