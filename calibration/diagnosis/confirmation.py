"""Which candidate stands: weighed by the likelihood of its own fit, held out, and beside those as good as it.

Candidates are told apart by chi^2 + 2 q (AS_GOOD) and by the separation of their forces in standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from calibration.diagnosis.refit import (
    CANNOT_FIT,
    Candidate,
    HeldOut,
    adopt,
    hold_out,
    log_volume,
    press_folds,
    separation,
)
from calibration.fit.least_squares import Fit
from calibration.inputs.deadline import Each, in_turn
from calibration.model.stages import Effect
from calibration.noise.model import Whitener
from tactilevision.records import Floats

AS_GOOD = 6.0  # in chi^2 + 2 q: candidates this near the best stay in the set
TOLD_APART = 3.0  # std between two candidates: nearer ones stay in the set together
NEAR = 0.1  # of what the best takes off: a rival this near is weighed again


def weighed_again(
    current: Fit, first: Candidate, candidates: Sequence[Candidate], each: Each = in_turn
) -> Sequence[Candidate]:
    """The candidates, best first; those near the first one by the likelihood of their own fits: a model that lacks
    the effect takes it for noise, and its first touch for another.
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
    """The amplitude is not at the end of its range."""
    value, first = candidate.own_values[0], candidate.effect.parameters[0]
    low, high = first.bounds
    return bool(
        low + 1e-4 * first.scale < value < high - 1e-4 * first.scale
        or (first.default in (low, high) and value < high - 1e-4 * first.scale)
    )


def by_one_reading(current: Fit, candidate: Candidate) -> float:
    """What a candidate takes off chi^2 less where one sample of a curve is left out: the one by which it is most.

    Of chi^2 = r' P r a sample holds (P r)_i^2 / P_ii. One stray reading is no effect. A point is a press, and odd
    presses are looked for by themselves: 0 there.
    """
    data = current.data
    if not data.is_curves:
        return 0.0
    white = Whitener(data, current.noise, current.about).apply
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
    """Whether a candidate is better than nothing by one reading alone."""
    return candidate.cost < current.chi2 <= candidate.cost + by_one_reading(current, candidate)


def chance(presses: int) -> float:
    """Relative std of an rms over so many presses."""
    return float(1 / np.sqrt(2 * presses))


def skill(current: Fit, fitted: Fit, effect: Effect) -> float:
    """1 - held-out error with over without the effect, both squared and whitened; below 0 where it rises in N.

    Both are weighed by the noise of `fitted`, the fit with the effect, about its own line: what a missing effect
    does to all presses alike passes for their scatter, and its slopes put a depth's noise where the gel has none.
    The effect's size is found anew from each fold's others, not its form: a time that four fifths of the presses
    leave open may run off, and says nothing of the effect. One that asks readings may not ask those of the fold;
    of its sizes, which readings leave open, each fold is predicted by the one that predicts the others best.
    """
    folds, begin = press_folds(current.data), fitted.model.slices(current.data)[effect.key].start
    table = effect.parameters
    form = [begin + k for k, p in enumerate(table) if p.unit != table[0].unit]
    read = not getattr(effect, "asks_readings", False)
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
    """The best and all that these data cannot tell from it: as good a fit, or a separation below three std."""
    kept = [best]
    for other in candidates:
        if other.effect.key == best.effect.key or not inside(other):
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
