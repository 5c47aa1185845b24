"""Profile likelihood of one parameter: how much worse the fit becomes as it is held elsewhere.

    D(theta) = min chi^2(theta, all others) - min chi^2

under the noise of the fit. D is computed at a few nodes with its slope there, by the envelope theorem the partial
derivative of chi^2, and follows a cubic between them. It stays valid where the minimum lies at the end of the
range: the interval is then one-sided. Source: Wilks, Ann. Math. Stat. 9 (1938) 60.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.least_squares import QUICK, Fit, Problem, quantile95, unexplained
from calibration.fit.repeats import allow_for_indenters
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Floats, Pair

NODES_STD = (-8.0, -2.0, 2.0, 8.0)  # std from the minimum at which D is computed, and at the ends of the range
STEP = 1e-3  # of a parameter's scale, for the slope


@dataclass(frozen=True, slots=True)
class Profile:
    """D at `nodes` (k,) in rising order and its `slope` there, per unit of the parameter; 0 at `best`.

    D is divided so that 95 % lie below Z95^2 for any degrees of freedom of the noise.
    """

    best: float
    nodes: Floats
    deviance: Floats
    slope: Floats

    def __call__(self, values: Floats) -> Floats:
        """Return D at values (n,); beyond the range that of its end."""
        from scipy.interpolate import CubicHermiteSpline

        inside = np.clip(values, self.nodes[0], self.nodes[-1])
        return np.maximum(CubicHermiteSpline(self.nodes, self.deviance, self.slope)(inside), 0.0)

    @property
    def interval95(self) -> Pair:
        """Values with D below Z95^2, up to the ends of the range."""
        from scipy.optimize import brentq

        def drop(value: float) -> float:
            return float(self(np.array([value]))[0]) - Z95**2

        low, high = (
            float(end) if drop(end) <= 0 else float(brentq(drop, self.best, end)) for end in self.nodes[[0, -1]]
        )
        return low, high


def profile(fitted: Fit, name: str) -> Profile:
    """Return the profile likelihood of a parameter over its bounds, from the fit in which it is free."""
    k, problem = fitted.index(name), fitted.problem
    parameter, best, std = fitted.parameters[k], float(fitted.values[k]), fitted.std(name)
    low, high = parameter.bounds
    nodes = np.unique([low, best, high, *np.clip(best + std * np.array(NODES_STD), low, high)])
    step = STEP * parameter.scale

    def held(value: float) -> Problem:
        fixed = replace(parameter, default=value, bounds=(value, value))
        return replace(problem, parameters=(*problem.parameters[:k], fixed, *problem.parameters[k + 1 :]))

    found = dict[float, Pair]()
    for side in (nodes[nodes <= best][::-1], nodes[nodes >= best]):
        values = fitted.values
        for node in side.tolist():
            least = held(node).solve(values[None], tolerance=QUICK)
            values, ahead = held(node).full(least.values), step if node + step <= high else -step
            change = (held(node + ahead).residual(least.values) - least.residual) / ahead
            # the part that the others cannot follow, since they are at their minimum to first order only
            found[node] = (least.chi2, 2 * float(least.residual @ unexplained(least.jacobian, change)))
    wide = allow_for_indenters(fitted)
    trust = (Z95 * std / (quantile95(wide.noise.dof) * wide.std(name))) ** 2
    deviance, slope = trust * np.array([found[node] for node in nodes.tolist()]).T
    return Profile(best, nodes, deviance - np.min(deviance), slope)
