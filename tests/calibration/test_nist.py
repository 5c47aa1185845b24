"""The optimiser is certified on NIST's Statistical Reference Datasets: values and standard deviations.

Data and certified values: NIST/ITL StRD, https://www.itl.nist.gov/div898/strd (public domain). MGH10 and Longley
are of higher difficulty in conditioning, Thurber, Eckerle4, MGH09, Rat43, BoxBOD in their starts.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from calibration.fit import least_squares as minimum_page
from calibration.fit.least_squares import Box, Minimum, by_differences, minimise
from tactilevision.errors import ConvergenceError
from tactilevision.records.measured import Floats

PROBLEMS: dict[str, Any] = json.loads((Path(__file__).parent / "nist_strd.json").read_text())
Curve = Callable[[Floats, Floats], Floats]

CURVES: dict[str, Curve] = {
    "Misra1a": lambda x, b: b[0] * -np.expm1(-b[1] * x),
    "Thurber": lambda x, b: (
        (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)
    ),
    "Eckerle4": lambda x, b: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "MGH09": lambda x, b: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "Rat42": lambda x, b: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda x, b: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "BoxBOD": lambda x, b: b[0] * -np.expm1(-b[1] * x),
    "DanWood": lambda x, b: b[0] * x ** b[1],
    "Kirby2": lambda x, b: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "MGH10": lambda x, b: b[0] * np.exp(b[1] / (x + b[2])),
    "Norris": lambda x, b: b[0] + b[1] * x,
    "Longley": lambda x, b: b[0] + x @ b[1:],
}
# Eckerle4's and BoxBOD's far starts see a flat sum of squares; a box of what can be meant leads back from there.
LOW = {"Eckerle4": [0.1, 0.5, 400.0], "BoxBOD": [1.0, 1e-3], "MGH09": [-5.0, -50.0, -50.0, -50.0]}
HIGH = {"Eckerle4": [20.0, 50.0, 500.0], "BoxBOD": [1e4, 10.0], "MGH09": [50.0, 50.0, 50.0, 50.0]}


def solve(name: str, start: Floats) -> Minimum:
    problem, curve = PROBLEMS[name], CURVES[name]
    x, y = np.array(problem["x"]), np.array(problem["y"])
    box = Box(
        np.array(LOW.get(name, [-np.inf] * start.size)),
        np.array(HIGH.get(name, [np.inf] * start.size)),
        np.maximum(np.abs(start), 1e-8),
    )

    def residual(b: Floats) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(np.nan_to_num(curve(x, b) - y, nan=1e3, posinf=1e3, neginf=-1e3))

    return minimise(by_differences(residual, box), start[None], box=box, tolerance=1e-15)


@each("which", ["start1", "start2"])
@each("name", [n for n in CURVES if n not in ("Norris", "Longley")])
def test_nonlinear_problems_from_both_of_their_starts(name: str, which: str) -> None:
    assert_certified(name, solve(name, np.array(PROBLEMS[name][which])), digits=6)


def test_a_descent_that_comes_to_no_end_says_so_or_gives_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimum_page, "MAX_STEPS", 4)
    monkeypatch.setattr(minimum_page, "MAX_RESTARTS", 0)
    begin = np.array([1.5, 0.5])
    box = Box(np.full(2, -1e3), np.full(2, 1e3), np.ones(2))

    def residual(at: Floats) -> Floats:  # Rosenbrock, Comput. J. 3 (1960) 175: a long bent valley
        return np.array([10 * (at[1] - at[0] ** 2), 1 - at[0]])

    with pytest.raises(ConvergenceError, match="from 1 starts"):
        minimise(by_differences(residual, box), begin[None], box=box)
    found = minimise(by_differences(residual, box), begin[None], box=box, settled=False)
    assert found.chi2 < 0.01 * float(np.sum(residual(begin) ** 2))


@pytest.mark.parametrize(("name", "digits"), [("Norris", 8), ("Longley", 5)])
def test_linear_problems(name: str, digits: int) -> None:
    """Longley's condition number is 5e9: its sixth digit depends on the processor's order of sums."""
    scale = np.abs(PROBLEMS[name]["certified"])
    assert_certified(name, solve(name, 10.0 ** np.ceil(np.log10(scale))), digits=digits)


def assert_certified(name: str, found: Minimum, *, digits: int) -> None:
    problem = PROBLEMS[name]
    np.testing.assert_allclose(found.values, problem["certified"], rtol=10.0**-digits)
    assert found.chi2 == pytest.approx(problem["sum_of_squares"], rel=1e-8)
    spread = found.residual.size - found.values.size
    r = np.linalg.qr(found.jacobian * np.abs(found.values), mode="r")
    std = np.sqrt(np.sum(np.linalg.inv(r) ** 2, axis=1) * found.chi2 / spread) * np.abs(found.values)
    np.testing.assert_allclose(std, problem["std"], rtol=1e-4)
