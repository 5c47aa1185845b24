"""Find the cause of a misfit: missing effects, indistinguishable effects, next measurements."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from calibration.diagnosis.covariates import change_point
from calibration.diagnosis.diagnosis import (
    Added,
    Diagnosis,
    Errors,
    Outcome,
    against_instrument_errors,
    odd_presses,
    outcome,
)
from calibration.diagnosis.experiment_design import plan_next, press_again
from calibration.diagnosis.forward_selection import Searched, Step, forward_selection
from calibration.diagnosis.inadmissible_beta import InadmissibleBeta, instead_of_beta, would_have_to_be
from calibration.diagnosis.model_averaging import UndetectedEffect, average_models
from calibration.diagnosis.refit import (
    CANNOT_FIT,
    TOLD_APART,
    Candidate,
    adopt,
    freed,
    held_out_rms,
    inside,
    refit_with,
)
from calibration.diagnosis.score_test import LEVEL, effect_directions
from calibration.diagnosis.sensitivity import hidden
from calibration.diagnosis.unexplained import nearest, unexplained
from calibration.diagnosis.vision_depth_check import fit_vision_depth, in_picture, risen
from calibration.effects import EFFECTS
from calibration.fit.depth_noise import with_errors_in_depth
from calibration.fit.identifiability import holding
from calibration.fit.least_squares import Fit
from calibration.inputs.checks import clear_of_touch, usable
from calibration.inputs.deadline import UNWATCHED, Watch
from calibration.inputs.depth_path import in_phase
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import SILICONE_NU
from calibration.model.stages import Effect
from calibration.result.material import AT_BOUND, material_by_routes
from calibration.result.poisson_routes import informed, of_bulge, of_prior, tightest
from calibration.result.result import CalibrationResult
from calibration.tasks.compare import base_fit, base_model, fit_alone, fit_errors, with_stated_noise
from tactilevision.records.measured import Estimate, Pair

# How far E's interval reaches to what other explanations would make of E.
#
# Each names E with it over E of the fit that stands; the interval is stretched by that, its value stays.


def tried(searched: Searched) -> tuple[Candidate, ...]:
    """The base, then what screened beyond chance at first: where nothing is named, E may be any of theirs."""
    first = searched.rounds[0]
    beyond = [c for c in first.candidates if first.scored[c.effect.key].p_adjusted < LEVEL]
    if not beyond:
        return ()
    here = searched.base
    return (Candidate(beyond[0].effect, here.model, here.values, here.chi2, here.force_N), *beyond)


def unconfirmed(searched: Searched) -> tuple[Candidate, ...]:
    """The last fit, then what stands beyond the level on it but not beyond doubt, or not on presses left out."""
    here, last = searched.current, searched.rounds[-1]
    found = [
        c for c in last.candidates
        if last.scored[c.effect.key].p_adjusted < LEVEL and inside(c) and c.cost < here.chi2
        and c.model.without(c.effect.key).keys == here.model.keys
    ]  # fmt: skip
    return (Candidate(found[0].effect, here.model, here.values, here.chi2, here.force_N), *found) if found else ()


def spanning(
    after: CalibrationResult, sets: Sequence[tuple[Candidate, ...]], others: Sequence[float]
) -> CalibrationResult:
    """E's interval stretched to what the candidates that cannot be told apart, and `others`, would make of it."""
    E = after.youngs_modulus
    others = [*others, *(c.values[0] / s[0].values[0] for s in sets for c in s[1:])]  # of the first of each set
    if not others or E.interval95 is None:
        return after
    low, high = E.interval95[0] * min(1.0, *others), E.interval95[1] * max(1.0, *others)
    warning = "E's interval reaches to what effects that cannot be told apart, or are not beyond doubt, make of E"
    return replace(after, youngs_modulus=replace(E, interval95=(low, high)), warnings=(*after.warnings, warning))


def bent_or(after: CalibrationResult, searched: Searched) -> CalibrationResult:
    """E's interval stretched to what the effects make of it that explain a bend within theory's as well."""
    E, others = after.youngs_modulus, searched.bend_or
    if not others or E.interval95 is None:
        return after
    key = max(others, key=lambda one: abs(np.log(others[one])))
    low, high = E.interval95[0] * min(1.0, *others.values()), E.interval95[1] * max(1.0, *others.values())
    what, off = key.replace("_", " "), 100 * (others[key] - 1)
    warning = f"what was taken for a bend that theory allows may be {what} as well: E is then {off:+.0f} %"
    wide = replace(E, interval95=(low, high))
    return replace(after, youngs_modulus=wide, warnings=(*after.warnings, warning))


def unrisen(after: CalibrationResult, sight: Outcome) -> CalibrationResult:
    """E's interval stretched to what it would be if the certified depth forgot the gel's rise."""
    share = max((risen(c, sight.fitted.data) for s in sight.sets for c in s), default=0.0)
    E = after.youngs_modulus
    if share <= 0 or E.interval95 is None:
        return after
    wide = replace(E, interval95=(E.interval95[0], E.interval95[1] / (1 - share)))
    warning = f"if the bevel met the gel early, depths are {100 * share:.1f} % too large and E that much too small"
    return replace(after, youngs_modulus=wide, warnings=(*after.warnings, warning))


# From a misfit to its cause: what is missing from the model, what cannot be told apart, what to measure next.
#
#     testable? -> base model -> search (test, refit, confirm, add) -> is anything left? -> does it matter?
#
# Forces are searched, and, where the picture's own depth stands beside a certified one, the picture too. One test,
# at one level, stands before anything but ADEQUATE, calibrated by one bootstrap (score_test.py); two searches
# share it. Evidence ranks what it lets through, held-out presses confirm it. The verdict is ADEQUATE (nothing
# stands out, or what does is harmless), IDENTIFIED (an effect, and no other that fits as well), AMBIGUOUS (several
# fit as well, or beta is not one that theory allows), UNKNOWN (something is left that no effect of the catalogue
# explains, and E, a force or a depth may be off by more than its interval says).

POINTS_ALONE = "curves_not_used"  # of presses that a camera saw
WHY_POINTS = (
    "only certified points take part: along the ramp the depth is the picture's, whose walls err by percent "
    "from depth to depth, so what follows time and history within a press is not looked for"
)
STRANGE_BETA = {"beta_outside_theory", AT_BOUND}  # flags of a slope that is not the contact's
NOT_TRUSTED = "something unexplained is in these data: E may be off by more than its interval says"
FEW = 0.1  # of the presses: what can be set aside as accidents


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
    """Diagnose measurements against the catalogue and the private `effects`; `known` ones are in from the start.

    `bulge`: nu from the rise beside the punch, held within `bound`; forces are fitted with it, and the picture is
    held against none of its own. A candidate that cannot be fitted is passed over. Where the time of `watch` is
    over, nothing new is looked for: the answer is the best so far, `stopped`. Raises InputError where no law can
    be fitted at all.
    """
    data = clear_of_touch(in_phase(usable(data)))
    catalogue = [*EFFECTS.values(), *effects]
    held = partial(_diagnosed, known=known, rng=rng, bulge=bulge, bound=bound, watch=watch)
    fitted = partial(held, catalogue=catalogue)
    found = whole = fitted(data)
    aside, foreign = tuple[str, ...](), False
    while not watch.over and found.odd.presses and len(aside) + len(found.odd.presses) <= FEW * data.count:
        aside, foreign = (*aside, *found.odd.presses), foreign or found.odd.foreign
        others = ~np.isin(np.array(data.presses.label), aside)
        found = fitted(data.take(others))
    return _beside(whole, found, aside, foreign=foreign) if aside and not found.odd.presses else whole


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
    """These presses, all of them."""
    seen, source = fit_vision_depth(data), _source_of_nu(data, bulge, bound)
    data = informed(data, bulge, bound=bound)
    model = base_model(data)
    for effect in known:
        of_picture = None if seen is None else _of_picture(effect, seen, data)
        if of_picture is None:
            model = model + effect
        else:
            seen = of_picture
    level = LEVEL if seen is None else LEVEL / 2
    watch.tell("fitting the plain law")
    begin = base_fit(model, data)
    found_there = forward_selection(begin, catalogue, rng=rng, level=level, of_rig=True, watch=watch)
    force = against_instrument_errors(
        outcome(found_there, level, odd_presses(found_there, level)), watch, level=level
    )
    sight = None
    if seen is not None:
        others = [one for one in in_picture(seen.data) if one.key not in seen.model.keys]
        sight = outcome(forward_selection(seen, others, rng=rng, level=level, watch=watch), level)
    watch.tell("what it does to the material")
    found = _determine(_unbiased(force), sight, catalogue, rng)
    return replace(found, before=_sourced(found.before, source), after=_sourced(found.after, source))


def _unbiased(force: Outcome) -> Outcome:
    """The same steps, the last one's values free of what depth readings' noise does to the form of a curve."""
    if not force.steps:
        return force
    last = force.steps[-1]
    with suppress(*CANNOT_FIT):
        last = replace(last, fitted=with_errors_in_depth(last.fitted))
    return replace(force, steps=(*force.steps[:-1], last))


def _source_of_nu(data: Observations, bulge: Estimate | None, bound: Pair | None) -> str:
    """Which route told most of what was known of nu before any force was fitted."""
    return tightest((*of_bulge(bulge), *of_prior(data.gel, bulge=bulge, bound=bound)))


def _sourced(result: CalibrationResult, source: str) -> CalibrationResult:
    """The result, which takes what was known of nu for stated, with where it came from."""
    known = result.poisson_ratio_source == "prior" and result.poisson_ratio.value is not None
    return replace(result, poisson_ratio_source=source) if known else result


def _of_picture(effect: Effect, seen: Fit, data: Observations) -> Fit | None:
    """The law of the picture's depth with a known effect in it; None where it is one of the force."""
    shown = {one.key: one for one in in_picture(seen.data)}.get(effect.key)
    if shown is None or not effect_directions(fit_alone(base_model(data), data), [effect])[1]:
        return None
    return adopt(seen, refit_with(seen, shown))


def _beside(whole: Diagnosis, rest: Diagnosis, aside: tuple[str, ...], *, foreign: bool) -> Diagnosis:
    """The diagnosis of the rest, with the presses that were set aside; what is in a foreign one is not known."""
    odd = replace(rest.odd, presses=aside, foreign=foreign)
    plans = {plan.action: plan for plan in (*press_again(odd), *rest.measure_next)}
    return replace(
        rest,
        verdict="UNKNOWN" if foreign else rest.verdict,
        without=rest.verdict,
        set_aside=aside,
        odd=odd,
        whole=whole.fitted,
        flags=("press_stands_out", *rest.flags),
        measure_next=tuple(plans.values()),
    )


def _determine(
    force: Outcome, sight: Outcome | None, catalogue: Sequence[Effect], rng: np.random.Generator
) -> Diagnosis:
    """The verdict and everything that goes with it."""
    base, fitted = force.searched.base, force.fitted
    before = material_by_routes(base)
    alone = concluded(fitted, before if fitted is base else material_by_routes(fitted))
    both = [force] if sight is None else [force, sight]
    flags = list(dict.fromkeys([*alone.flags, *(flag for one in both for flag in one.flags)]))
    sets = [s for one in both for s in one.sets]
    suspects = instead_of_beta() if STRANGE_BETA & set(flags) else ()
    explained, instead = would_have_to_be(base, suspects), _refitted(base, suspects)
    after, unseen = _material(alone, (force, sight), catalogue, _moduli(force, explained, instead=instead))
    flags += [f"{s.best.effect.key}_beyond_prior" for s in force.steps if _beyond_prior(fitted, s.best.effect.key)]
    keys = [*(c.effect.key for s in sets for c in s), *(effect.key for effect in (suspects if explained else ()))]
    candidates = tuple(dict.fromkeys(keys))
    missing, visible = _testable(both)
    looked = _looked_for(catalogue, sight)
    missing, errors = {k: why for k, why in missing.items() if k not in candidates}, _errors(base, fitted)
    left = unexplained(force.searched, force.alternative_explanation) if force.unknown else None
    small = hidden(fitted, [e for e in looked if e.key not in candidates], missing=missing, visible=visible)
    return Diagnosis(
        verdict=_verdict(both, flags), candidates=candidates, flags=tuple(flags), errors=errors,
        effects=tuple(_added(one.fitted, step) for one in both for step in one.steps),
        base=base, fitted=fitted, sight=None if sight is None else sight.searched,
        before=before, after=after, unseen=unseen, alone_MPa=alone.youngs_modulus.interval95,
        not_testable=small.why, visible=visible, possible_bias=small.bias, below_visibility=small.below,
        covariates=force.searched.last.covariates, covariates_before=force.searched.first.covariates,
        score_test=force.searched.first.effects, lack_of_fit_p=min(one.left for one in both),
        measure_next=plan_next(
            base, [one.sets for one in both], odd=both[0].odd, left=left, instead=instead, bias=small.bias
        ),
        change_point=change_point(fitted, rng) if force.unknown else None, odd=force.odd, left=left,
        nearest=next((nearest(one.searched) for one in both if one.unknown), None), would_have_to_be=explained,
        alternative_explanation=force.alternative_explanation, left_over=force.remainder,
        tried=tuple(key for one in both for key in one.tried), sizes={e.key: e.parameters[0] for e in looked},
        plain=force.plain, stopped=any(one.searched.stopped for one in both),
        held_out=(errors.held_out_before, *(_held_out(s.fitted, fitted, errors) for s in force.steps)),
    )  # fmt: skip


def _moduli(force: Outcome, explained: Sequence[InadmissibleBeta], *, instead: Sequence[Candidate]) -> list[float]:
    """What else E may be, over that of the base fit."""
    moduli = [*(one.youngs_modulus_MPa for one in explained), *(float(one.values[0]) for one in instead)]
    moduli += [] if force.alternative_explanation is None else [force.alternative_explanation.modulus_MPa]
    return [modulus / float(force.searched.base.values[0]) for modulus in moduli]


def concluded(fitted: Fit, result: CalibrationResult) -> CalibrationResult:
    """The material of the last fit, with a word on curves that take no part and on a stated noise far off."""
    if fitted.data.reconstructed_mm is not None and not fitted.data.is_curves:
        flags, warnings = (*result.flags, POINTS_ALONE), (*result.warnings, WHY_POINTS)
        result = replace(result, flags=flags, warnings=warnings)
    return with_stated_noise(result, fitted)


def _material(
    alone: CalibrationResult,
    both: tuple[Outcome, Outcome | None],
    catalogue: Sequence[Effect],
    shares: Sequence[float],
) -> tuple[CalibrationResult, tuple[UndetectedEffect, ...]]:
    """What the last fit makes `alone`, E's interval reaching to each candidate's and over what may be unseen."""
    force, sight = both
    averaged, unseen = average_models(alone.youngs_modulus, force.fitted, effects=catalogue)
    searched = force.searched
    sets = [tried(searched)] if force.unknown else [*force.sets, unconfirmed(searched)]
    after = spanning(alone, sets, shares)
    after = bent_or(after, searched)
    after = replace(
        after,
        youngs_modulus=holding(after.youngs_modulus, averaged.interval95),
        warnings=(*after.warnings, *_remarks(force)),
    )
    return (after if sight is None else unrisen(after, sight)), unseen


def _remarks(force: Outcome) -> tuple[str, ...]:
    """What is to be said of E beside its value, where something is left."""
    if force.unknown:
        return (NOT_TRUSTED,)
    return () if force.remainder is None else (force.remainder.sentence,)


def _verdict(both: Sequence[Outcome], flags: Sequence[str]) -> str:
    if any(one.unknown for one in both):
        return "UNKNOWN"
    if STRANGE_BETA & set(flags) or any(len(s) > 1 for one in both for s in one.sets):
        return "AMBIGUOUS"
    return "IDENTIFIED" if any(one.steps for one in both) else "ADEQUATE"


def _testable(both: Sequence[Outcome]) -> tuple[dict[str, str], dict[str, float]]:
    """What neither search could look for and why, and the smallest amplitude that would have been seen."""
    first = [one.searched.first for one in both]
    looks = [
        one.searched.rounds[k].score_test for one in both for k in (0, -1)
    ]  # a bend or an effect hides some more
    visible = {key: size for score_test in looks for key, size in score_test.visible.items()}
    looked = {key for score_test in first for key in score_test.visible if key not in score_test.not_testable}
    missing = {
        key: why for score_test in first for key, why in score_test.not_testable.items() if key not in looked
    }
    return missing, visible


def _looked_for(catalogue: Sequence[Effect], sight: Outcome | None) -> list[Effect]:
    """The catalogue, of the picture as it was looked at there: a ceiling of slopes has another unit."""
    seen = () if sight is None else in_picture(sight.searched.base.data)
    return list({e.key: e for e in (*catalogue, *(one.inner for one in seen))}.values())


def _beyond_prior(fitted: Fit, key: str) -> bool:
    """Whether an effect's value lies more than three std from what was known of it beforehand."""
    return any(
        abs(value - p.prior.mean) > TOLD_APART * p.prior.std
        for value, p in zip(fitted.values, fitted.parameters, strict=True)
        if p.prior is not None and p.name.startswith(f"{key}.")
    )


def _added(fitted: Fit, step: Step) -> Added:
    key = step.best.effect.key
    values = tuple((p.name, fitted.estimate(f"{key}.{p.name}")) for p in step.best.effect.parameters)
    return Added(key, values, step.scored.p_adjusted, step.skill)


def _errors(base: Fit, current: Fit) -> Errors:
    before = fit_errors(base)
    after = before if current is base else fit_errors(current)
    return Errors(before.rms_N, after.rms_N, before.held_out_N, after.held_out_N, after.repeatability_N)


def _held_out(fitted: Fit, last: Fit, errors: Errors) -> float:
    """Of one step's fit; the last one's is known."""
    return errors.held_out_after if fitted is last else held_out_rms(fitted)


def _refitted(base: Fit, effects: Sequence[Effect]) -> Sequence[Candidate]:
    """These effects on top of the base; with beta out of theory the stated thickness is itself in doubt."""
    found = []
    for effect in effects:
        if effect.key not in base.model.keys:
            with suppress(*CANNOT_FIT):
                found.append(refit_with(base, freed(effect)))
    return found
