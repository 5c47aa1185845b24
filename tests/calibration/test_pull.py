"""A reading pulls where it lies below all of air, and so says that a face holds, whatever its depth reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.diagnosis.sensitivity import as_it_holds
from calibration.effects import EFFECTS
from calibration.fit.least_squares import fit
from calibration.inputs.checks import pull_level_N
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model

CLINGS = Model(FlatPunch()) + EFFECTS["adhesion"]
VALUES = np.array(
    [0.2, 0.48, 0.85, 1e-5]
)  # E, nu, beta, W: by the law alone the face lets go 4 um above the touch
IN_AIR = 12


def one_press(*, air: int, read_N: float) -> Observations:
    """Readings of air, 20 mN off zero, +-10 mN; a press; one reading 40 um above the touch on the way out."""
    depth = np.concatenate([np.linspace(-0.08, -0.05, air), [0.1, 0.3, 0.1, -0.04]])
    force = np.concatenate([0.02 + 0.01 * (-1.0) ** np.arange(air), [0.4, 1.3, 0.4, read_N]])
    return observations([depth], [indenter()]).with_force(force)


def test_the_level_lies_four_std_below_the_middle_of_air() -> None:
    level = pull_level_N(one_press(air=IN_AIR, read_N=0.0))
    assert level == pytest.approx(0.02 - 4 * 1.4826 * 0.01, rel=1e-3)  # the std of a median absolute deviation
    assert np.isnan(pull_level_N(one_press(air=4, read_N=0.0))), "four readings tell no scatter"


@pytest.mark.parametrize(("read_N", "share"), [(-0.05, 0.95), (-0.03, 0.0), (0.01, 0.0)])
def test_what_lies_below_air_holds_though_it_pulls_by_little(read_N: float, share: float) -> None:
    """The line is -.15 N there, which a depth that is read off makes less than half of."""
    data = one_press(air=IN_AIR, read_N=read_N)
    line = CLINGS.predict(np.array([*VALUES[:3], 0.005]), data.with_force(np.full(data.size, -1.0)))[-1]
    assert line < 2 * read_N
    assert CLINGS.predict(VALUES, data)[-1] == pytest.approx(share * line, abs=0.02 * abs(line))


def test_a_sample_that_lets_go_is_no_direction_of_the_force() -> None:
    """On a gel 2 % thicker a line is no longer twice the level, and the law alone would let the face cling."""
    data = one_press(air=IN_AIR, read_N=0.01)
    strong, level = np.array([*VALUES[:3], 5e-4]), pull_level_N(data)
    slope = CLINGS.predict(strong, data.with_force(np.full(data.size, -1.0)))[-1] / -0.04
    depth = np.append(data.depth_mm[:-1], 2.01 * level / slope)
    data = replace(data, depth_mm=depth)
    one = replace(fit(CLINGS, data), values=strong, force_N=CLINGS.predict(strong, data))
    thick = CLINGS + EFFECTS["thickness"]
    values = np.insert(strong, thick.slices(data)["thickness"].start, 0.02)
    change = thick.predict(values, data) - one.force_N
    assert abs(change[-1]) > 2 * np.abs(change[:-1]).max(), "it would be most of the change"
    held = as_it_holds(one, thick, values, change)
    np.testing.assert_array_equal(held[:-1], change[:-1])
    assert abs(held[-1]) < 1e-9
