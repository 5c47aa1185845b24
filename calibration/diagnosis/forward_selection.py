"""The search for effects on one kind of measurement: look, refit, confirm, add, and look again.

    screen -> refit -> does theory's own freedom do as well? -> confirm -> again, at most three times

`decision.decide` states the rule. The freedom that theory leaves the law (the bend that finite elements give) and
another term of a relaxation in the model are no effects: where they explain a misfit as well, they are used, and
the search tests again at half the level, since this is its second test for a first effect. A second effect is
tested at .5 %, with an allowance for the form of the first (`covariates.form_errors`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calibration.diagnosis import refit
from calibration.diagnosis.covariates import seen_covariates
from calibration.diagnosis.refit import AS_GOOD, CANNOT_FIT, Candidate, adopt, inside, refit_with, skill
from calibration.diagnosis.score_test import Scored, ScoreTest, score_test
from calibration.fit.identifiability import beta_name
from calibration.fit.least_squares import Fit, fit, fit_again
from calibration.fit.repeats import LEVEL, refit_with_pure_noise
from calibration.inputs.deadline import UNWATCHED, Each, Watch
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory import beta_outside_theory
from calibration.model.composition import Model
from calibration.model.stages import Effect
from tactilevision.records.measured import Floats

REFITTED = 8  # candidates of a round that are fitted, the best by score
MAX_EFFECTS = 3  # effects in one model: the data of one recording bear no more
SECOND = LEVEL / 10  # family-wise level of a second and a third effect: a false one is confidently wrong
BEYOND_DOUBT = 0.001  # family-wise p below which presses left out may be predicted worse, by chance
FEW = 49  # draws where the statistic alone is asked for


@dataclass(frozen=True, slots=True)
class Round:
    """One round of the search: the score test, and its best candidates refitted on the fit `about`."""

    score_test: ScoreTest
    candidates: tuple[Candidate, ...]
    scored: Mapping[str, Scored]
    about: Fit


@dataclass(frozen=True, slots=True)
class Step:
    """A confirmed candidate: its score, its skill on presses held out, and the fit with it.

    `equals` are the candidates that these data cannot distinguish from it, itself first; `about` is the fit that
    all of them were added to.
    """

    best: Candidate
    scored: Scored
    skill: float
    fitted: Fit
    equals: tuple[Candidate, ...]
    about: Fit

    def own_fits(self) -> dict[str, Fit]:
        """Return a fit without a prior on the size of each of `equals`, by its key; none where none is found.

        The best one's is `fitted` where its size has no prior.
        """
        found = {}
        for one in self.equals:
            best = one is self.equals[0] and one.effect.freed() == one.effect
            with suppress(*CANNOT_FIT):
                found[one.effect.key] = self.fitted if best else refit.own_fit(self.about, one)
        return found


@dataclass(frozen=True, slots=True)
class Searched:
    """The rounds and steps of a search, from the base model to the score test of the last fit (`last`).

    `start` is the fit that the search began on: the base model's, or the one with all that theory allows its law;
    `bend_or` the effects that explain theory's bend as well: E with each, over E with the bend; `stopped`: the
    time was over before the search was.
    """

    base: Fit
    start: Fit
    rounds: tuple[Round, ...]
    steps: tuple[Step, ...]
    last: ScoreTest
    bend_or: Mapping[str, float] = field(default_factory=dict)
    stopped: bool = False

    @property
    def current(self) -> Fit:
        """The fit with all effects that were added."""
        return self.steps[-1].fitted if self.steps else self.start

    @property
    def first(self) -> ScoreTest:
        """The score test of the fit that the search began on."""
        return self.rounds[0].score_test

    @property
    def explained(self) -> float:
        """The share of the misfit at the start that the steps explain.

        That is what they took off chi^2, over this and the excess of the most significant covariate; whitened by
        the last model's noise, the cost of priors included.
        """
        current = self.current
        whitener = current.whitener
        before, after = (
            float(np.sum(whitener.apply(one.residual_N) ** 2) + one.chi2 - np.sum(one.white**2))
            for one in (self.start, current)
        )
        still = max((c.statistic - c.usual for c in self.last.covariates[:1]), default=0.0)
        taken = max(before - after, 0.0)
        return taken / (taken + max(still, 0.0)) if taken > 0 else 0.0


def forward_selection(
    base: Fit,
    catalogue: Sequence[Effect],
    *,
    rng: np.random.Generator,
    level: float,
    of_rig: bool = False,
    quick: bool = False,
    watch: Watch = UNWATCHED,
) -> Searched:
    """Add effects to `base` one after another; with `of_rig` odd presses are tested as well.

    A candidate that cannot be fitted is passed over. Once the time of `watch` is over the search ends, `stopped`.
    `quick`: one effect at most, and candidates are fitted only where the test is significant.
    """
    start = current = looked_at = base
    rounds, steps, bend_or = list[Round](), list[Step](), dict[str, float]()
    while len(steps) < MAX_EFFECTS and not (rounds and watch.over):
        now = SECOND if steps else level if current is base else level / 2
        may = _further(catalogue) if steps else catalogue
        turn = _look(current, may, rng, now, of_rig=of_rig, quick=quick, watch=watch)
        looked_at = current
        rounds.append(turn)
        if watch.over:
            break
        room, as_good = _roomier(turn, now)
        if room is not None and _takes(current, room, turn, rng):
            current = room
            bend_or = bend_or or {c.effect.key: float(c.values[0] / room.values[0]) for c in as_good}
            steps = [_with_own(step, room) for step in steps]
            if steps:
                steps[-1] = replace(steps[-1], fitted=room)
            else:
                start = room
            continue
        watch.tell("comparing the best candidates")
        step = _confirmed(turn, now, watch.each, further=bool(steps), quick=quick)
        if step is None:
            break
        steps.append(step)
        current = step.fitted
        if quick or step.best.effect.treatment:  # the rest is tested once the measurements are treated
            break
    last = rounds[-1].score_test
    if looked_at is not current:
        last = score_test(current, (), rng=rng, of_rig=of_rig, quick=quick, each=watch.each)
    other = {key: share for key, share in bend_or.items() if key not in current.model.keys}
    return Searched(base, start, tuple(rounds), tuple(steps), last, other, watch.over)


def _further(catalogue: Sequence[Effect]) -> list[Effect]:
    """Return the effects that may come after another; without those whose form over the depth is searched.

    They would take up what the form of the effect before lacks.
    """
    return [one for one in catalogue if not (one.searched > 1 and "w" in one.seen_in)]


def _roomier(turn: Round, level: float) -> tuple[Fit | None, tuple[Candidate, ...]]:
    """Return the fit with the freedom that theory leaves its parts, where that explains a significant misfit as
    well as any effect: the bend of the law, another term of a relaxation; and the effects that do as well.
    """
    if turn.score_test.family_p > level:
        return None, ()
    current = turn.about
    rivals = [c for c in turn.candidates if turn.scored[c.effect.key].p_adjusted <= level and inside(c)]
    enough = min(current.chi2, min((c.cost for c in rivals), default=np.inf) + AS_GOOD)
    fits = []
    for model, starts in _room(current):
        with suppress(*CANNOT_FIT):
            fits.append(fit(model, current.data, noise=current.noise, tolerances=False, starts=starts))
    fits = [one for one in fits if _cost(one, current) < enough and (not rivals or _lawful(one))]
    if not fits:
        return None, ()
    best = min(fits, key=lambda one: _cost(one, current))
    as_good = tuple(c for c in rivals if c.cost < _cost(best, current) + AS_GOOD)
    try:
        return replace(refit_with_pure_noise(best), warnings=current.warnings), as_good
    except CANNOT_FIT:
        return None, ()


def _lawful(found: Fit) -> bool:
    """Return whether each radius's slope is one that theory allows, without which the bend is not either."""
    if not isinstance(found.model.law, FlatPunch):
        return True
    nu, h = found.estimate("poisson_ratio"), found.data.gel.thickness_mm
    radii = np.unique(found.data.presses.radius_mm)
    return not any(
        beta_outside_theory(found.estimate(beta_name(found, float(a))), nu, a_over_h=float(a) / h) for a in radii
    )


def _room(current: Fit) -> Iterator[tuple[Model, Floats]]:
    """Yield the models with more freedom, and the starts of each."""
    law, effects, places = current.model.law, current.model.effects, current.model.slices(current.data)
    if isinstance(law, FlatPunch) and not law.bent:
        model = Model(replace(law, bent=True), effects)
        added = len(model.parameters(current.data)) - current.values.size
        yield model, np.insert(current.values, [places["law"].stop] * added, 0.0)[None]
    for effect in effects:
        if (more := effect.richer()) is not None:
            own = places[effect.key]
            begins = effect.richer_starts(current.values[own])
            starts = [[*current.values[: own.start], *begin, *current.values[own.stop :]] for begin in begins]
            yield current.model.without(effect.key) + more, np.array(starts)


def _cost(found: Fit, current: Fit) -> float:
    """Return chi^2 + 2 q of the q parameters added."""
    return found.chi2 + 2 * (found.values.size - current.values.size)


def _with_own(step: Step, fitted: Fit) -> Step:
    """Return the step with its effect as in a later fit."""
    return replace(step, best=Candidate.of_fit(step.best.effect.key, fitted))


def _takes(current: Fit, room: Fit, turn: Round, rng: np.random.Generator) -> bool:
    """Return whether the freer fit explains what is significant: an effect that it was compared with, or at least
    what its parameters cost of the most significant covariate's statistic.
    """
    best = min((s.p_adjusted for s in turn.scored.values()), default=1.0)
    if not turn.score_test.covariates or best <= turn.score_test.lack_of_fit:
        return True
    before = turn.score_test.covariates[0]
    after = next((c for c in score_test(room, (), rng=rng, draws=FEW).covariates if c.key == before.key), before)
    return before.statistic - after.statistic > 2 * (room.values.size - current.values.size)


def _look(
    current: Fit,
    catalogue: Sequence[Effect],
    rng: np.random.Generator,
    level: float,
    *,
    of_rig: bool,
    quick: bool,
    watch: Watch,
) -> Round:
    """Run the score test, then refit the best eight and every effect that acts as a threshold."""
    watch.tell("testing the residual")
    seen = score_test(current, catalogue, rng=rng, of_rig=of_rig, quick=quick, each=watch.each)
    by_key = {e.key: e for e in catalogue}
    scored = {s.key: s for s in seen.effects}
    chosen = [s.key for s in seen.effects[:REFITTED] if s.p < level]
    if quick:  # suspects alone
        chosen = [key for key in chosen if scored[key].p_adjusted <= level]
    else:
        chosen += [k for k in scored if by_key[k].threshold and k not in chosen]
    candidates = []
    about = _quieter(current, seen.effects[0], by_key, level) if seen.effects else current
    fetches = watch.each(partial(refit_with, about), [by_key[key] for key in chosen])
    for number, (key, fetch) in enumerate(zip(chosen, fetches, strict=True)):
        if watch.over:
            break
        watch.tell(f"fitting {key.replace('_', ' ')}", number, len(chosen))
        with suppress(*CANNOT_FIT):  # it screened well but does not fit: no candidate
            candidates.append(fetch())
    kept = sorted((c for c in candidates if not refit.rests_on_one_reading(about, c)), key=lambda c: c.cost)
    if kept:
        likened = [_with_terms(about, c) if c.effect.key in kept[0].effect.confused_with else c for c in kept]
        kept = sorted(likened, key=lambda c: c.cost)
    return Round(seen, tuple(kept), scored, about)


def _with_terms(about: Fit, candidate: Candidate) -> Candidate:
    """Return the candidate with as many terms as lower chi^2 + 2 q by AS_GOOD each.

    A better candidate that it is confused with may else only have more terms than one.
    """
    more = candidate.effect.richer()
    while more is not None:
        try:
            richer = refit_with(about, more)
        except CANNOT_FIT:
            break
        if richer.cost > candidate.cost - AS_GOOD:
            break
        candidate, more = richer, more.richer()
    return candidate


def _quieter(current: Fit, best: Scored, by_key: Mapping[str, Effect], level: float) -> Fit:
    """Return the fit under the noise that the best effect leaves, where that is less from press to press.

    Otherwise what changes from press to press counts as their scatter, and no two effects are distinguished. The
    effect is fitted from one start: only its noise is used.
    """
    if best.p_adjusted > level:
        return current
    with suppress(*CANNOT_FIT):
        noise = adopt(current, refit_with(current, by_key[best.key]), quick=True).noise
        after, before = (np.mean(one.of_press_N(current.about) ** 2) for one in (noise, current.noise))
        if after < before:
            return replace(fit_again(current, noise=noise), warnings=current.warnings)
    return current


def _confirmed(turn: Round, level: float, each: Each, *, further: bool, quick: bool) -> Step | None:
    """Return the best candidate that is significant, lowers chi^2 + 2 q by 6 also without any one reading, and
    predicts held-out presses better.

    Where forms are searched, a covariate of presses that shows the effect may be significant instead, or another
    effect that it shows. One with p below BEYOND_DOUBT may predict them worse by as much as so many presses leave
    to chance. A `further` effect lowers their error in N, too: what the form of the first one lacks does not.
    `quick`: no rivals are looked for.
    """
    current = turn.about
    of_press = {c.name for c in seen_covariates(current) if c.of_press}
    keys = {key for key, one in turn.scored.items() if one.p_adjusted <= level}
    shown = {c.key for c in turn.score_test.covariates if c.p_adjusted <= level}
    shown.update(*(c.effect.seen_in for c in turn.candidates if c.effect.key in keys))
    alike = [c.effect for c in turn.candidates if shown & of_press & {*c.effect.seen_in}]
    keys |= {effect.key for effect in alike if effect.searched > 1}
    may = [
        c
        for c in turn.candidates
        if c.effect.key in keys
        and inside(c)
        and c.cost + refit.by_one_reading(current, c) <= current.chi2 - AS_GOOD
    ]
    keys = {c.effect.key for c in may}  # the others: chance, at the end of the range, or held back beforehand
    again = may if quick or not may else refit.weighed_again(current, may[0], turn.candidates, each)
    for best in (c for c in again if c.effect.key in keys):
        scored = turn.scored[best.effect.key]
        try:
            fitted = adopt(current, best, quick=quick)
            gain = skill(current, fitted, best.effect)
            falls = not further or refit.held_out_rms(fitted) < refit.held_out_rms(current)
            if falls and gain > (-refit.chance(current.data.count) if scored.p_adjusted <= BEYOND_DOUBT else 0.0):
                equals = (best,) if quick else refit.equals(current, best, again)
                return Step(best, scored, gain, fitted, equals, current)
        except CANNOT_FIT:
            continue  # the next best may still stand
    return None
