"""A method's file keeps what certified faces taught of walls."""

from __future__ import annotations

from pathlib import Path

import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.photometric.storage import taught_walls, wall_numbers
from tactilevision.records.certified import TaughtWalls

LESSON = TaughtWalls(0.1, 0.4, (0.01, 0.04, -0.002), (0.2, 0.6), 0.03)
FILE = Path("m.npz")


def test_lessons_come_back_as_they_went() -> None:
    assert taught_walls(wall_numbers(LESSON), where=FILE) == LESSON


@each("place, value", [(0, 9.0), (1, -9.0), (2, -0.1), (4, 0.5), (5, 0.9), (5, 0.0), (7, -1.0)])
def test_numbers_that_no_faces_teach_are_refused(place: int, value: float) -> None:
    numbers = wall_numbers(LESSON)
    numbers[place] = value
    with pytest.raises(InputError):
        taught_walls(numbers, where=FILE)
