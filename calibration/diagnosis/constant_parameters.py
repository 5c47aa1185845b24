"""Parameters of effects that have to be constant over a covariate, and are not.

A constant of the gel (a relaxation time, a diffusivity) or of the rig (an offset between clocks) is the same at
all radii, rates and times (`same_over` of its effect). The score test has, for each of them, the change of the
force by the parameter in each step of the covariate. Where that is significant, the model is fitted to the samples
of the first and of the last step alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibration.diagnosis.covariates import OTHER_BINS, OVER, seen_covariates
from calibration.diagnosis.refit import CANNOT_FIT, fit_without
from calibration.diagnosis.score_test import Scored
from calibration.fit.least_squares import Fit, inverse_information
from calibration.inputs.conditions import bins
from tactilevision.records.measured import Estimate


@dataclass(frozen=True, slots=True)
class Varying:
    """A parameter, and its value in the first and the last step of a covariate, whose means are `ends`."""

    effect: str
    parameter: str
    covariate: str
    ends: tuple[float, float]
    values: tuple[Estimate, Estimate]

    @property
    def ratio(self) -> float:
        """The larger value over the smaller one; inf where one is 0."""
        low, high = sorted(abs(one.value or 0.0) for one in self.values)
        return high / low if low > 0 else float("inf")

    def as_json(self) -> dict[str, Any]:
        """Return its entry of `not_constant` in diagnosis.json."""
        return asdict(self) | {"values": [one.as_json() for one in self.values]}


def varying(fitted: Fit, covariates: Iterable[Scored], *, level: float) -> tuple[Varying, ...]:
    """Return the parameters of effects in the fit that significantly vary, the most significant first."""
    found = []
    for name, over, along in (s.key.partition(OVER) for s in covariates if s.p_adjusted <= level):
        if over:
            with suppress(*CANNOT_FIT):
                found.append(_at_ends(fitted, name, along))
    return tuple(found)


def _at_ends(fitted: Fit, name: str, along: str) -> Varying:
    """Return the parameter in the first and the last step of the covariate."""
    covariate = next(c for c in seen_covariates(fitted) if c.name == along)
    (effect, _, parameter), number = name.partition("."), bins(covariate, OTHER_BINS)
    problem, at, ends, values = fitted.problem, fitted.index(name), list[float](), list[Estimate]()
    for step in (0, int(number.max())):
        mine = number == step
        found = fit_without(problem, fitted.values, ~mine)
        std = np.sqrt(np.diag(inverse_information(found.jacobian)))[np.count_nonzero(problem.free[:at])]
        ends.append(float(covariate.values[mine].mean()))
        values.append(
            Estimate.normal(float(problem.full(found.values)[at]), float(std), fitted.parameters[at].unit)
        )
    return Varying(effect, parameter, along, (ends[0], ends[1]), (values[0], values[1]))
