"""From a misfit to its cause: what is missing from the model, what cannot be told apart, what to measure next.

    testable? -> base model -> screen -> refit -> confirm -> again, at most three times -> is anything left?

Each decision is a p-value calibrated by the screen's bootstrap; none is a tuned threshold. The verdict is
ADEQUATE (nothing stands out), IDENTIFIED (an effect, and no other that fits as well), AMBIGUOUS (several fit
as well, or beta is not one that theory allows), UNKNOWN (something is left that no effect of the catalogue
explains).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calibration.bias import possible_bias
from calibration.calibrate import conclude
from calibration.checks import check, of_shape
from calibration.compare import base_model, fit_alone
from calibration.data import Observations
from calibration.diagnosis import Added, Diagnosis, Errors
from calibration.effects import EFFECTS
from calibration.effects.thickness import Thickness
from calibration.experiment import BY_HAND, NextMeasurement, measure_next
from calibration.fitting import Fit
from calibration.noise import Whitener
from calibration.outside import CANDIDATES, would_have_to_be
from calibration.refit import (
    CANNOT_FIT,
    Candidate,
    adopt,
    held_out_rms,
    hold_out,
    press_folds,
    refit_with,
    separation,
)
from calibration.repeats import noise_floor
from calibration.result import CalibrationResult
from calibration.screen import Scored, Screen, screen
from calibration.stages import Effect

LEVEL = 0.05  # family-wise chance of naming an effect where there is none
LEFT_LEVEL = 0.025  # of saying that something unknown is left
AS_GOOD = 6.0  # in chi^2 + 2 q: candidates this near the best stay in the set
TOLD_APART = 3.0  # std
REFITTED, MOST = 5, 3
MOSTLY = 0.8  # of a misfit explained: the rest is then a matter of the effect's form
WORTH = 0.5  # std: an action that brings less is not worth its minutes


@dataclass(frozen=True, slots=True)
class _Round:
    """One turn of the search: the screen, and the candidates refitted on its best."""

    screen: Screen
    candidates: tuple[Candidate, ...]
    scored: Mapping[str, Scored]


@dataclass(frozen=True, slots=True)
class _Step:
    """A candidate that was confirmed, its skill on presses left out, and the fit with it."""

    best: Candidate
    skill: float
    fitted: Fit


def diagnose(
    data: Observations,
    rng: np.random.Generator,
    *,
    effects: Sequence[Effect] = (),
    known: Sequence[Effect] = (),
) -> Diagnosis:
    """Diagnose measurements against the catalogue and the private `effects`; `known` ones are in from the start.

    A candidate that cannot be fitted is passed over. Raises InputError where no law can be fitted at all.
    """
    data = of_shape(data)
    check(data)
    catalogue = [*EFFECTS.values(), *effects]
    model = base_model(data)
    for effect in known:
        model = model + effect
    base = fit_alone(model, data)
    current = base
    rounds: list[_Round] = []
    added: list[tuple[Candidate, Scored, float]] = []
    sets: list[tuple[Candidate, ...]] = []
    while len(added) < MOST:
        turn = _look(current, catalogue, rng)
        rounds.append(turn)
        step = _confirmed(current, turn)
        if step is None:
            break
        sets.append(_equals(current, step.best, turn.candidates))
        added.append((step.best, turn.scored[step.best.effect.key], step.skill))
        current = step.fitted
    last = rounds[-1] if len(rounds) > len(added) else _look(current, (), rng)
    found = _conclude(base, current, rounds, added=added, sets=sets, last=last)
    hidden = [effect for effect in catalogue if effect.key in found.not_testable]
    return replace(found, possible_bias=possible_bias(found.fitted, hidden))


def _look(current: Fit, catalogue: Sequence[Effect], rng: np.random.Generator) -> _Round:
    """Screen, then refit the best five and every effect that acts as a threshold."""
    seen = screen(current, catalogue, rng)
    by_key = {e.key: e for e in catalogue}
    scored = {s.key: s for s in seen.effects}
    chosen = [s.key for s in seen.effects[:REFITTED] if s.p < LEVEL]
    chosen += [k for k in scored if getattr(by_key[k], "threshold", False) and k not in chosen]
    candidates = []
    for key in chosen:
        try:
            candidates.append(refit_with(current, by_key[key]))
        except CANNOT_FIT:
            continue  # it screened well but does not fit: no candidate
    return _Round(seen, tuple(sorted(candidates, key=lambda c: c.cost)), scored)


def _confirmed(current: Fit, turn: _Round) -> _Step | None:
    """The best candidate, if its improvement is beyond chance for having looked at all, and carries over."""
    for best in turn.candidates:
        if turn.scored[best.effect.key].p_adjusted > LEVEL or not _inside(best):
            continue
        try:
            skill = _skill(current, best)
            if skill > 0:
                return _Step(best, skill, adopt(current, best))
        except CANNOT_FIT:
            continue  # the next best may still stand
    return None


def _inside(candidate: Candidate) -> bool:
    """The amplitude is not at the end of its range."""
    value, first = candidate.own_values[0], candidate.effect.parameters[0]
    low, high = first.bounds
    return bool(low + 1e-4 * first.scale < value < high - 1e-4 * first.scale or (first.default in (low, high)
                and value < high - 1e-4 * first.scale))  # fmt: skip


def _skill(current: Fit, candidate: Candidate) -> float:
    """1 - held-out error with over without the effect, both squared and whitened."""
    folds = press_folds(current.data)
    before = hold_out(current.model, current, current.values, folds).squares
    after = hold_out(candidate.model, current, candidate.values, folds).squares
    return 1 - after / before if before > 0 else 0.0


def _equals(current: Fit, best: Candidate, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The best and all that these data cannot tell from it: as good a fit, or a separation below three std."""
    kept = [best]
    for other in candidates:
        if other.effect.key == best.effect.key or not _inside(other):
            continue
        if other.cost - best.cost < AS_GOOD or _apart(current, best, other.effect) < TOLD_APART:
            kept.append(other)
    return tuple(kept)


def _apart(current: Fit, best: Candidate, other: Effect) -> float:
    """The separation in std; inf where the other finds no way at all to look like the best."""
    try:
        return separation(current, best, other)
    except CANNOT_FIT:
        return float("inf")


def _conclude(
    base: Fit,
    current: Fit,
    rounds: Sequence[_Round],
    *,
    added: Sequence[tuple[Candidate, Scored, float]],
    sets: Sequence[tuple[Candidate, ...]],
    last: _Round,
) -> Diagnosis:
    """The verdict and everything that goes with it."""
    before, after = conclude(base), conclude(current)
    flags = list(after.flags)
    tried: tuple[str, ...] = ()
    left = last.screen.lack_of_fit
    wide = [s for s in sets if len(s) > 1]
    verdict = "IDENTIFIED" if added else "ADEQUATE"
    if wide or "beta_outside_theory" in flags:
        verdict = "AMBIGUOUS"
    if left < LEFT_LEVEL:
        if added and explained_share(base, current) > MOSTLY:
            flags.append("small_remainder")  # the cause is named; its form is not exact
        else:  # what was tried does not explain it, so it is not named and repairs nothing
            verdict, flags = "UNKNOWN", [*before.flags]
            tried, added, sets, after = tuple(c.effect.key for c, _, _ in added), (), (), before
    after = _spanning(after, sets)
    flags += [f"{c.effect.key}_beyond_prior" for c, _, _ in added if _beyond_prior(current, c.effect.key)]
    first = rounds[0].screen
    candidates = tuple(dict.fromkeys(c.effect.key for s in sets for c in s))
    explained = would_have_to_be(base) if "beta_outside_theory" in flags else ()
    if explained:
        candidates = tuple(dict.fromkeys((*candidates, *CANDIDATES)))
    return Diagnosis(
        verdict=verdict, effects=tuple(_added(current, c, s, k) for c, s, k in added), candidates=candidates,
        not_testable=dict(first.not_testable), visible=dict(first.visible),
        errors=_errors(base, current if added else base), before=before, after=after,
        covariates=last.screen.covariates,
        screen=first.effects, measure_next=_next(base, sets, flags, first.not_testable),
        change_point=change_point(current) if left < LEFT_LEVEL else None, flags=tuple(flags),
        would_have_to_be=explained, lack_of_fit_p=left, tried=tried, possible_bias={}, base=base,
        fitted=current if added else base,
    )  # fmt: skip


def _beyond_prior(fitted: Fit, key: str) -> bool:
    """Whether an effect's value lies more than three std from what was known of it beforehand."""
    return any(
        abs(value - p.prior.mean) > TOLD_APART * p.prior.std
        for value, p in zip(fitted.values, fitted.parameters, strict=True)
        if p.prior is not None and p.name.startswith(f"{key}.")
    )


def _spanning(after: CalibrationResult, sets: Sequence[tuple[Candidate, ...]]) -> CalibrationResult:
    """E's interval stretched to what the candidates that cannot be told apart would each make of it."""
    E = after.youngs_modulus
    others = [c.values[0] / s[0].values[0] for s in sets for c in s[1:]]
    if not others or E.interval95 is None:
        return after
    low, high = E.interval95[0] * min(1.0, *others), E.interval95[1] * max(1.0, *others)
    warning = "E's interval spans the candidates that these data cannot tell apart"
    return replace(after, youngs_modulus=replace(E, interval95=(low, high)), warnings=(*after.warnings, warning))


def explained_share(base: Fit, current: Fit) -> float:
    """How much of what repeats cannot account for the added effects do; whitened by the last model's noise."""
    whitener = Whitener(current.data, current.noise, current.about)
    before, after = (float(np.sum(whitener.apply(f.residual_N) ** 2)) for f in (base, current))
    excess = before - base.data.size
    return (before - after) / excess if excess > 0 else 0.0


def _added(current: Fit, candidate: Candidate, scored: Scored, skill: float) -> Added:
    key = candidate.effect.key
    values = tuple((p.name, current.estimate(f"{key}.{p.name}")) for p in candidate.effect.parameters)
    return Added(key, values, scored.p_adjusted, skill)


def _errors(base: Fit, current: Fit) -> Errors:
    before = held_out_rms(base)
    after = before if current is base else held_out_rms(current)
    return Errors(base.rms_error_N, current.rms_error_N, before, after, noise_floor(current))


def _next(base: Fit, sets: Sequence[tuple[Candidate, ...]], flags: Sequence[str],
          not_testable: Mapping[str, str]) -> tuple[NextMeasurement, ...]:  # fmt: skip
    """Actions for the first set that stays open; for what no press can show, the action by hand."""
    plans: list[NextMeasurement] = []
    for group in sets:
        if len(group) > 1:
            plans += measure_next(base, group[0], group[1:])
            break
    if not plans and "beta_outside_theory" in flags:
        found = _refitted(base, CANDIDATES)
        plans += measure_next(base, found[0], found[1:]) if found else ()
    worth = [p for p in plans if p.separation_sigma > WORTH]
    source = {"backing_compliance": "stage", "bevel_rise": "gauge", "photometric_gain": "vision"}
    by_hand = [NextMeasurement(*BY_HAND[key], float("nan")) for key in not_testable
               if key in BY_HAND and source.get(key) in (None, base.data.depth_source)]  # fmt: skip
    return (*worth, *by_hand)


def _refitted(base: Fit, keys: Sequence[str]) -> list[Candidate]:
    """These effects on top of the base; with beta out of theory the stated thickness is itself in doubt."""
    found = []
    for key in keys:
        if key not in base.model.keys:
            with suppress(*CANNOT_FIT):
                found.append(refit_with(base, Thickness(held=False) if key == "thickness" else EFFECTS[key]))
    return found


def change_point(fitted: Fit) -> str | None:
    """The press at which the mean residual jumps, where a jump explains it better than chance; else None.

    The largest CUSUM of the presses' mean whitened residuals, with Kolmogorov's distribution for its p.
    """
    from scipy.stats import kstwobign

    data = fitted.data
    if data.count < 8:
        return None
    mean = np.bincount(data.press, fitted.residual_N * fitted.about.force_N) / np.bincount(
        data.press, fitted.about.force_N**2)  # fmt: skip
    spread = float(np.std(mean))
    if spread == 0:
        return None
    path = np.cumsum(mean - mean.mean()) / (spread * np.sqrt(data.count))
    k = int(np.argmax(np.abs(path[:-1])))
    return data.presses.label[k + 1] if kstwobign.sf(abs(float(path[k]))) < LEVEL else None
