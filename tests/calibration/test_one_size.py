"""A clock that is off is off by one time throughout: what looks like it but has several sizes is told from it."""

from __future__ import annotations

import numpy as np
import pytest
from test_relaxation_terms import held
from test_screen import MODEL, TRUTH, measured, pure

from calibration.diagnosis.refit import adopt, refit_with
from calibration.diagnosis.score_test import score_test
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit


def with_clock(lost_N: float, offset_s: float) -> Fit:
    """A clock fitted to presses that lose force on their way in, at any rate, or whose clock is off indeed."""
    data, clock = held(), EFFECTS["clock_offset"]
    force = (MODEL + clock).predict(np.array([*TRUTH, offset_s]), data)
    force = force - lost_N * (data.phase == "load")
    base = pure(measured(data, force, np.random.default_rng(5)))
    return adopt(base, refit_with(base, clock))


@pytest.mark.parametrize(("lost_N", "offset_s", "one"), [(0.0, 0.02, True), (0.02, 0.0, False)])
def test_a_clock_is_off_by_one_time_at_all_rates_and_both_ways(lost_N: float, offset_s: float, one: bool) -> None:
    fitted = with_clock(lost_N, offset_s)
    looked = {c.key: c.p_adjusted for c in score_test(fitted, (), rng=np.random.default_rng(0)).covariates}
    told = min(looked["clock_offset.offset_s by log rate"], looked["clock_offset.offset_s by load/unload"])
    assert told > 0.05 if one else told < 1e-4
    if one:
        assert fitted.estimate("clock_offset.offset_s").value == pytest.approx(offset_s, rel=0.05)
