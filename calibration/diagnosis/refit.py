"""Refit candidate effects, cross-validate them, and select those that are confirmed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from calibration.fit.least_squares import (
    FINE,
    QUICK,
    Fit,
    Minimum,
    Problem,
    fit,
    minimise,
    prior_pulls,
    unexplained,
)
from calibration.inputs.deadline import Each, in_turn
from calibration.inputs.observations import Ints, Observations
from calibration.model.composition import Model
from calibration.model.stages import NOT_READ, Effect
from calibration.noise.reml import Weighing
from tactilevision.errors import ConvergenceError
from tactilevision.records.constants import NONZERO, Z95
from tactilevision.records.measured import Bools, Floats

# Candidates refitted in full, held out and compared, all under one error model.

FLAT = Z95**2  # of chi^2: a size that costs no more than the best one is inside its 95 % interval
SAME = 0.1  # of chi^2: what differs by less is the same
END = 1e-4  # of a range or a scale: nearer to the end of its range a size lies at it
HALVINGS = 6  # of a size at the end of its range, to the smallest that is as good
STARTS = 2  # starts that are fitted, the best by their score
FOLDS = 5  # of presses: each fifth is predicted from the other four
UNDETERMINED = 1e-3  # share of a parameter's information: other presses that hold less do not determine it
CANNOT_FIT = (ConvergenceError, ValueError, ArithmeticError, RuntimeError)  # of one model: the others go on


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect refitted on top of a fit: `values` (p,), `chi2` under the fit's own whitening, `force_N` (N,)."""

    effect: Effect
    model: Model
    values: Floats
    chi2: float
    force_N: Floats

    @classmethod
    def of_fit(cls, key: str, fitted: Fit) -> Candidate:
        """Return the effect of this key as it is in a fit."""
        effect = next(e for e in fitted.model.effects if e.key == key)
        return cls(effect, fitted.model, fitted.values, fitted.chi2, fitted.force_N)

    @property
    def cost(self) -> float:
        """chi^2 + 2 q + 2 ln n: what candidates of q parameters and n searched forms are compared by."""
        return self.chi2 + 2 * len(self.effect.parameters) + 2 * float(np.log(self.effect.searched))

    @property
    def modulus_MPa(self) -> float:
        """E with the effect."""
        return self.model.modulus(self.values)

    @property
    def own_values(self) -> Floats:
        """The effect's own parameters."""
        return self.values[self.model.slices_of(self.values.size)[self.effect.key]]


@lru_cache(maxsize=64)  # a diagnosis and its page ask several times
def refit_with(base: Fit, effect: Effect) -> Candidate:
    """Return the effect fitted to the measurement, from its best starts."""
    return _refitted(base, effect, base.data, STARTS)


def _refitted(base: Fit, effect: Effect, data: Observations, most: int) -> Candidate:
    model = base.model + effect
    problem = Problem(model, data, model.parameters(data), base.whitener)
    starts = _best_starts(base, problem, effect, most)
    found = problem.solve(starts, tolerance=QUICK)
    values = _smallest_as_good(problem, problem.full(found.values), effect)
    return Candidate(effect, model, values, found.chi2, model.predict(values, data))


def _smallest_as_good(problem: Problem, values: Floats, effect: Effect) -> Floats:
    """Return the values (p,), the effect's size halved from the end of its range as long as that costs nothing.

    A threshold beyond which nothing changes is halved from anywhere.
    """
    if not effect.parameters:
        return values
    at = problem.model.slices(problem.data)[effect.key].start
    first, now = problem.parameters[at], values
    at_end = abs(values[at] - first.default) >= (1 - END) * max(abs(b - first.default) for b in first.bounds)
    if not (at_end or effect.threshold):
        return values
    most = float(np.sum(problem.linear(values[problem.free])[0] ** 2)) + (FLAT if at_end else SAME)
    for _ in range(HALVINGS):
        less = float(now[at] + first.default) / 2
        table = list(problem.parameters)
        table[at] = first.held_at(less)
        held = replace(problem, parameters=tuple(table))
        found = held.solve(now[None], tolerance=QUICK)
        if found.chi2 > most:
            break
        now = held.full(found.values)
    return now


def _best_starts(base: Fit, problem: Problem, effect: Effect, most: int) -> Floats:
    """Return the starts with all other values unchanged, ordered by what each explains to first order."""
    place = problem.model.slices(problem.data)[effect.key]
    rows = np.array([np.insert(base.values, place.start, start) for start in effect.starts(problem.data)])
    if len(rows) <= most:
        return rows
    white = problem.whitener.apply
    forces = [problem.data.normal_N, *(problem.model.predict(row, problem.data) for row in rows)]
    off = white(np.column_stack(forces) - base.force_N[:, None])
    z, *changes = unexplained(white(base.jacobian[:, base.free]), off).T
    gains = [float(d @ z) * abs(float(d @ z)) / max(float(d @ d), NONZERO) for d in changes]
    return rows[np.argsort(gains)[::-1][:most]]


def separation(base: Fit, one: Candidate, other: Effect) -> float:
    """Return the distance, in std, of `one` at its fitted values from the best that `other` can do instead.

    The prior of the other's own size is not used: it is a judgement, not a measurement.
    """
    mimic = _refitted(base, other.freed(), base.data.with_force(one.force_N), STARTS)
    pulls = prior_pulls(one.values, one.model.parameters(base.data))
    return float(np.sqrt(max(mimic.chi2 - float(pulls @ pulls), 0.0)))


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of presses held out of the fit, by fold (k,): sums of squares in N^2 and whitened.

    The cost of the parameters' priors counts as well, each fold its share.
    """

    of_force: Floats
    white: Floats
    samples: int

    @property
    def rms_N(self) -> float:
        """Root mean square in N."""
        return float(np.sqrt(np.sum(self.of_force) / self.samples))

    @property
    def squares(self) -> float:
        """The whitened sum of squares."""
        return float(np.sum(self.white))

    @classmethod
    def of_each_best(cls, tried: Sequence[HeldOut]) -> HeldOut:
        """Return for each fold the errors of the model that predicts the other folds best."""
        white = np.array([one.white for one in tried])
        best = np.argmin(white.sum(axis=1, keepdims=True) - white, axis=0)
        of_force, own = (
            np.take_along_axis(table, best[None], axis=0)[0]
            for table in (np.array([one.of_force for one in tried]), white)
        )
        return cls(of_force, own, tried[0].samples)


def hold_out(
    model: Model, about: Fit, *, start: Floats, folds: Ints, kept: Sequence[int] = (), read: bool = False
) -> HeldOut:
    """Return the errors of each fold of presses (M,), predicted from the others.

    Unless `read`, a prediction does not use the fold's own normal readings; history and tangential readings stay
    known. The parameters `kept` stay at `start`, as do those of the law that only the fold's presses determine:
    the slope of a radius that is pressed once.
    """
    data, whitener = about.data, about.whitener
    table = list(model.parameters(data))
    for at in kept:
        table[at] = table[at].held_at(float(start[at]))
    whole = Problem(model, data, tuple(table), whitener)
    information, law = whole.jacobian(start) ** 2, model.slices(data)["law"]
    of_force, white = list[float](), list[float]()
    for fold in np.unique(folds):
        out = (folds == fold)[data.press]
        rest, of_all = (np.sum(rows[:, law], axis=0) for rows in (information[~out], information))
        lost = np.flatnonzero(rest < UNDETERMINED**2 * of_all)
        own = {int(k): table[k].held_at(float(start[k])) for k in law.start + lost}
        problem = replace(whole, parameters=tuple(own.get(k, p) for k, p in enumerate(table)))
        found = fit_without(problem, start, out)
        seen = data if read else data.with_force(np.where(out, NOT_READ, data.normal_N))
        force = model.predict(problem.full(found.values), seen)
        strained = float(np.mean(out) * np.sum(found.residual[data.size :] ** 2))
        of_force.append(float(np.sum((data.normal_N - force)[out] ** 2)))
        white.append(float(np.sum(whitener.apply(data.normal_N - force)[out] ** 2)) + strained)
    return HeldOut(np.array(of_force), np.array(white), data.size)


@lru_cache(maxsize=16)  # a diagnosis and its page ask several times
def held_out_rms(fitted: Fit) -> float:
    """Return a fit's rms error in N on presses held out; NaN where they are too few or a fold finds no minimum."""
    if fitted.data.count <= 2:
        return float("nan")
    try:
        return hold_out(fitted.model, fitted, start=fitted.values, folds=press_folds(fitted.data)).rms_N
    except CANNOT_FIT:
        return float("nan")


def fit_without(problem: Problem, start: Floats, out: Bools) -> Minimum:
    """Return the minimum from `start` (p,) over the samples (N,) that are not `out`, forces in N.

    Where quick steps do not converge, as at a kink, central differences are used, and their last step counts.
    """
    size = problem.data.size

    def linear(free_values: Floats) -> tuple[Floats, Floats]:
        rows, slopes = problem.linear(free_values)
        rows[:size][out], slopes[:size][out] = 0.0, 0.0
        return rows, slopes

    solve = partial(minimise, linear, start[problem.free][None], box=problem.box)
    try:
        return solve(tolerance=QUICK)
    except ConvergenceError:
        return solve(settled=False)


def press_folds(data: Observations) -> Ints:
    """Return the fold (M,), dimensionless, of each press, so that each fold holds all conditions."""
    from calibration.inputs.conditions import repeat_groups

    order = np.argsort(repeat_groups(data), kind="stable")
    folds = np.empty(data.count, dtype=np.int64)
    folds[order] = np.arange(data.count) % min(FOLDS, data.count)
    return folds


def adopt(base: Fit, candidate: Candidate, *, quick: bool = False) -> Fit:
    """Return the candidate as a fit of its own, with the noise estimated anew from its residual.

    A threshold changes the noise, too, so that the best under another noise may be a wrong minimum: it is fitted
    from all its starts, unless `quick`, and the likelihood of each with its own noise decides. Starts that lead to
    one minimum are fitted with their own noise once.
    """
    places, values, model = [candidate.values], candidate.values, candidate.model
    if candidate.effect.threshold and not quick:
        own = model.slices(base.data)[candidate.effect.key]
        starts = candidate.effect.starts(base.data)
        places += [np.concatenate([values[: own.start], start, values[own.stop :]]) for start in starts]
    distinct, fits = list[tuple[Fit, Floats]](), list[Fit]()
    for place in places:
        with suppress(*CANNOT_FIT):
            first = _first(base, model, place.tobytes())
            if not any(_same(first, other) for other, _ in distinct):
                distinct.append((first, place))
    for _, place in distinct:
        with suppress(*CANNOT_FIT):
            fits.append(_settled(base, model, place))
    if not fits:
        raise ConvergenceError(f"{candidate.effect.key} does not fit from any of its starts")
    costs = [one.chi2 + log_volume(one) for one in fits]
    return next(one for one, cost in zip(fits, costs, strict=True) if cost < min(costs) + SAME)


def own_fit(about: Fit, candidate: Candidate) -> Fit:
    """Return the candidate as a fit of its own, from its values, without a prior on its size."""
    effect = candidate.effect.freed()
    one = candidate if effect == candidate.effect else refit_with(about, effect)
    return _settled(about, one.model, one.values)


def log_volume(fitted: Fit) -> float:
    """Return ln det V of a fit's own noise; with chi^2 it is -2 ln of the likelihood."""
    of_presses = Weighing(fitted.data, fitted.about, fitted.noise).log_volume(fitted.noise)
    return of_presses + 2 * float(np.sum(np.log(fitted.about.base_N)))


def _settled(base: Fit, model: Model, values: Floats) -> Fit:
    return _settled_from(base, model, values.tobytes())


@lru_cache(maxsize=24)  # the best candidate is adopted again, from the same starts
def _settled_from(base: Fit, model: Model, start: bytes) -> Fit:
    from calibration.fit.repeats import refit_with_pure_noise

    fitted = refit_with_pure_noise(_first(base, model, start), ftol=_tolerance(model))
    return replace(_by_own_slopes(fitted), warnings=base.warnings)


@lru_cache(maxsize=24)  # `adopt` and `_settled_from` ask for the same fits
def _first(base: Fit, model: Model, start: bytes) -> Fit:
    """Return the fit from a start under the noise of `base`."""
    starts = np.frombuffer(start)[None]
    return fit(model, base.data, noise=base.noise, starts=starts, tolerances=False, ftol=_tolerance(model))


def _tolerance(model: Model) -> float:
    """Return the tolerance of a minimum; a finer one is not reached where a threshold makes the slopes jump."""
    return QUICK if any(effect.threshold for effect in model.effects) else FINE


def _same(one: Fit, other: Fit) -> bool:
    """Return whether two fits of a model reached the same minimum."""
    near = np.abs(one.values - other.values) <= SAME * np.sqrt(np.diag(one.covariance))
    return abs(one.chi2 - other.chi2) < SAME and bool(near.all())


def _by_own_slopes(fitted: Fit) -> Fit:
    """Return the minimum under the fit's own linearisation, with which all that is added to it is compared.

    About a threshold, where slopes jump, chi^2 under the linearisation before may be less by hundreds.
    """
    if _tolerance(fitted.model) == FINE:
        return fitted
    problem = fitted.problem
    found = fit_without(problem, fitted.values, np.zeros(fitted.data.size, dtype=bool))
    values = problem.full(found.values)
    force = fitted.model.predict(values, fitted.data)
    white, jacobian = -found.residual[: fitted.data.size], problem.jacobian(values)
    moved = replace(fitted, values=values, force_N=force, residual_N=fitted.data.normal_N - force)
    return replace(moved, chi2=found.chi2, white=white, jacobian=jacobian)


# Which candidate stands, and which cannot be distinguished from it (point 3 of `decision.decide`).

AS_GOOD = 6  # in chi^2 + 2 q: candidates this near the best stay in the set
TOLD_APART = 3  # std between two candidates: nearer ones stay in the set
NEAR = 0.1  # share of the best one's gain: a rival this near is compared by likelihood


def weighed_again(
    current: Fit, first: Candidate, candidates: Sequence[Candidate], each: Each = in_turn
) -> Sequence[Candidate]:
    """Return the candidates, best first; those near the first are ordered by the likelihood of their own fits.

    A model that lacks the effect takes it for noise.
    """
    room = max(AS_GOOD, NEAR * (current.chi2 - first.cost))
    near = [c for c in candidates if c.cost - first.cost < room]
    if len(near) < 2:
        return candidates
    own = {}
    for one, adopted in zip(near, each(partial(adopt, current), near), strict=True):
        with suppress(*CANNOT_FIT):
            fitted = adopted()
            cost = fitted.chi2 + log_volume(fitted)
            own[one.effect.key] = replace(one, values=fitted.values, chi2=cost, force_N=fitted.force_N)
    least = min((one.cost for one in own.values()), default=0.0)
    moved = [own.get(c.effect.key, replace(c, chi2=c.chi2 - first.cost + least)) for c in candidates]
    return sorted(moved, key=lambda c: c.cost)


def inside(candidate: Candidate) -> bool:
    """Return whether the amplitude is not at an end of its range."""
    value, first = candidate.own_values[0], candidate.effect.parameters[0]
    low, high = first.bounds
    near = END * first.scale
    return bool((low + near < value or first.default in (low, high)) and value < high - near)


def by_one_reading(current: Fit, candidate: Candidate) -> float:
    """Return the most of a candidate's gain in chi^2 that is lost by excluding one sample of a curve.

    A sample holds (P r)_i^2 / P_ii of chi^2 = r' P r. 0 for points, since odd presses are tested by themselves.
    """
    data = current.data
    if not data.is_curves:
        return 0.0
    white = current.whitener.apply
    place = np.arange(data.size) - data.first[data.press]  # in its press
    root = white(np.eye(int(place.max()) + 1)[place])  # of P, press by press

    def of_samples(columns: Floats) -> Floats:
        return np.asarray(np.add.reduceat(columns, data.first)[data.press, place])

    before, after = (
        of_samples(root * white(data.normal_N - force)[:, None]) ** 2
        for force in (current.force_N, candidate.force_N)
    )
    return max(float(np.max((before - after) / of_samples(root**2))), 0.0)


def rests_on_one_reading(current: Fit, candidate: Candidate) -> bool:
    """Return whether a candidate is better than nothing by one reading alone."""
    return candidate.cost < current.chi2 <= candidate.cost + by_one_reading(current, candidate)


def chance(presses: int) -> float:
    """Return the relative std of an rms over so many presses."""
    return float(1 / np.sqrt(2 * presses))


def skill(current: Fit, fitted: Fit, effect: Effect) -> float:
    """Return 1 - held-out error with over without the effect, squared and whitened; below 0 where it rises in N.

    Both are whitened by the noise of `fitted`, the fit with the effect. The effect's size is fitted anew for each
    fold, its form (parameters of other units) is kept, since four fifths of the presses may leave it open. An
    effect that uses readings does not use those of the fold; of its sizes, each fold is predicted by the one that
    predicts the other folds best.
    """
    folds, begin = press_folds(current.data), fitted.model.slices(current.data)[effect.key].start
    table = effect.parameters
    form = [begin + k for k, p in enumerate(table) if p.unit != table[0].unit]
    read = not effect.asks_readings
    held = partial(hold_out, about=fitted, folds=folds, read=read)
    before = held(current.model, start=current.values)
    after = held(fitted.model, start=fitted.values, kept=form)
    if not read:
        sizes = [start[0] for start in effect.starts(current.data)]
        places = [np.where(np.arange(fitted.values.size) == begin, size, fitted.values) for size in sizes]
        others = [held(fitted.model, start=place, kept=[begin, *form]) for place in places]
        after = HeldOut.of_each_best([after, *others])
    if after.rms_N > (1 + chance(current.data.count)) * before.rms_N:
        return 1 - after.rms_N / before.rms_N
    return 1 - after.squares / before.squares if before.squares > 0 else 0.0


def equals(current: Fit, best: Candidate, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return the best and its equals: as good a fit, or less than three std from it."""
    kept = [best]
    for other in candidates:
        if other.effect.key == best.effect.key or not inside(other):
            continue
        if other.cost - best.cost < AS_GOOD or apart(current, best, other.effect) < TOLD_APART:
            kept.append(other)
    return tuple(kept)


def apart(base: Fit, one: Candidate, other: Effect) -> float:
    """Return the separation in std; inf where the other cannot be fitted to the candidate."""
    try:
        return separation(base, one, other)
    except CANNOT_FIT:
        return float("inf")
