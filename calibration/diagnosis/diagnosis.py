"""The outcome of a diagnosis as records that a page prints one after another, and its form on disk."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.diagnosis.constant_parameters import Varying
from calibration.diagnosis.decision import InadmissibleBeta
from calibration.diagnosis.experiment_design import NextMeasurement
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.press_contrast import PressContrast
from calibration.diagnosis.score_test import Scored
from calibration.diagnosis.sensitivity import Limits, UndetectedEffect
from calibration.diagnosis.unexplained import Remainder, Unexplained
from calibration.diagnosis.vision_depth_check import depth_ratio, unseen_beside
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import OutlyingPresses
from calibration.inputs.conditions import above_repeats
from calibration.result.result import CalibrationResult
from tactilevision.records.display import Displayed, Summary, figure, mN
from tactilevision.records.measured import Estimate, Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Added:
    """An effect in the model: its parameters, p adjusted for all tests, and its skill on presses held out."""

    key: str
    parameters: tuple[tuple[str, Estimate], ...]
    p_adjusted: float
    transfer_skill: float

    def as_json(self) -> dict[str, Any]:
        """Return one entry of `effects`."""
        return {
            "key": self.key,
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters},
            "p_adjusted": self.p_adjusted,
            "transfer_skill": self.transfer_skill,
        }


@dataclass(frozen=True, slots=True)
class Errors:
    """Rms errors in N of the base model and the last one, on fitted presses and on presses held out.

    `floor` is the repeatability of like presses; `held_out_N` the held-out error of the base model and after each
    effect of the force.
    """

    before: float
    after: float
    held_out_before: float
    held_out_after: float
    floor: float
    held_out_N: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class MaterialChange:
    """The material by the base model and by the last one.

    `unseen` are effects that E's interval allows for although nothing shows them; `alone_MPa` is that interval if
    none of them is there.
    """

    before: CalibrationResult
    after: CalibrationResult
    unseen: tuple[UndetectedEffect, ...] = ()
    alone_MPa: Pair | None = None

    @property
    def alone(self) -> CalibrationResult:
        """The material by the last model, E's interval as it is without a diagnosis."""
        return replace(self.after, youngs_modulus=replace(self.after.youngs_modulus, interval95=self.alone_MPa))


@dataclass(frozen=True, slots=True)
class SearchRecord:
    """What was tested.

    `score_test` has every testable effect's score on the base model; `covariates_before` and `covariates` what the
    residual of the base model and of the last one depends on; `lack_of_fit_p` the smallest p of the last model;
    `tried` what fitted best where the verdict is UNKNOWN; `sight` the search on the picture's depth against the
    certified one, where there are both.
    """

    score_test: tuple[Scored, ...]
    covariates_before: tuple[Scored, ...]
    covariates: tuple[Scored, ...]
    lack_of_fit_p: float
    tried: tuple[str, ...]
    sight: Searched | None = None


def _screen(scores: tuple[Scored, ...]) -> list[dict[str, Any]]:
    return [{"key": s.key, "p": s.p, "p_adjusted": s.p_adjusted} for s in scores]


def _sight(sight: Searched) -> dict[str, Any]:
    """Return the picture's depth against the certified one, in numbers."""
    ratio = depth_ratio(sight.base)
    return {
        "ratio_median": float(np.median(ratio)),
        "samples": ratio.size,
        "lack_of_fit_p": sight.last.lack_of_fit,
        "covariates": [c.as_json() for c in sight.first.covariates],
        "slope_and_azimuth": unseen_beside(sight.base.data) or "looked at",
        "screen": _screen(sight.first.effects),
    }


@dataclass(frozen=True, slots=True)
class Fits:
    """The fits of the base model and of the last one.

    `steps` are those of the base model and after each effect of the force; `whole` is the last fit before presses
    were set aside.
    """

    base: Fit
    fitted: Fit
    steps: tuple[Fit, ...]
    whole: Fit | None = None


@dataclass(frozen=True, slots=True)
class UnexplainedMisfit:
    """What no effect explains, and what could stand behind it.

    `left` describes the residual where the verdict is UNKNOWN, `left_over` what is significant of it whether it
    matters or not; `nearest` the effect that explains most of it, and its share; `change_point` the press from
    which on it is there; `would_have_to_be` what could cause a beta that theory does not allow; `varying`
    parameters of effects that are not constant where they have to be.
    """

    left: Unexplained | None = None
    left_over: Remainder | None = None
    nearest: tuple[str, float] | None = None
    change_point: str | None = None
    would_have_to_be: tuple[InadmissibleBeta, ...] = ()
    varying: tuple[Varying, ...] = ()


@dataclass(frozen=True, slots=True)
class OddPresses:
    """Presses unlike the others; those `set_aside`, and the verdict `without` them.

    `contrast`: presses that differ over a covariate, of an UNKNOWN or of a soft zone.
    """

    odd: OutlyingPresses = field(default_factory=OutlyingPresses)
    set_aside: tuple[str, ...] = ()
    without: str = ""
    contrast: PressContrast | None = None


@dataclass(frozen=True, slots=True, repr=False)
class Diagnosis(Displayed):
    """What a diagnosis found.

    `verdict` is that of `decision.decide`; `effects` are in the model, `candidates` those that these data cannot
    tell apart (one where the effect is identified); `stopped`: the time was over before the search was. The other
    records are what a page prints, in this order.
    """

    verdict: str
    effects: tuple[Added, ...]
    candidates: tuple[str, ...]
    flags: tuple[str, ...]
    stopped: bool
    errors: Errors
    material: MaterialChange
    search: SearchRecord
    remainder: UnexplainedMisfit
    presses: OddPresses
    limits: Limits
    measure_next: tuple[NextMeasurement, ...]
    fits: Fits

    def summary(self) -> Summary:
        """Return the verdict, the effects, the errors before and after, E, and what to measure next."""
        errors, after = self.errors, self.material.after
        pairs = [(errors.held_out_before, errors.held_out_after), (errors.before, errors.after)]
        before_N, after_N = pairs[0] if np.isfinite(pairs[0]).all() else pairs[1]
        values: dict[str, str | Estimate] = {
            "effects": ", ".join(one.key.replace("_", " ") for one in self.effects) or "none",
            "candidates": ", ".join(self.candidates).replace("_", " ") if len(self.candidates) > 1 else "",
            "error": f"{mN(before_N)} → {mN(after_N)}",
            "repeatability": mN(errors.floor),
            "E by the base model": self.material.before.youngs_modulus,
            "E": after.youngs_modulus,
            "ν": after.poisson_ratio,
            "measure next": self.measure_next[0].action if self.measure_next else "",
        }
        return Summary(f"Diagnosis: {self.verdict}", values, after.warnings)

    def plot_residuals(self) -> Figure:
        """Draw the residuals of the base model and of the last one against everything recorded."""
        return figure("plot_residuals", self)

    def plot_fall(self) -> Figure:
        """Draw the error of the base model and after each effect, next to the repeatability."""
        return figure("plot_fall", self)

    def as_json(self) -> dict[str, Any]:
        """Return the content of diagnosis.json."""
        search, rest, presses, limits = self.search, self.remainder, self.presses, self.limits
        errors, material, left = asdict(self.errors), self.material, rest.left
        errors |= above_repeats(self.fits.base.data, errors["held_out_before"], errors["held_out_after"])
        return {
            "verdict": self.verdict,
            "effects": [effect.as_json() for effect in self.effects],
            "candidates": list(self.candidates),
            "flags": list(self.flags),
            "stopped": self.stopped,
            "held_out_N": list(errors.pop("held_out_N")),
            "rms_error_N": errors,
            "material": {"before": material.before.as_json(), "after": material.after.as_json()},
            "unseen": {
                "interval95_of_E_without": material.alone_MPa and list(material.alone_MPa),
                "effects": [{"key": u.key, "chance": u.chance, "rms_bias_of_E": u.off} for u in material.unseen],
            },
            "screen": _screen(search.score_test),
            "covariates": [c.as_json() for c in search.covariates],
            "lack_of_fit_p": search.lack_of_fit_p,
            "tried": list(search.tried),
            "reconstructed_depth": search.sight and _sight(search.sight),
            "left": left and asdict(left),
            "left_over": rest.left_over and rest.left_over.as_json(),
            "not_constant": [one.as_json() for one in rest.varying],
            "nearest": rest.nearest and dict(zip(("key", "explains"), rest.nearest, strict=True)),
            "change_point": rest.change_point,
            "would_have_to_be": [asdict(one) for one in rest.would_have_to_be],
            "odd_presses": list(presses.odd.presses),
            "set_aside": {"presses": list(presses.set_aside), "verdict_without": presses.without or None},
            "press_contrast": presses.contrast and presses.contrast.as_json(),
            "presses_wander_with": [{"name": name, "p_adjusted": p} for name, p in presses.odd.wanders],
            "not_testable": [{"key": key, "why": why} for key, why in limits.not_testable.items()],
            "possible_bias_of_E": dict(limits.possible_bias),
            "smallest_visible": dict(limits.visible),
            "smallest_visible_unit": {k: limits.sizes[k].unit for k in limits.visible if k in limits.sizes},
            "bias_of_E_at_smallest_visible": dict(limits.below_visibility),
            "measure_next": [action.as_json() for action in self.measure_next],
            "noise": self.fits.fitted.noise.parts(self.fits.fitted.about.base_N),
        }
