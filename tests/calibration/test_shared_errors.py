"""What all certified depths have wrong together does not average out over presses, and the interval says so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_recordings import Truth, draw

from calibration.fit.tolerances import HEIGHTS, with_tolerances
from calibration.inputs.observations import Measured, join
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import calibrate, observe
from tactilevision.records.certified import CertificationDetails

TOUCH_MM, RISE = 0.002, 0.006


def shifted(measured: Measured, offset_mm: float, *, states: bool) -> Measured:
    """The same presses with every depth read too small by one offset."""
    stated: dict[str, Any] = {
        "contact_shared_std_mm": TOUCH_MM,
        "pile_up_ratio": 0.1,
        "pile_up_ratio_std": RISE * 1.1,
    }
    details = replace(CertificationDetails(), **stated) if states else CertificationDetails()
    points = [replace(p, depth_mm=p.depth_mm - offset_mm, details=details) for p in measured.points]
    return replace(measured, points=tuple(points))


def result(seed: int, offset_mm: float, *, states: bool) -> CalibrationResult:
    measured = draw(Truth(height_std_mm=0.001), np.random.default_rng(seed))
    return calibrate(shifted(measured, offset_mm, states=states))


def width(found: CalibrationResult) -> float:
    assert found.c.interval95 is not None
    return found.c.interval95[1] - found.c.interval95[0]


def test_a_stated_shared_error_widens_the_interval() -> None:
    assert width(result(1, 0.0, states=True)) > 1.4 * width(result(1, 0.0, states=False))


def test_the_estimate_itself_stays() -> None:
    stated, silent = (result(2, 0.0, states=states).c.value for states in (True, False))
    assert stated == pytest.approx(silent, rel=0.005)


def test_presses_of_an_indenter_that_is_added_keep_their_depth() -> None:
    """Presses that are proposed have an indenter of their own, whose height nobody machined yet."""
    data = observe([draw(Truth(height_std_mm=0.001), np.random.default_rng(4))])
    model = with_tolerances(Model(FlatPunch()), data)
    values, size = model.defaults(data), data.size
    values[model.slices(data)[HEIGHTS]] = 0.01
    more = join(data, data)
    moved = model.predict(values, more) > model.predict(model.defaults(data), more)
    assert moved[:size].all()
    assert not moved[size:].any()


@pytest.mark.slow
def test_intervals_cover_a_shared_offset_of_one_sigma() -> None:
    """Five draws, every touch seen one sigma late; what is covered is the stiffness without that error."""
    covered = {True: 0, False: 0}
    for seed in range(5):
        clean = draw(Truth(), np.random.default_rng(100 + seed))
        near = calibrate(clean).c
        assert near.value is not None
        for states in covered:
            interval = calibrate(shifted(clean, TOUCH_MM, states=states)).c.interval95
            assert interval is not None
            covered[states] += interval[0] <= near.value <= interval[1]
    assert covered[True] == 5
    assert covered[True] >= covered[False]


def test_on_a_ruler_the_scale_alone_is_open() -> None:
    """Points of one ruler share its scale: heights have no error of their own, and c is as open as the scale."""
    measured = draw(Truth(), np.random.default_rng(4))
    found = {}
    for scale in (0.002, 0.02):
        details = CertificationDetails(travel_scale_std=scale, pile_up_ratio=0.1, pile_up_ratio_std=0.0)
        points = [replace(p, depth_std_mm=scale * p.depth_mm, details=details) for p in measured.points]
        found[scale] = calibrate(replace(measured, points=tuple(points)))
        assert HEIGHTS not in found[scale].fitted.model.keys
    tight, wide = (float(one.c.std or 0.0) / float(one.c.value or 1.0) for one in found.values())
    assert wide == pytest.approx(np.sqrt(tight**2 + 0.02**2 - 0.002**2), rel=0.05)
