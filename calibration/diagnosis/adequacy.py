"""Is the model of a calibration sufficient? One test of everything, and what each suspect makes of E.

    score test (`score_test`) -> the bend that theory allows -> refit of each suspect -> E's interval over all

It is the first look of a diagnosis: no effect is added and E's value stays. An effect or an odd press is a suspect
where it is significant and costs no more than the best one by AS_GOOD of chi^2 + 2 q, in units of the misfit that
the best one leaves, or by a tenth of its gain. The model is insufficient where a diagnosis would not end in
ADEQUATE: an effect is confirmed, or a residual matters (`decision.decide`). E's interval then reaches to that of a
fit with each suspect, its size free and without a prior; where nothing but covariates is significant, to what the
residual makes of E. Effects of a size that the test cannot see widen it as in a diagnosis (`average_models`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.diagnosis import decision, refit
from calibration.diagnosis.covariates import IN_WORDS
from calibration.diagnosis.forward_selection import Round, Searched, forward_selection
from calibration.diagnosis.refit import AS_GOOD, CANNOT_FIT, Candidate
from calibration.diagnosis.sensitivity import average_models
from calibration.diagnosis.unexplained import remainders
from calibration.effects import effects_for
from calibration.fit.identifiability import holding, identify
from calibration.fit.least_squares import Fit, fit, fit_again
from calibration.fit.outlying_presses import OutlyingPresses
from calibration.fit.repeats import LEVEL
from calibration.result.result import CalibrationResult, ModelTest, Suspect

INSUFFICIENT = "model_insufficient"  # the flag of a model that the test rejects
SEED = 0  # of the bootstrap: a result is the same on every run
NAMED = 3  # suspects named in a sentence


def with_model_test(result: CalibrationResult, fitted: Fit, *, command: str) -> CalibrationResult:
    """Return the result with the test of `fitted`; beyond the level flagged, and E's interval over the suspects.

    `fitted` has the noise of repeats (`judged`); `command` continues. Where it cannot be done the result stays.
    """
    if fitted.data.size <= np.count_nonzero(fitted.free):  # nothing is left to test
        return result
    catalogue = [effect.freed() for effect in effects_for(fitted.data)]  # what was stated of them is in doubt
    try:
        rng = np.random.default_rng(SEED)
        searched = forward_selection(fitted, catalogue, rng=rng, level=LEVEL, of_rig=True, quick=True)
    except CANNOT_FIT:
        return result
    turn, test = searched.rounds[-1], searched.rounds[-1].score_test
    if searched.start is not searched.base:
        E = holding(result.youngs_modulus, identify(searched.start).youngs_modulus.interval95)
        result = over_bend(replace(result, youngs_modulus=E).noted(flags=[decision.BEND]), searched)
    if test.family_p > LEVEL:
        return replace(result, model_test=ModelTest(test.family_p))
    odd = decision.odd_presses(searched, LEVEL).presses
    found = decision.outcome(searched, LEVEL, OutlyingPresses(odd))
    suspects = _suspects(turn)
    if not (found.unknown or found.steps):
        wide = widened(result, _factors(turn, suspects))
        return replace(wide, model_test=ModelTest(test.family_p))
    covariates = tuple(IN_WORDS.get(one.key, one.key) for one in test.covariates if one.p_adjusted <= LEVEL)
    said = [suspect_in_words(one) for one in suspects[:NAMED]]
    said += [f"{', '.join(odd)} unlike the other presses"] if odd else []
    said += [] if suspects else [f"a residual that depends on {name}" for name in covariates[:NAMED]]
    what = "; ".join(said) or "none that fits"
    warning = (
        f"the model does not explain these data (p = {test.family_p:.1g}). Largest suspects: {what}. E's interval "
        f"reaches to what each makes of E; its value may be wrong. To find the cause: {command}"
    )
    named = tuple(map(_as_suspect, suspects[:NAMED]))
    tested = ModelTest(test.family_p, named, covariates, odd, insufficient=True)
    wide = _over_suspects(result, searched, suspects, odd)
    return replace(wide, model_test=tested).noted(warning, flags=[INSUFFICIENT])


def _suspects(turn: Round) -> list[Candidate]:
    """Return the significant effects that explain the misfit about as well as the best."""
    found = [c for c in turn.candidates if turn.scored[c.effect.key].p_adjusted <= LEVEL]
    found = [c for c in found if c.effect.threshold or refit.inside(c)]
    better = sorted((c for c in found if c.cost < turn.about.chi2 - AS_GOOD), key=lambda c: c.cost)
    if not better:
        return []
    best = better[0]
    misfit = max(best.chi2 / max(turn.about.dof, 1.0), 1.0)
    room = max(AS_GOOD * misfit, refit.NEAR * (turn.about.chi2 - best.cost))
    return [c for c in better if c.cost <= best.cost + room]


def _over_suspects(
    result: CalibrationResult, searched: Searched, suspects: Sequence[Candidate], odd: Sequence[str]
) -> CalibrationResult:
    """Return the result with E's interval over that of each suspect's fit, of the fit without odd presses, and
    over undetected effects; where there are neither, over what the residual makes of E.
    """
    start, E = searched.start, result.youngs_modulus
    factors, fits = _factors(searched.rounds[-1], suspects), list[Fit]()
    for one in suspects[:NAMED]:
        with suppress(*CANNOT_FIT):
            fits.append(fit(one.model, start.data, noise=start.noise, starts=one.values[None], tolerances=False))
    if odd:
        with suppress(*CANNOT_FIT):
            fits.append(fit_again(start, data=start.data.take(~np.isin(np.array(start.data.presses.label), odd))))
    if not fits:
        offs = [one.E_off for one in remainders(start, searched.last, level=LEVEL)]
        factors += [1 + off for size in offs for off in (size, -size)]
    for own in fits:
        E = holding(E, identify(own).youngs_modulus.interval95)
    averaged, _ = average_models(result.youngs_modulus, start, effects=effects_for(start.data))
    return widened(replace(result, youngs_modulus=holding(E, averaged.interval95)), factors)


def _factors(turn: Round, suspects: Sequence[Candidate]) -> list[float]:
    """Return E with each suspect over E without."""
    return [float(c.values[0] / turn.about.values[0]) for c in suspects]


def suspect_in_words(one: Candidate) -> str:
    """Return what an effect is, with the fitted size of its first parameter."""
    effect, first = one.effect, one.effect.parameters[0]
    of, unit = (f"{first.name} ", "") if first.unit == "1" else ("", f" {first.unit}")
    return f"{effect.title} ({of}{one.own_values[0]:.2g}{unit})"


def _as_suspect(one: Candidate) -> Suspect:
    sizes = zip(one.effect.parameters, one.own_values, strict=True)
    return Suspect(one.effect.key, tuple((p.name, float(size), p.unit) for p, size in sizes), float(one.values[0]))


# E's interval, widened to what other explanations make of E; its value stays.


def widened(result: CalibrationResult, factors: Sequence[float], *warnings: str) -> CalibrationResult:
    """Return the result with E's interval reaching to E times each of `factors`, and the warnings."""
    E = result.youngs_modulus
    if not factors or E.interval95 is None:
        return result
    wide = (E.interval95[0] * min(1.0, *factors), E.interval95[1] * max(1.0, *factors))
    return replace(result, youngs_modulus=replace(E, interval95=wide)).noted(*warnings)


def over_bend(after: CalibrationResult, searched: Searched) -> CalibrationResult:
    """Widen E's interval to the effects that explain a bend within theory as well as theory does."""
    others = searched.bend_or
    if not others:
        return after
    key = max(others, key=lambda one: abs(np.log(others[one])))
    what, off = key.replace("_", " "), 100 * (others[key] - 1)
    said = f"what was taken for a bend that theory allows may be {what} as well: E is then {off:+.0f} %"
    return widened(after, list(others.values()), said)
