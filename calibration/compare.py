"""Models against measurements: the error in and out of sample, beside the floor that repeats set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.checks import check, of_shape
from calibration.data import Observations
from calibration.effects import get_effect
from calibration.fitting import Fit, fit
from calibration.laws.flat_punch import FlatPunch
from calibration.model import Model
from calibration.refit import hold_out, press_folds
from calibration.repeats import noise_floor
from calibration.screen import Scored, refit_with_pure_noise, screen
from calibration.stages import Effect
from calibration.tolerances import DIMENSIONS, HEIGHTS
from tactilevision.records import Estimate


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
    floor_N: float
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
                "floor": self.floor_N,
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
    """Models in the order in which effects were added, on the same measurements."""

    models: tuple[Compared, ...]

    def as_json(self) -> list[dict[str, Any]]:
        """The content of comparison.json."""
        return [model.as_json(self.models[0]) for model in self.models]


def compare(data: Observations, effects: Sequence[Effect | str], rng: np.random.Generator) -> Comparison:
    """The base law, then with each effect added on top of those before. Raises InputError for unusable data."""
    data = of_shape(data)
    check(data)
    model = base_model(data)
    found = [evaluate(model, data, rng)]
    for effect in effects:
        model = model + (get_effect(effect) if isinstance(effect, str) else effect)
        found.append(evaluate(model, data, rng))
    return Comparison(tuple(found))


def base_model(data: Observations) -> Model:
    """The flat punch with nu free where several radii may fix it and nothing else is known of it."""
    several = np.unique(data.presses.radius_mm).size > 1
    return Model(FlatPunch(free_poisson_ratio=several and data.gel.poisson_ratio is None))


def evaluate(model: Model, data: Observations, rng: np.random.Generator) -> Compared:
    """Fit one model and look at what it leaves."""
    return judge(refit_with_pure_noise(fit(model, data)), rng)


def judge(fitted: Fit, rng: np.random.Generator) -> Compared:
    """What a fit leaves, in and out of sample."""
    data = fitted.data
    left = screen(fitted, (), rng)
    out = (
        hold_out(fitted.model, fitted, fitted.values, press_folds(data)).rms_N if data.count > 2 else float("nan")
    )
    slope = float(np.median(np.abs(fitted.about.slope_N_per_mm[data.depth_mm > 0])))
    keys = tuple(k for k in fitted.model.keys if k not in (HEIGHTS, DIMENSIONS))
    return Compared(
        name=" + ".join((fitted.model.law.key, *keys)), effects=keys,
        parameters=tuple((p.name, fitted.estimate(p.name)) for p in fitted.parameters),
        rms_N=fitted.rms_error_N, held_out_N=out, floor_N=noise_floor(fitted),
        percent=100 * fitted.rms_error_N / float(np.max(data.normal_N)), um=1e3 * fitted.rms_error_N / slope,
        chi2=fitted.chi2, covariates=left.covariates, fitted=fitted,
    )  # fmt: skip
