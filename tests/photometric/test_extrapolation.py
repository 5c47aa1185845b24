"""Beyond the balls: distances are exact, and the planted growth of errors with them comes back."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.cross_validation import (
    MAX_STD,
    PRIOR_RATE,
    distance_beyond,
    extrapolated_std,
    growth_rate,
    sides_of,
)

SQUARE = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (0.0, 0.0)])


def test_distance_is_that_from_the_hull_and_nothing_inside_it() -> None:
    at = np.array([(0.0, 0.1), (0.8, 0.0), (-0.8, -0.9), (0.5, 0.2)])
    assert distance_beyond(SQUARE, at) == pytest.approx([0.0, 0.3, 0.5, 0.0], abs=1e-6)


@each("seed", range(3))
@each("rate", [0.2, 1.5])
def test_errors_that_grow_with_distance_tell_how_fast(rate: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    beyond = rng.uniform(0.0, 0.4, 400)
    errors = rate * beyond * rng.standard_normal(400)
    assert growth_rate(errors, beyond, inside_std=0.0) == pytest.approx(rate, rel=0.15)


def test_errors_as_among_the_balls_are_no_growth() -> None:
    found = growth_rate(np.full(36, 0.03), np.full(36, 0.2), inside_std=0.03)
    assert found == pytest.approx(PRIOR_RATE * np.sqrt(4.0 / 40.0)), "36 balls against a rate that is worth four"


def test_few_balls_or_none_beyond_leave_the_usual_rate() -> None:
    assert growth_rate(np.array([0.3, 0.1]), np.zeros(2), inside_std=0.03) == PRIOR_RATE
    one = growth_rate(np.array([1.0]), np.array([0.2]), inside_std=0.03)
    assert PRIOR_RATE < one < 0.5 * (1.0 / 0.2), "one ball is worth a fifth"


def test_no_more_is_stated_than_the_scale_itself() -> None:
    assert extrapolated_std(4.0, np.array([0.0, 0.1, 2.0])) == pytest.approx([0.0, 0.4, MAX_STD])


def test_sides_are_the_outermost_balls() -> None:
    centres = np.array([(-0.9, 0.0), (0.9, 0.1), (0.0, -0.8), (0.1, 0.7), (0.0, 0.0)])
    press = np.repeat(np.arange(5) + 3, 4)
    samples = Samples(np.zeros((20, 3)), np.repeat(centres, 4, axis=0), np.zeros((20, 2)), press)
    assert [side.tolist() for side in sides_of(samples)] == [[4], [3], [6], [5]]
