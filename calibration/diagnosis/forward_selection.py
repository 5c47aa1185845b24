"""The search for effects on one kind of measurement: look, refit, confirm, add, and look again.

    screen -> refit -> does theory's own freedom do as well? -> confirm -> again, at most three times

An effect is named only where the screen's bootstrap says that so good a score is beyond chance for having looked
at all of them, where its amplitude lies inside its range, and where it helps on presses left out, whitened and in
N. What a law may do besides (the bend that finite elements give) is no effect: where it explains a misfit as well,
it is let go and the search looks again, at half the level, for this is its second look for a first effect. Nor is
another term of a relaxation that is there already. A second effect is tested at .5 %, beside what the form of the
first may be off by (`form_errors` of covariate_steps.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calibration.diagnosis.refit import (
    AS_GOOD,
    CANNOT_FIT,
    Candidate,
    adopt,
    by_one_reading,
    chance,
    equals,
    inside,
    refit_with,
    rests_on_one_reading,
    skill,
    weighed_again,
)
from calibration.diagnosis.score_test import Scored, ScoreTest, scatter_unknown, score_test
from calibration.fit.identifiability import beta_name
from calibration.fit.least_squares import Fit, fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.inputs.deadline import UNWATCHED, Each, Watch
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory import beta_outside_theory
from calibration.model.composition import Model
from calibration.model.stages import Effect, EffectBase
from calibration.noise.model import Whitener
from tactilevision.records.measured import Floats

REFITTED = 8  # candidates of a round that are fitted, the best by score; the others are far behind
MAX_EFFECTS = 3  # effects in one model: the data of one recording bear no more
SECOND = 0.005  # family-wise level of a second and a third effect: a false one is confidently wrong
BEYOND_DOUBT = 0.001  # family-wise p below which presses left out may be predicted worse, by chance
FEW = 49  # draws where the statistic alone is asked for


@dataclass(frozen=True, slots=True)
class Round:
    """One turn of the search: the screen, and the candidates refitted on its best, beside the fit `about`."""

    score_test: ScoreTest
    candidates: tuple[Candidate, ...]
    scored: Mapping[str, Scored]
    about: Fit


@dataclass(frozen=True, slots=True)
class Step:
    """A candidate that was confirmed: its score, its skill on presses left out, the fit with it, and its equals.

    `equals` are the candidates that these data cannot tell from it, itself first.
    """

    best: Candidate
    scored: Scored
    skill: float
    fitted: Fit
    equals: tuple[Candidate, ...]


@dataclass(frozen=True, slots=True)
class Searched:
    """From the base model's fit over each step to what is left at the end (`last`).

    `bend_or` are the effects, not named, that explain as well what was taken for theory's own bend: E with each,
    over E with the bend.

    `start` is the fit that the search began on: the base model's, or the one with all that theory allows its law.
    `stopped`: the time was over before the search was.
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
        """The fit with all that was added."""
        return self.steps[-1].fitted if self.steps else self.start

    @property
    def first(self) -> ScoreTest:
        """The screen of the fit that the search began on."""
        return self.rounds[0].score_test

    @property
    def to_be_cured(self) -> bool:
        """Whether frames are to be read anew for what was named last."""
        return bool(self.steps) and cured_anew(self.steps[-1])

    @property
    def explained(self) -> float:
        """Of what the start leaves, the share that the steps explain."""
        return explained_share(self.start, self.current, left=self.last)


def forward_selection(
    base: Fit,
    catalogue: Sequence[Effect],
    *,
    rng: np.random.Generator,
    level: float,
    of_rig: bool = False,
    watch: Watch = UNWATCHED,
) -> Searched:
    """Search on top of `base`; with `of_rig` the rig's plain errors and odd presses are looked at as well.

    A candidate that cannot be fitted is passed over. Where the time of `watch` is over, the search ends with what
    it has, `stopped`.
    """
    start = current = looked_at = base
    rounds, steps, bend_or = list[Round](), list[Step](), dict[str, float]()
    while len(steps) < MAX_EFFECTS and not (rounds and watch.over):
        now = SECOND if steps else level if current is base else level / 2
        turn, looked_at = _look(current, catalogue, rng, now, of_rig=of_rig, watch=watch), current
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
        watch.tell("weighing the best against the others")
        step = _confirmed(turn, now, watch.each)
        if step is None:
            break
        steps.append(step)
        current = step.fitted
        if cured_anew(step):  # what else is left is looked for once the frames are read anew
            break
    last = rounds[-1].score_test
    if looked_at is not current:
        last = score_test(current, (), rng=rng, of_rig=of_rig, each=watch.each)
    other = {key: share for key, share in bend_or.items() if key not in current.model.keys}
    return Searched(base, start, tuple(rounds), tuple(steps), last, other, watch.over)


def cured_anew(step: Step) -> bool:
    """Whether the effect of a step is cured by reading the frames anew."""
    return bool(getattr(step.best.effect, "treatment", ""))


def _roomier(turn: Round, level: float) -> tuple[Fit | None, tuple[Candidate, ...]]:
    """The fit with what its parts may do besides, where something stands out and no effect explains it better: the
    bend that theory allows, another term of a relaxation; and the effects that explain it as well.
    """
    if turn.score_test.family_p > level:
        return None, ()
    current = turn.about
    rivals = [c for c in turn.candidates if turn.scored[c.effect.key].p_adjusted <= level and inside(c)]
    enough = min(current.chi2, min((c.cost for c in rivals), default=np.inf) + AS_GOOD)
    best = min(
        (
            found
            for model, starts in _room(current)
            if (found := _fitted(current, model, starts)) is not None
            and _cost(found, current) < enough
            and (not rivals or _lawful(found))
        ),
        key=lambda f: _cost(f, current),
        default=None,
    )
    if best is None:
        return None, ()
    as_good = tuple(c for c in rivals if c.cost < _cost(best, current) + AS_GOOD)
    try:
        return replace(refit_with_pure_noise(best), warnings=current.warnings), as_good
    except CANNOT_FIT:
        return None, ()


def _lawful(found: Fit) -> bool:
    """Whether each radius's slope is one that theory allows; a bend beside another slope is none of theory's."""
    if not isinstance(found.model.law, FlatPunch):
        return True
    nu, h = found.estimate("poisson_ratio"), found.data.gel.thickness_mm
    radii = np.unique(found.data.presses.radius_mm)
    return not any(
        beta_outside_theory(found.estimate(beta_name(found, float(a))), nu, a_over_h=float(a) / h) for a in radii
    )


def _room(current: Fit) -> Iterator[tuple[Model, Floats]]:
    """What the model's parts may be besides, and where to begin."""
    law, effects, places = current.model.law, current.model.effects, current.model.slices(current.data)
    if isinstance(law, FlatPunch) and not law.bent:
        model = Model(replace(law, bent=True), effects)
        added = len(model.parameters(current.data)) - current.values.size
        yield model, np.insert(current.values, [places["law"].stop] * added, 0.0)[None]
    for effect in effects:
        if isinstance(effect, EffectBase) and (more := effect.richer()) is not None:
            own = places[effect.key]
            yield (
                current.model.without(effect.key) + more,
                np.array(
                    [
                        [*current.values[: own.start], *start, *current.values[own.stop :]]
                        for start in effect.richer_starts(current.values[own])
                    ]
                ),
            )


def _fitted(current: Fit, model: Model, starts: Floats) -> Fit | None:
    try:
        return fit(model, current.data, noise=current.noise, tolerances=False, starts=starts)
    except CANNOT_FIT:
        return None


def _cost(found: Fit, current: Fit) -> float:
    """chi^2 and twice the parameters that came in."""
    return found.chi2 + 2 * (found.values.size - current.values.size)


def _with_own(step: Step, fitted: Fit) -> Step:
    """The step with its effect as it is in a later fit."""
    effect = next(e for e in fitted.model.effects if e.key == step.best.effect.key)
    best = Candidate(effect, fitted.model, fitted.values, fitted.chi2, fitted.force_N)
    return replace(step, best=best)


def _takes(current: Fit, room: Fit, turn: Round, rng: np.random.Generator) -> bool:
    """Whether the room takes away what stands out, and not something else: an effect it has been held against; off
    a covariate it has to take what its parameters cost.
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
    watch: Watch,
) -> Round:
    """Screen, then refit the best eight and every effect that acts as a threshold."""
    watch.tell("looking for what stands out")
    seen = score_test(current, catalogue, rng=rng, of_rig=of_rig, each=watch.each)
    by_key = {e.key: e for e in catalogue}
    scored = {s.key: s for s in seen.effects}
    chosen = [s.key for s in seen.effects[:REFITTED] if s.p < level]
    chosen += [k for k in scored if getattr(by_key[k], "threshold", False) and k not in chosen]
    candidates = []
    about = _quieter(current, seen.effects[0], by_key, level) if seen.effects else current
    refits = watch.each(partial(refit_with, about), [by_key[key] for key in chosen])
    for key, refit in zip(chosen, refits, strict=True):
        if watch.over:
            break
        watch.tell(f"fitting {key.replace('_', ' ')}")
        with suppress(*CANNOT_FIT):  # it screened well but does not fit: no candidate
            candidates.append(refit())
    candidates = [c for c in candidates if not rests_on_one_reading(about, c)]
    return Round(seen, tuple(sorted(candidates, key=lambda c: c.cost)), scored, about)


def _quieter(current: Fit, best: Scored, by_key: Mapping[str, Effect], level: float) -> Fit:
    """The fit under the noise that is left with the best effect in it, where there are few presses: what changes
    from one to the next has passed for their scatter, under which no two effects are told apart.
    """
    if not scatter_unknown(current.data) or best.p_adjusted > level:
        return current
    with suppress(*CANNOT_FIT):
        noise = adopt(current, refit_with(current, by_key[best.key])).noise
        if noise.of_press_N(current.about) < current.noise.of_press_N(current.about):
            model, data, values = current.model, current.data, current.values
            return replace(
                fit(model, data, noise=noise, starts=values[None], tolerances=False), warnings=current.warnings
            )
    return current


def _confirmed(turn: Round, level: float, each: Each) -> Step | None:
    """The best candidate, if its improvement is beyond chance for having looked at all, and carries over.

    Without any one reading it has to be better than nothing as well. One that is beyond doubt may be predicted
    worse by as much as so many presses leave to chance.
    """
    current = turn.about
    may = [
        c
        for c in turn.candidates
        if turn.scored[c.effect.key].p_adjusted <= level
        and inside(c)
        and c.cost + by_one_reading(current, c) <= current.chi2 - AS_GOOD
    ]
    keys = {c.effect.key for c in may}  # the others: chance, at the end of the range, or held back beforehand
    again = weighed_again(current, may[0], turn.candidates, each) if may else ()
    for best in (c for c in again if c.effect.key in keys):
        scored = turn.scored[best.effect.key]
        try:
            fitted = adopt(current, best)
            gain = skill(current, fitted, best.effect)
            if gain > (-chance(current.data.count) if scored.p_adjusted <= BEYOND_DOUBT else 0.0):
                return Step(best, scored, gain, fitted, equals(current, best, again))
        except CANNOT_FIT:
            continue  # the next best may still stand
    return None


def explained_share(base: Fit, current: Fit, *, left: ScoreTest) -> float:
    """How much of a misfit the added effects explain: what they took off chi^2, over it and what the most telling
    covariate still stands above chance by; all white under the last model's noise, priors included: what a law
    with much room takes up against its priors is misfit, too.
    """
    before, after = (_under(current, one) for one in (base, current))
    still = max((c.statistic - c.usual for c in left.covariates[:1]), default=0.0)
    taken = max(before - after, 0.0)
    return taken / (taken + max(still, 0.0)) if taken > 0 else 0.0


def _under(current: Fit, one: Fit) -> float:
    """chi^2 of a fit under the noise of another of the same samples; what its priors cost stays."""
    whitener = Whitener(current.data, current.noise, current.about)
    return float(np.sum(whitener.apply(one.residual_N) ** 2) + one.chi2 - np.sum(one.white**2))
