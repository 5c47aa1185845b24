"""The outcome of a diagnosis, and its form on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from calibration.diagnosis.experiment_design import NextMeasurement
from calibration.diagnosis.forward_selection import MAX_EFFECTS, Searched, Step
from calibration.diagnosis.inadmissible_beta import InadmissibleBeta
from calibration.diagnosis.model_averaging import UndetectedEffect
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.score_test import LEVEL, Scored
from calibration.diagnosis.unexplained import (
    AlternativeExplanation,
    Remainder,
    Unexplained,
    alternative_explanation,
    plain_errors,
    remainder,
)
from calibration.diagnosis.vision_depth_check import depth_ratio, unseen_beside
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import STANDS_OUT, WANDERS, OutlyingPresses, outlying_presses
from calibration.inputs.deadline import Watch
from calibration.model.stages import Parameter
from calibration.result.result import CalibrationResult
from tactilevision.records.measured import Estimate, Pair

# The outcome of a diagnosis, and its form on disk.

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


# What one search for effects ends in: what stands, what is left, and what plain error would do as well.

MOSTLY = 0.9  # of a misfit explained: an effect's form that is off by a third leaves a tenth of the squares
CURED = 0.5  # the same where frames are then read anew: the form need only name the cause, and is looked at again


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one search ends in: the steps that stand, what was tried where something is left or `otherwise` does as
    well, p of what is left, what it is, and the plain error nearest to it.
    """

    searched: Searched
    steps: tuple[Step, ...]
    tried: tuple[str, ...]
    left: float
    unknown: bool
    flags: tuple[str, ...]
    odd: OutlyingPresses = NOTHING_ODD
    remainder: Remainder | None = None
    alternative_explanation: AlternativeExplanation | None = None
    plain: Candidate | None = None

    @property
    def sets(self) -> list[tuple[Candidate, ...]]:
        """The candidates of each step that stands."""
        return [step.equals for step in self.steps]

    @property
    def fitted(self) -> Fit:
        """The last fit that stands."""
        return self.steps[-1].fitted if self.steps else self.searched.start


def odd_presses(searched: Searched, level: float) -> OutlyingPresses:
    """What is odd among the presses, as far as the test says so."""
    told = {s.key: s.p_adjusted for s in searched.last.others if s.p_adjusted <= level}
    wanders = [(key.removeprefix(WANDERS), p) for key, p in told.items() if key.startswith(WANDERS)]
    odd = outlying_presses(searched.current, wanders=wanders)
    return odd if STANDS_OUT in told else replace(odd, presses=(), foreign=False)


def outcome(searched: Searched, level: float, odd: OutlyingPresses = NOTHING_ODD) -> Outcome:
    """Whether the steps stand: not where they leave what matters and explain but a part, or are all used up."""
    left, steps = searched.last.lack_of_fit, searched.steps
    over = remainder(searched.current, searched.last, level=level) if left <= level else None
    flags = ["bend_within_theory"] if getattr(searched.current.model.law, "bent", False) else []
    flags += ["press_stands_out"] if odd.presses else []
    flags += ["presses_wander"] if odd.wanders else []
    flags += ["presses_scatter"] if odd.scattered else []
    if searched.stopped:
        so_far = tuple(c.effect.key for c in searched.rounds[-1].candidates)
        return Outcome(searched, steps, () if steps else so_far, left, not steps, tuple(flags), odd)
    flags += ["small_remainder"] if over else []
    enough = CURED if searched.to_be_cured else MOSTLY
    # its form is not exact
    mostly = 0 < len(steps) < MAX_EFFECTS and searched.explained > enough and not odd.wanders
    matters = over is not None and over.matters and not mostly
    if not (matters or odd.presses or (odd.scattered and not steps)):
        return Outcome(searched, steps, (), left, False, tuple(flags), replace(odd, wanders=()), over)
    tried = [s.best.effect.key for s in steps] or [s.key for s in searched.first.effects if s.p_adjusted < LEVEL]
    return Outcome(searched, (), tuple(tried), left, True, tuple(flags), odd, over)


def against_instrument_errors(force: Outcome, watch: Watch, *, level: float) -> Outcome:
    """With the plain error that does as well as what was named, which then stands no more, or better than what was
    tried.
    """
    if watch.over or not (force.steps or (force.unknown and not force.odd.presses)):
        return force
    watch.tell("holding plain errors of an instrument against it")
    plain = plain_errors(force.searched, watch.each)
    found = alternative_explanation(force.searched, plain, level=level)
    nothing = np.inf if force.searched.steps else force.searched.start.chi2
    helps = (one for one in plain if one.cost < nothing)
    nearest_of_all = next(helps, None) if found is not None or force.unknown else None
    if found is None:
        return replace(force, plain=nearest_of_all)
    tried = force.tried or found.instead_of
    return replace(force, steps=(), tried=tried, unknown=True, alternative_explanation=found, plain=nearest_of_all)
