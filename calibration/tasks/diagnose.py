"""Find the cause of a misfit: missing effects, indistinguishable effects, next measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from calibration.diagnosis import decision, refit
from calibration.diagnosis.adequacy import over_bend, widened
from calibration.diagnosis.covariates import change_point
from calibration.diagnosis.decision import Outcome
from calibration.diagnosis.diagnosis import (
    Added,
    Diagnosis,
    Errors,
    Fits,
    MaterialChange,
    OddPresses,
    SearchRecord,
    UnexplainedMisfit,
)
from calibration.diagnosis.experiment_design import plan_next, press_again
from calibration.diagnosis.forward_selection import Step, forward_selection
from calibration.diagnosis.press_contrast import press_contrast
from calibration.diagnosis.refit import CANNOT_FIT, Candidate, held_out_rms, refit_with
from calibration.diagnosis.score_test import effect_directions
from calibration.diagnosis.sensitivity import UndetectedEffect, average_models, limits
from calibration.diagnosis.unexplained import describe, nearest
from calibration.diagnosis.vision_depth_check import fit_vision_depth, in_picture, risen
from calibration.effects import effects_for
from calibration.fit.identifiability import holding
from calibration.fit.least_squares import Fit
from calibration.fit.repeats import LEVEL, repeatability_rms
from calibration.inputs.checks import clear_of_touch, usable
from calibration.inputs.deadline import UNWATCHED, Watch
from calibration.inputs.depth_path import in_phase
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import SILICONE_NU
from calibration.model.stages import Effect
from calibration.result.material import determine_material, material_by_routes
from calibration.result.poisson_routes import informed, of_bulge, of_prior, tightest
from calibration.result.result import CalibrationResult
from calibration.tasks.compare import base_fit, base_model, fit_added, fit_alone, with_stated_noise
from tactilevision.records.measured import Estimate, Pair


def _over_candidates(
    after: CalibrationResult, force: Outcome, own: Sequence[Mapping[str, Fit]], others: Sequence[float]
) -> CalibrationResult:
    """Widen E's interval to that of each candidate's `own` fit, to what is significant but not named, to `others`.

    Where nothing is named E may be that of any effect that was significant at first; else of one that is
    significant on the last fit but was not confirmed on presses held out. `others`: factors of E.
    """
    searched, factors = force.searched, list(others)
    if force.unknown:
        base, turn = searched.base, searched.rounds[0]
        found = [c for c in turn.candidates if turn.scored[c.effect.key].p_adjusted < LEVEL]
    else:
        base, turn = searched.current, searched.rounds[-1]
        found = [
            c for c in turn.candidates
            if turn.scored[c.effect.key].p_adjusted < LEVEL and refit.inside(c) and c.cost < base.chi2
            and c.model.without(c.effect.key).keys == base.model.keys
        ]  # fmt: skip
    factors += [c.modulus_MPa / base.model.modulus(base.values) for c in found]
    fits = list[tuple[Fit, float]]()  # and E by the steps that followed
    for step, each in zip(force.steps, own, strict=True):
        later = _modulus(force.fitted) / _modulus(step.fitted)
        fits += [(one, later) for one in each.values() if one is not step.fitted]
    for one in (c for c in found if c.effect.freed() != c.effect):  # a prior may be what is wrong
        with suppress(*CANNOT_FIT):
            fits.append((refit.own_fit(turn.about, one), 1.0))
    E = after.youngs_modulus
    for fitted, later in fits:
        if (interval := determine_material(fitted).youngs_modulus.interval95) is not None:
            E = holding(E, (interval[0] * later, interval[1] * later))
    said = "E's interval includes the values of E under other effects that these data do not exclude"
    held = replace(after, youngs_modulus=E)
    return widened(held if after.youngs_modulus == E else held.noted(said), factors, said)


def _modulus(fitted: Fit) -> float:
    return fitted.model.modulus(fitted.values)


def _over_rise(after: CalibrationResult, sight: Outcome) -> CalibrationResult:
    """Widen E's interval to what it would be if the certified depth did not allow for the gel's rise."""
    share = max((risen(c, sight.fitted.data) for s in sight.sets for c in s), default=0.0)
    said = f"if the bevel met the gel early, depths are {100 * share:.1f} % too large and E that much too small"
    return widened(after, [1 / (1 - share)] if share > 0 else [], said)


# From a misfit to its cause: what is missing from the model, what cannot be distinguished, what to measure next.
#
#     testable? -> base model -> search (test, refit, confirm, add) -> is anything left? -> does it matter?
#
# Forces are searched, and the picture's depth where there is a certified one; `decision.decide` has the rule.

POINTS_ALONE = "curves_not_used"  # of presses that a camera saw
WHY_POINTS = (
    "only certified points are used: along the ramp the depth is the picture's, which walls put off by percent, "
    "so effects of time and history within a press are not tested"
)
NOT_TRUSTED = "something unexplained is in these data: E may be off by more than its interval says"
FEW = 0.1  # share of the presses that may be set aside


def diagnose(
    data: Observations,
    rng: np.random.Generator,
    *,
    effects: Sequence[Effect] = (),
    known: Sequence[Effect] = (),
    bulge: Estimate | None = None,
    bound: Pair | None = SILICONE_NU,
    watch: Watch = UNWATCHED,
) -> Diagnosis:
    """Diagnose measurements with the catalogue and the private `effects`; `known` ones are always in the model.

    `bulge`: nu from the rise outside the contact, held within `bound`; forces are fitted with it, the picture's
    depth without. A candidate that cannot be fitted is passed over. Once the time of `watch` is over nothing new
    is tested: the answer is the best so far, `stopped`. Raises InputError where no law can be fitted.
    """
    data = clear_of_touch(in_phase(usable(data)))
    catalogue = [*effects_for(data), *effects]
    diagnosed = partial(
        _diagnosed, catalogue=catalogue, known=known, rng=rng, bulge=bulge, bound=bound, watch=watch
    )
    found = whole = diagnosed(data)
    aside, foreign = tuple[str, ...](), False
    while (
        not watch.over and (odd := found.presses.odd).presses and len(aside) + len(odd.presses) <= FEW * data.count
    ):
        aside, foreign = (*aside, *odd.presses), foreign or odd.foreign
        others = ~np.isin(np.array(data.presses.label), aside)
        found = diagnosed(data.take(others))
    return _beside(whole, found, aside, foreign=foreign) if aside and not found.presses.odd.presses else whole


def _diagnosed(
    data: Observations,
    *,
    catalogue: Sequence[Effect],
    known: Sequence[Effect],
    rng: np.random.Generator,
    bulge: Estimate | None,
    bound: Pair | None,
    watch: Watch,
) -> Diagnosis:
    """Diagnose these presses, without setting any aside."""
    seen = fit_vision_depth(data)
    source = tightest((*of_bulge(bulge), *of_prior(data.gel, bulge=bulge, bound=bound)))  # of nu
    data = informed(data, bulge, bound=bound)
    watch.tell("fitting the base model")
    model = base_model(data, bound=bound)
    added, compared = list[Effect](), base_fit(model, data)
    for effect in known:
        of_picture = None if seen is None else _of_picture(effect, seen, data)
        if of_picture is None:
            model = model + effect
            added.append(effect)
        else:
            seen = of_picture
    level = LEVEL if seen is None else LEVEL / 2
    begin = base_fit(model, data) if added else compared  # at its minimum, as the tests require
    for effect in added:
        compared = fit_added(compared.model + effect, compared)
    found_there = forward_selection(begin, catalogue, rng=rng, level=level, of_rig=True, watch=watch)
    force = decision.outcome(found_there, level, decision.odd_presses(found_there, level))
    sight = None
    if seen is not None:
        others = [one for one in in_picture(seen.data) if one.key not in seen.model.keys]
        sight = decision.outcome(forward_selection(seen, others, rng=rng, level=level, watch=watch), level)
    watch.tell("what it does to the material")
    found = _determine(_as_compared(force, compared), sight, catalogue, rng, base=compared)
    before, after = (_sourced(one, source) for one in (found.material.before, found.material.after))
    return replace(found, material=replace(found.material, before=before, after=after))


def _as_compared(force: Outcome, base: Fit) -> Outcome:
    """Return the same steps, fitted on `base` as `compare` does: values and errors are those of `compare`."""
    searched, steps = force.searched, list[Step]()
    on = base if searched.start is searched.base else searched.start
    for step in force.steps:
        own = next(effect for effect in step.fitted.model.effects if effect.key == step.best.effect.key)
        with suppress(*CANNOT_FIT):
            step = replace(step, fitted=fit_added(on.model + own, on))
        on = step.fitted
        steps.append(step)
    return replace(force, steps=tuple(steps))


def _sourced(result: CalibrationResult, source: str) -> CalibrationResult:
    """Return the result with the source of nu, which the fit takes for stated."""
    known = result.poisson_ratio_source == "prior" and result.poisson_ratio.value is not None
    return replace(result, poisson_ratio_source=source) if known else result


def _of_picture(effect: Effect, seen: Fit, data: Observations) -> Fit | None:
    """Return the law of the picture's depth with a known effect in it; None where it is one of the force."""
    shown = {one.key: one for one in in_picture(seen.data)}.get(effect.key)
    if shown is None or not effect_directions(fit_alone(base_model(data), data), [effect])[1]:
        return None
    return refit.adopt(seen, refit_with(seen, shown))


def _beside(whole: Diagnosis, rest: Diagnosis, aside: tuple[str, ...], *, foreign: bool) -> Diagnosis:
    """Return the diagnosis of the rest, with the presses that were set aside; a foreign one makes it UNKNOWN."""
    odd = replace(rest.presses.odd, presses=aside, foreign=foreign)
    plans = {plan.action: plan for plan in (*press_again(odd), *rest.measure_next)}
    return replace(
        rest,
        verdict="UNKNOWN" if foreign else rest.verdict,
        presses=replace(rest.presses, odd=odd, set_aside=aside, without=rest.verdict),
        fits=replace(rest.fits, whole=whole.fits.fitted),
        flags=("press_stands_out", *rest.flags),
        measure_next=tuple(plans.values()),
    )


def _determine(
    force: Outcome, sight: Outcome | None, catalogue: Sequence[Effect], rng: np.random.Generator, *, base: Fit
) -> Diagnosis:
    """Return the diagnosis that the two searches end in; `base` is the model that they began with, as compared."""
    fitted = base if force.fitted is force.searched.base else force.fitted
    steps = (base, *(step.fitted for step in force.steps))
    before = material_by_routes(base)
    alone = concluded(fitted, before if fitted is base else material_by_routes(fitted))
    both = [force] if sight is None else [force, sight]
    flags = list(dict.fromkeys([*alone.flags, *(flag for one in both for flag in one.flags)]))
    sets = [s for one in both for s in one.sets]
    suspects = decision.instead_of_beta() if decision.STRANGE_BETA & set(flags) else ()
    explained, instead = decision.would_have_to_be(base, suspects), _refitted(base, suspects)
    moduli = [*(one.youngs_modulus_MPa for one in explained), *(float(one.values[0]) for one in instead)]
    shares = [modulus / float(base.values[0]) for modulus in moduli]
    own = [step.own_fits() for step in force.steps]
    after, unseen = _material(alone, (force, sight), catalogue, own, shares)
    flags += [f"{s.best.effect.key}_beyond_prior" for s in force.steps if _beyond_prior(fitted, s.best.effect.key)]
    keys = [*(c.effect.key for s in sets for c in s), *(effect.key for effect in (suspects if explained else ()))]
    candidates = tuple(dict.fromkeys(keys))
    missing, visible = _testable(both)
    looked = _looked_for(catalogue, sight)
    left = describe(force.searched.current, force.searched.last.covariates) if force.unknown else None
    small = limits(fitted, looked, candidates=candidates, missing=missing, visible=visible)
    bias = small.possible_bias
    zones = {e.key for e in catalogue if e.searched > 1 and "x" in e.seen_in}
    local = force.unknown or zones & set(candidates)
    contrast = press_contrast(base, force.searched.first.covariates, level=LEVEL) if local else None
    again = press_again(force.odd, contrast)
    open_sets = [tuple(Candidate.of_fit(*one) for one in fits.items()) for fits in own]
    of_picture = [] if sight is None else [sight.sets]
    next_best = plan_next(base, [open_sets, *of_picture], again=again, left=left, instead=instead, bias=bias)
    return Diagnosis(
        verdict=decision.decide(both, flags),
        effects=tuple(_added(one.fitted, step) for one in both for step in one.steps),
        candidates=candidates,
        flags=tuple(flags),
        stopped=any(one.searched.stopped for one in both),
        errors=_errors(base, fitted, steps),
        material=MaterialChange(before, after, unseen, after.undiagnosed_MPa),
        search=SearchRecord(
            score_test=force.searched.first.effects,
            covariates_before=force.searched.first.covariates,
            covariates=force.searched.last.covariates,
            lack_of_fit_p=min(one.left for one in both),
            tried=tuple(key for one in both for key in one.tried),
            sight=None if sight is None else sight.searched,
        ),
        remainder=UnexplainedMisfit(
            left=left,
            left_over=force.remainder,
            nearest=next((nearest(one.searched) for one in both if one.unknown), None),
            change_point=change_point(fitted, rng) if force.unknown else None,
            would_have_to_be=explained,
            varying=tuple(varying for one in both for varying in one.varying),
        ),
        presses=OddPresses(force.odd, contrast=contrast),
        limits=small,
        measure_next=next_best,
        fits=Fits(base, fitted, steps),
    )


def concluded(fitted: Fit, result: CalibrationResult) -> CalibrationResult:
    """Return the material of the last fit, with warnings of curves not used and of a stated noise far off."""
    if fitted.data.reconstructed_mm is not None and not fitted.data.is_curves:
        result = result.noted(WHY_POINTS, flags=[POINTS_ALONE])
    return with_stated_noise(result, fitted)


def _material(
    alone: CalibrationResult,
    both: tuple[Outcome, Outcome | None],
    catalogue: Sequence[Effect],
    own: Sequence[Mapping[str, Fit]],
    shares: Sequence[float],
) -> tuple[CalibrationResult, tuple[UndetectedEffect, ...]]:
    """Return the last fit's material `alone`, with E's interval over each candidate and over unseen effects."""
    force, sight = both
    remarks = [NOT_TRUSTED] if force.unknown else [force.remainder.sentence] if force.remainder else []
    averaged, unseen = average_models(alone.youngs_modulus, force.fitted, effects=catalogue)
    after = over_bend(_over_candidates(alone, force, own, shares), force.searched)
    reached = holding(after.youngs_modulus, averaged.interval95)
    alone_MPa = alone.youngs_modulus.interval95
    after = replace(after, youngs_modulus=reached, undiagnosed_MPa=alone_MPa).noted(*remarks)
    return (after if sight is None else _over_rise(after, sight)), unseen


def _testable(both: Sequence[Outcome]) -> tuple[dict[str, str], dict[str, float]]:
    """Return what neither search could test and why, and the minimum detectable size of the others."""
    first = [one.searched.first for one in both]
    # the last round as well: a bend or an effect in the model hides some more
    looks = [one.searched.rounds[k].score_test for one in both for k in (0, -1)]
    visible = {key: size for score_test in looks for key, size in score_test.visible.items()}
    looked = {key for score_test in first for key in score_test.visible if key not in score_test.not_testable}
    missing = {
        key: why for score_test in first for key, why in score_test.not_testable.items() if key not in looked
    }
    return missing, visible


def _looked_for(catalogue: Sequence[Effect], sight: Outcome | None) -> list[Effect]:
    """Return the catalogue, effects of the picture as they were tested there, where units may differ."""
    seen = () if sight is None else in_picture(sight.searched.base.data)
    return list({e.key: e for e in (*catalogue, *(one.inner for one in seen))}.values())


def _beyond_prior(fitted: Fit, key: str) -> bool:
    """Return whether an effect's value lies more than three std from its prior."""
    return any(
        abs(value - p.prior.mean) > refit.TOLD_APART * p.prior.std
        for value, p in zip(fitted.values, fitted.parameters, strict=True)
        if p.prior is not None and p.name.startswith(f"{key}.")
    )


def _added(fitted: Fit, step: Step) -> Added:
    key = step.best.effect.key
    values = tuple((p.name, fitted.estimate(f"{key}.{p.name}")) for p in step.best.effect.parameters)
    return Added(key, values, step.scored.p_adjusted, step.skill)


def _errors(base: Fit, last: Fit, steps: Sequence[Fit]) -> Errors:
    rms, held_out = (base.rms_error_N, last.rms_error_N), (held_out_rms(base), held_out_rms(last))
    return Errors(*rms, *held_out, repeatability_rms(last), tuple(map(held_out_rms, steps)))


def _refitted(base: Fit, effects: Sequence[Effect]) -> Sequence[Candidate]:
    """Return these effects fitted on the base, without their priors: the stated thickness is itself in doubt."""
    found = []
    for effect in effects:
        if effect.key not in base.model.keys:
            with suppress(*CANNOT_FIT):
                found.append(refit_with(base, effect.freed()))
    return found
