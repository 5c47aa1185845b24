"""Models against measurements: the error in and out of sample, and how well the presses repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.diagnosis.score_test import Scored, effect_directions, score_test
from calibration.effects import get_effect
from calibration.fit.least_squares import Fit, fit
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.checks import clear_of_touch, usable
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import SILICONE_NU, FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import Effect
from calibration.repeats.repeat_noise import refit_with_pure_noise
from calibration.result.poisson_routes import informed
from calibration.tasks.fit_errors import fit_errors
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.records import Estimate, Pair


@dataclass(frozen=True, slots=True)
class Compared:
    """One model: its effects in the order added, parameters, and rms errors in N.

    `percent` is of the largest force, `um` at the median slope of force against depth; `covariates` the residual's
    dependence on everything recorded, the most telling first.
    """

    name: str
    effects: tuple[str, ...]
    parameters: tuple[tuple[str, Estimate], ...]
    rms_N: float
    held_out_N: float
    repeatability_N: float
    percent: float
    um: float
    chi2: float
    covariates: tuple[Scored, ...]
    fitted: Fit

    def as_json(self, before: Compared | None = None) -> dict[str, Any]:
        """One entry of comparison.json; `before` is the base model that the errors are held against."""
        base = before or self
        return {
            "name": self.name,
            "effects": list(self.effects),
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters},
            "rms_error_N": {
                "before": base.rms_N,
                "after": self.rms_N,
                "held_out_before": base.held_out_N,
                "held_out_after": self.held_out_N,
                "floor": self.repeatability_N,
                "in_sample": self.rms_N,
                "held_out": self.held_out_N,
            },
            "rms_error_percent": self.percent,
            "rms_error_um": self.um,
            "chi2": self.chi2,
            "covariates": [{"name": c.key, "p_adjusted": c.p_adjusted} for c in self.covariates],
        }


@dataclass(frozen=True, slots=True)
class Comparison:
    """Models in the order in which effects were added, on the same measurements.

    `left_out` the effects that could not be added to those before, and why.
    """

    models: tuple[Compared, ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> list[dict[str, Any]]:
        """The content of comparison.json."""
        return [model.as_json(self.models[0]) for model in self.models]


def compare(
    data: Observations,
    effects: Sequence[Effect | str],
    *,
    rng: np.random.Generator,
    bulge: Estimate | None = None,
    bound: Pair | None = SILICONE_NU,
) -> Comparison:
    """The base law, then with each effect added on top of those before.

    An effect that these data cannot show, that fails or that finds no minimum is passed over, named in `left_out`,
    and the next one is added without it. `bulge`: nu from the rise beside the punch, held within `bound`.
    Raises InputError for unusable data.
    """
    data = informed(clear_of_touch(usable(data)), bulge, bound=bound)
    model = base_model(data)
    found = [judge(fit_alone(model, data), rng)]
    left_out = []
    for added in effects:
        effect = get_effect(added) if isinstance(added, str) else added
        if why := effect_directions(found[0].fitted, [effect])[1].get(effect.key):
            left_out.append((effect.key, why))
            continue
        larger = model + effect
        try:
            one = evaluate(larger, data, rng=rng)
        except Exception as fault:  # a private effect may raise anything; the next one may still do
            left_out.append((effect.key, str(fault) or type(fault).__name__))
            continue
        found.append(replace(one, effects=(*found[-1].effects, effect.key)))
        model = larger
    return Comparison(tuple(found), tuple(left_out))


def fit_alone(model: Model, data: Observations) -> Fit:
    """The model that others are held against, with the noise of the repeats. Raises InputError if it fails."""
    try:
        return refit_with_pure_noise(fit(model, data))
    except (ConvergenceError, ArithmeticError, RuntimeError) as fault:
        raise InputError(
            f"this model cannot be fitted to these measurements: {fault}",
            where=model.name,
            remedy="Look at depth and force in a figure; leave out the effects added by hand.",
        ) from fault


def base_model(data: Observations) -> Model:
    """The flat punch with nu free where several radii may fix it and nothing else is known of it."""
    several = np.unique(data.presses.radius_mm).size > 1
    return Model(FlatPunch(free_poisson_ratio=several and data.gel.poisson_ratio is None))


def evaluate(model: Model, data: Observations, *, rng: np.random.Generator) -> Compared:
    """Fit one model and look at what it leaves."""
    return judge(refit_with_pure_noise(fit(model, data)), rng)


def judge(fitted: Fit, rng: np.random.Generator) -> Compared:
    """What a fit leaves, in and out of sample."""
    data = fitted.data
    residual, errors = score_test(fitted, (), rng=rng), fit_errors(fitted)
    slope = float(np.median(np.abs(fitted.about.slope_N_per_mm[data.depth_mm > 0])))
    keys = tuple(k for k in fitted.model.keys if k not in TOLERANCES)
    return Compared(
        name=" + ".join((fitted.model.law.key, *keys)),
        effects=keys,
        parameters=tuple((p.name, fitted.estimate(p.name)) for p in fitted.parameters),
        rms_N=errors.rms_N,
        held_out_N=errors.held_out_N,
        repeatability_N=errors.repeatability_N,
        percent=100 * fitted.rms_error_N / float(np.max(data.normal_N)),
        um=1e3 * fitted.rms_error_N / slope,
        chi2=fitted.chi2,
        covariates=residual.covariates,
        fitted=fitted,
    )
