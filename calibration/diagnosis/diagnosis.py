"""The outcome of a diagnosis, and its form on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from calibration.diagnosis.alternative_explanation import AlternativeExplanation
from calibration.diagnosis.experiment_design import NextMeasurement
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.inadmissible_beta import InadmissibleBeta
from calibration.diagnosis.model_averaging import UndetectedEffect
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.remainder import Remainder
from calibration.diagnosis.score_test import Scored
from calibration.diagnosis.unexplained import Unexplained
from calibration.diagnosis.vision_depth_check import depth_ratio, unseen_beside
from calibration.fit.least_squares import Fit
from calibration.model.parameters import Parameter
from calibration.repeats.outlying_presses import OutlyingPresses
from calibration.result.result import CalibrationResult
from tactilevision.records import Estimate, Pair

NOTHING_ODD = OutlyingPresses()


@dataclass(frozen=True, slots=True)
class Added:
    """An effect that was added: its parameters, p adjusted for all looks, and its skill on presses left out."""

    key: str
    parameters: tuple[tuple[str, Estimate], ...]
    p_adjusted: float
    transfer_skill: float

    def as_json(self) -> dict[str, Any]:
        """One entry of effects."""
        return {
            "key": self.key,
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters},
            "p_adjusted": self.p_adjusted,
            "transfer_skill": self.transfer_skill,
        }


@dataclass(frozen=True, slots=True)
class Errors:
    """Rms errors in N: of the base model and the last one, in and out of sample, and the repeats' own."""

    before: float
    after: float
    held_out_before: float
    held_out_after: float
    floor: float

    def as_json(self) -> dict[str, float]:
        """rms_error_N."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a diagnosis found.

    `candidates` the keys that these data cannot tell apart (one where the effect is identified); `screen` every
    testable effect's score on the base model; `visible` the amplitude of each that would have been seen, a size of
    the parameter in `sizes`;
    `covariates` what the last model's residual depends on; `would_have_to_be` what could stand for a beta that
    theory does not allow; `possible_bias` the relative error of E that each effect that cannot be tested would
    bring at a typical size, or at the end of its range where it shows only beyond; `below_visibility` the same of
    the others at the smallest size that would have shown; `tried` what fitted best where the verdict is UNKNOWN;
    `base` and `fitted` the fits before and after; `sight` the search on the
    picture's depth against the certified one, where there are both; `left` describes what nothing
    explains, where the verdict is UNKNOWN; `odd` what is odd among the presses themselves; `nearest` the effect
    that came nearest to it, and the share that it explains; `otherwise` the plain error outside the catalogue that
    does as well as what was named, or better than what was tried; `held_out` the held-out
    error in N of the base model and after each effect; `covariates_before` what the base model's residual depends
    on; `unseen` what E's interval allows for besides, and `alone_MPa` that interval if none of it is there;
    `set_aside` the odd presses without which all of this holds, `without` the verdict on the others, `whole` the
    fit of all; `plain` the plain error nearest to what no effect explains; `stopped` that the time was over before
    the search was; `left_over` what stands out of the last fit, whether it matters or not.
    """

    verdict: str
    effects: tuple[Added, ...]
    candidates: tuple[str, ...]
    not_testable: Mapping[str, str]
    visible: Mapping[str, float]
    errors: Errors
    before: CalibrationResult
    after: CalibrationResult
    covariates: tuple[Scored, ...]
    score_test: tuple[Scored, ...]
    measure_next: tuple[NextMeasurement, ...]
    change_point: str | None
    flags: tuple[str, ...]
    would_have_to_be: tuple[InadmissibleBeta, ...]
    lack_of_fit_p: float
    tried: tuple[str, ...]
    possible_bias: Mapping[str, float]
    base: Fit
    fitted: Fit
    sight: Searched | None = None
    left: Unexplained | None = None
    odd: OutlyingPresses = NOTHING_ODD
    nearest: tuple[str, float] | None = None
    held_out: tuple[float, ...] = ()
    covariates_before: tuple[Scored, ...] = ()
    below_visibility: Mapping[str, float] = field(default_factory=dict)
    unseen: tuple[UndetectedEffect, ...] = ()
    alone_MPa: Pair | None = None
    set_aside: tuple[str, ...] = ()
    without: str = ""
    whole: Fit | None = None
    sizes: Mapping[str, Parameter] = field(default_factory=dict)
    alternative_explanation: AlternativeExplanation | None = None
    left_over: Remainder | None = None
    plain: Candidate | None = None
    stopped: bool = False

    def as_json(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return {
            "verdict": self.verdict,
            "effects": [effect.as_json() for effect in self.effects],
            "candidates": list(self.candidates),
            "not_testable": [{"key": key, "why": why} for key, why in self.not_testable.items()],
            "rms_error_N": self.errors.as_json(),
            "material": {"before": self.before.as_json(), "after": self.after.as_json()},
            "covariates": [{"name": c.key, "p_adjusted": c.p_adjusted} for c in self.covariates],
            "measure_next": [action.as_json() for action in self.measure_next],
            "change_point": self.change_point,
            "flags": list(self.flags),
            "stopped": self.stopped,
            "nearest_plain_error": None if self.plain is None else self.plain.effect.key,
            "odd_presses": list(self.odd.presses),
            "set_aside": {"presses": list(self.set_aside), "verdict_without": self.without or None},
            "presses_wander_with": [{"name": name, "p_adjusted": p} for name, p in self.odd.wanders],
            "lack_of_fit_p": self.lack_of_fit_p,
            "nearest": None if self.nearest is None else {"key": self.nearest[0], "explains": self.nearest[1]},
            "tried": list(self.tried),
            "otherwise": None if self.alternative_explanation is None else self.alternative_explanation.as_json(),
            "left_over": None if self.left_over is None else self.left_over.as_json(),
            "left": None if self.left is None else self.left.as_json(),
            "possible_bias_of_E": dict(self.possible_bias),
            "unseen": self._unseen(),
            "bias_of_E_at_smallest_visible": dict(self.below_visibility),
            "screen": [{"key": s.key, "p": s.p, "p_adjusted": s.p_adjusted} for s in self.score_test],
            "smallest_visible": dict(self.visible),
            "smallest_visible_unit": {key: self.sizes[key].unit for key in self.visible if key in self.sizes},
            "would_have_to_be": [w.as_json() for w in self.would_have_to_be],
            "held_out_N": list(self.held_out),
            "reconstructed_depth": self._sight(),
            "noise": self.fitted.noise.parts(self.fitted.about.base_N),
        }

    def _unseen(self) -> dict[str, Any]:
        """What may be there without showing, and E's interval without it."""
        return {
            "interval95_of_E_without": None if self.alone_MPa is None else list(self.alone_MPa),
            "effects": [{"key": u.key, "chance": u.chance, "rms_bias_of_E": u.off} for u in self.unseen],
        }

    def _sight(self) -> dict[str, Any] | None:
        """The picture's depth against the certified one, in numbers."""
        if self.sight is None:
            return None
        ratio = depth_ratio(self.sight.base)
        return {
            "ratio_median": float(np.median(ratio)),
            "samples": ratio.size,
            "lack_of_fit_p": self.sight.last.lack_of_fit,
            "covariates": [{"name": c.key, "p_adjusted": c.p_adjusted} for c in self.sight.first.covariates],
            "slope_and_azimuth": unseen_beside(self.sight.base.data) or "looked at",
            "screen": [{"key": s.key, "p": s.p, "p_adjusted": s.p_adjusted} for s in self.sight.first.effects],
        }
