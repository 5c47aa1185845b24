"""A beta that theory does not allow: what else would have to be true, and how straight it would leave the line.

beta is held at a value that theory gives, and each candidate's own parameter is fitted in its place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.data import Observations
from calibration.effects import get_effect
from calibration.fitting import Fit, Problem
from calibration.noise import Whitener
from tactilevision.records import Floats

CANDIDATES = ("thickness", "edge_fillet", "depth_zero", "stiffening")
THEORY_BETA = 0.85  # a neo-Hookean gel that sticks, nu from .45 to .495, a/h near .83


@dataclass(frozen=True, slots=True)
class WouldHaveToBe:
    """One candidate: its first parameter, what it would have to be, and R^2 of P/w against w/h that it leaves."""

    key: str
    parameter: str
    unit: str
    value: float
    r_squared: float
    rms_error_N: float

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {"key": self.key, "parameter": self.parameter, "unit": self.unit, "value": self.value,
                "r_squared": self.r_squared, "rms_error_N": self.rms_error_N}  # fmt: skip


def would_have_to_be(fitted: Fit, *, beta: float = THEORY_BETA) -> tuple[WouldHaveToBe, ...]:
    """Every candidate, the one that leaves the least error first."""
    found = [_candidate(fitted, key, beta) for key in CANDIDATES if key not in fitted.model.keys]
    return tuple(sorted(found, key=lambda c: c.rms_error_N))


def _candidate(fitted: Fit, key: str, beta: float) -> WouldHaveToBe:
    effect, data = get_effect(key), fitted.data
    model = fitted.model + effect
    table = tuple(
        replace(p, default=beta, bounds=(beta, beta)) if p.name.startswith("beta") else p
        for p in model.parameters(data)
    )
    place = model.slices(data)[key]
    noise = replace(fitted.noise, scale=float(np.max(data.normal_N)) * 0.01, stated=False)
    whitener = Whitener(data, noise, replace(fitted.about, base_N=np.ones(data.size)))
    problem = Problem(model, data, table, whitener)
    starts = np.array([np.insert(fitted.values, place.start, start) for start in effect.starts(data)])
    values = problem.full(problem.solve(starts).values)
    force = model.predict(values, data)
    return WouldHaveToBe(
        key, effect.parameters[0].name, effect.parameters[0].unit, float(values[place.start]),
        straightness(data, force), float(np.sqrt(np.mean((data.normal_N - force) ** 2))),
    )  # fmt: skip


def straightness(data: Observations, force_N: Floats) -> float:
    """R^2 of the straight line through P/w against w/h of this force, over samples in the gel."""
    inside = data.depth_mm > 0.05 * np.max(data.depth_mm)
    strain = data.depth_mm[inside] / data.gel.thickness_mm
    per_depth = force_N[inside] / data.depth_mm[inside]
    line = np.polyval(np.polyfit(strain, per_depth, 1), strain)
    total = float(np.sum((per_depth - per_depth.mean()) ** 2))
    return 1 - float(np.sum((per_depth - line) ** 2)) / total if total > 0 else float("nan")
