"""A curve's arrays belong together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.records.measured import Curve

T = np.linspace(0.0, 1.0, 5)
FORCE, PHASE = np.zeros((5, 3)), np.full(5, "")


def test_arrays_of_one_length_are_a_curve() -> None:
    assert Curve("p1", T, T, FORCE, PHASE).press == "p1"


@each(
    "given",
    [(T, T[1:], FORCE, PHASE), (T, T, T, PHASE), (T, T, FORCE.T, PHASE), (T, T, FORCE, None)],
)
def test_arrays_that_do_not_fit_are_named(given: tuple[Any, ...]) -> None:
    with pytest.raises(InputError, match="curve p1: time_s, depth_mm and phase have one entry a sample"):
        Curve("p1", *given)
