"""What could cause a beta that theory does not allow, and how straight it leaves the line of P/w over w/h.

beta is fixed at theory's value and each candidate's own parameter is fitted instead. Finite elements give .85 at
a/h = .833 (neo-Hookean, sticking); beta in units of the true thickness is proportional to a/h.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit, Problem, r_squared
from calibration.inputs.observations import Observations
from calibration.model.composition import Model
from calibration.model.stages import THICKNESS, Effect
from calibration.noise.model import Noise, Whitener
from tactilevision.records.measured import Floats

THEORY_BETA = 0.85  # beta of finite elements, neo-Hookean and sticking, at AT_RATIO
AT_RATIO = 2.5 / 3  # a/h at which THEORY_BETA was computed
MAX_ITERATIONS = 25  # rounds between a thickness and its beta


@dataclass(frozen=True, slots=True)
class InadmissibleBeta:
    """One candidate: the value that its first parameter would have to have, R^2 of P/w over w/h with it, and E."""

    key: str
    parameter: str
    unit: str
    value: float
    r_squared: float
    rms_error_N: float
    youngs_modulus_MPa: float


def instead_of_beta() -> tuple[Effect, ...]:
    """Return the effects that may look like an inadmissible beta, by their own rank."""
    ranked = {rank: effect for effect in EFFECTS.values() if (rank := effect.instead_of_beta)}
    return tuple(ranked[rank] for rank in sorted(ranked))


def would_have_to_be(fitted: Fit, suspects: Sequence[Effect]) -> tuple[InadmissibleBeta, ...]:
    """Return every suspect that can be fitted, the smallest error first."""
    found = []
    for effect in suspects:
        if effect.key not in fitted.model.keys:
            with suppress(*CANNOT_FIT):
                found.append(_candidate(fitted, effect))
    return tuple(sorted(found, key=lambda c: c.rms_error_N))


def theory_beta(radius_mm: float, thickness_mm: float) -> float:
    """Return beta of a sharp punch by finite elements, for this thickness."""
    return THEORY_BETA * (radius_mm / thickness_mm) / AT_RATIO


def _candidate(fitted: Fit, effect: Effect) -> InadmissibleBeta:
    key, data = effect.key, fitted.data
    rescaled = effect.condition == THICKNESS  # another thickness is another theory's beta
    model = fitted.model + effect
    place = model.slices(data)[key].start
    starts = np.array([np.insert(fitted.values, [place] * len(start), start) for start in effect.starts(data)])
    values, thickness = starts[0], data.gel.thickness_mm
    for _ in range(MAX_ITERATIONS if rescaled else 1):
        values = _with_theory(fitted, model, key, starts, thickness)
        if rescaled:
            fitted_mm = data.gel.thickness_mm * (1 + float(values[place]))
            thickness = float(np.sqrt(thickness * fitted_mm))  # the geometric mean converges
            starts = values[None]
    force = model.predict(values, data)
    first, rms = effect.parameters[0], float(np.sqrt(np.mean((data.normal_N - force) ** 2)))
    straight, value, modulus = straightness(data, force), float(values[place]), float(values[0])
    return InadmissibleBeta(key, first.name, first.unit, value, straight, rms, modulus)


def _with_theory(fitted: Fit, model: Model, key: str, starts: Floats, thickness_mm: float) -> Floats:
    """Return all values with each radius's beta at theory's, by least squares without a prior of the effect."""
    data = fitted.data
    radii = iter(np.unique(data.presses.radius_mm))
    table = []
    for parameter in model.parameters(data):
        if parameter.name.startswith("beta"):
            beta = theory_beta(float(next(radii)), thickness_mm)
            parameter = replace(parameter, default=beta, bounds=(beta, beta))
        elif parameter.name.startswith(f"{key}."):
            parameter = replace(parameter, prior=None)
        table.append(parameter)
    noise = Noise(0.01 * float(np.max(data.normal_N)), stated=False)
    whitener = Whitener(data, noise, replace(fitted.about, base_N=np.ones(data.size)))
    problem = Problem(model, data, tuple(table), whitener)
    return problem.full(problem.solve(starts).values)


def straightness(data: Observations, force_N: Floats) -> float:
    """Return R^2 of the line through P/w against w/h, for forces (N,) in N, over samples in the gel."""
    inside = data.depth_mm > 0.05 * np.max(data.depth_mm)
    strain = data.depth_mm[inside] / data.gel.thickness_mm
    per_depth = force_N[inside] / data.depth_mm[inside]
    return r_squared(per_depth, np.asarray(np.polyval(np.polyfit(strain, per_depth, 1), strain), dtype=float))
