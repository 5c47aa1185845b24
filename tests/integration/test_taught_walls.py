"""What certified faces teach of walls: planted numbers are found again, and nothing where it is not walls."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.heightmap.walls import MIN_COUNT, PLACE_STD, PRIOR_STD, WallFace, teach
from tactilevision.records.certified import USUAL_MM

DEPTHS = (0.3, 0.4, 0.5, 0.6)


def faces(share: float, growth: float, *, seed: int, places: int = 2, scale: float = 1.0) -> list[WallFace]:
    """Faces of all depths at each place, whose walls hide a quarter; read as the planted law has them."""
    rng, found = np.random.default_rng(seed), []
    for place in range(places):
        for depth in DEPTHS:
            read, hidden = scale * depth, 0.25 * depth
            true = read + hidden * (share + growth * (depth / USUAL_MM - 1)) + PLACE_STD * read * rng.normal()
            found.append(WallFace(str(place), read, hidden, depth, true))
    return found


def test_planted_numbers_are_found_again_within_what_is_stated() -> None:
    off = []
    for seed in range(200):
        planted = np.array(PRIOR_STD) * np.random.default_rng([1, seed]).normal(size=2)
        lesson = teach(faces(*planted, seed=seed))
        if lesson is not None:  # a draw may lie beyond what walls do
            stated = np.sqrt(lesson.covariance[:2])
            off.append((np.array([lesson.share, lesson.growth]) - planted) / stated)
    assert len(off) > 180
    assert np.std(off, axis=0) == pytest.approx([1.0, 1.0], abs=0.15)


def test_many_faces_leave_nothing_of_the_prior() -> None:
    lesson = teach(faces(0.3, -0.4, seed=0, places=400))
    assert lesson is not None
    assert (lesson.share, lesson.growth) == pytest.approx((0.3, -0.4), abs=0.03)


def test_repeats_at_one_place_count_as_one() -> None:
    once = faces(0.2, 0.3, seed=3)
    one, thrice = teach(once), teach(3 * once)
    assert one is not None
    assert thrice is not None
    assert thrice.covariance == pytest.approx(one.covariance)
    assert thrice.share == pytest.approx(one.share)


def test_depths_about_alike_count_as_one_wherever_they_lie() -> None:
    def taught(*depths: float) -> tuple[float, ...]:
        made = [WallFace("A", depth, 0.1, 0.45, depth) for depth in depths for _ in range(5)]
        lesson = teach([*made, WallFace("A", 0.2, 0.05, 0.2, 0.2)])
        assert lesson is not None
        return lesson.covariance

    assert taught(0.4749, 0.4751) == pytest.approx(taught(0.475, 0.475), rel=1e-3)
    assert taught(0.44, 0.5)[0] < 0.9 * taught(0.475, 0.475)[0], "these are two"


@each("name", ["read_mm", "hidden_mm", "depth_mm", "certified_mm"])
@each("value", [-0.01, 0.0, np.nan, np.inf])
def test_faces_of_no_depth_teach_nothing(name: str, value: float) -> None:
    good = faces(0.2, 0.3, seed=4)
    wrong: dict[str, Any] = {name: value}
    bad = [replace(one, **wrong) for one in good]
    assert teach(bad) is None
    assert teach([*good, *bad]) == teach(good)


def test_few_faces_and_faces_that_are_off_by_more_than_walls_teach_nothing() -> None:
    good = faces(0.2, 0.3, seed=4)
    assert teach(good[: MIN_COUNT - 1]) is None
    assert teach([replace(one, hidden_mm=0.0) for one in good]) is None
    assert teach(faces(2.0, 0.0, seed=4)) is None


def test_depths_beyond_those_that_taught_are_read_as_the_last_of_these() -> None:
    lesson = teach(faces(0.1, 0.5, seed=5, places=9))
    assert lesson is not None
    assert lesson.change_mm(0.1, 0.9)[0] == lesson.change_mm(0.1, 0.6)[0]
    assert lesson.change_mm(0.1, 0.6)[0] > lesson.change_mm(0.1, 0.3)[0]
    assert replace(lesson, share=-2.0).change_mm(0.1, 0.3)[0] == -0.1, "a wall hides no less than nothing"
    assert lesson.change_mm(0.0, 0.5)[0] == 0.0
