"""What a search has named, held against one plain error of an instrument that no effect of the catalogue has.

Several effects can follow together what one function of one covariate does alone (a force sensor that creeps
looks like a relaxation beside an adhesion), and then leave nothing. A plain error needs a reason: it stands out in
the test of the fit that the search began with, its range searched in the null as in the data, and its fit lies
inside its range. It is then fitted under the noise that the search ended with, and costs chi^2 + 2 q and what its
range was searched for, 2 ln of the ways to begin. What was named is not identified where a plain error costs no
more than an equally good fit may (AS_GOOD), and less by as much than each of the named effects does alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from calibration.diagnosis.confirmation import AS_GOOD
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.refit import CANNOT_FIT, Candidate, refit_with
from calibration.diagnosis.score_test import LEVEL
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS, InstrumentError
from calibration.fit.least_squares import Fit
from calibration.inputs.deadline import Each, in_turn
from calibration.model.parameters import Parameter
from calibration.model.stages import Effect
from tactilevision.records import Pair

EDGE = 0.02  # of a range: a fit this near its end has found no size


@dataclass(frozen=True, slots=True)
class AlternativeExplanation:
    """A plain error that does as well as effects together: its words and covariate, what it is fitted to be, the
    keys that it stands in place of, and how much less it costs than they do, in chi^2 + 2 q.
    """

    key: str
    words: str
    covariate: str
    sizes: tuple[tuple[Parameter, float], ...]
    instead_of: tuple[str, ...]
    cheaper: float
    modulus_MPa: float

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "key": self.key,
            "what": self.words,
            "covariate": self.covariate,
            "parameters": {p.name: {"value": value, "unit": p.unit} for p, value in self.sizes},
            "instead_of": list(self.instead_of),
            "cheaper_by": self.cheaper,
        }


def plain_errors(searched: Searched, each: Each = in_turn) -> tuple[Candidate, ...]:
    """Each plain error on what a search began with, under the noise that it ended with, the nearest first."""
    begin = _begin(searched)
    return tuple(sorted(_fitted(begin, INSTRUMENT_ERRORS, each), key=lambda one: _cost(one, begin)))


def alternative_explanation(
    searched: Searched, plain: Sequence[Candidate] | None = None, *, level: float = LEVEL
) -> AlternativeExplanation | None:
    """The plain error that does as well as all that was added and better than each part of it; else None.

    `plain`: the plain errors where they have been fitted already.
    """
    named, start, begin = [step.best.effect for step in searched.steps], searched.start, _begin(searched)
    paid = searched.current.chi2 + 2 * (searched.current.values.size - start.values.size)
    standing = {s.key for s in searched.first.others if s.p_adjusted <= level}
    looked = plain_errors(searched) if plain is None else plain
    best = next((one for one in looked if one.effect.key in standing and _inside(one, begin)), None)
    if best is None or _cost(best, begin) >= paid + (AS_GOOD if named else -AS_GOOD):
        return None
    if _cost(best, begin) >= min((one.cost for one in _fitted(begin, named)), default=np.inf) - AS_GOOD:
        return None
    assert isinstance(best.effect, InstrumentError)
    sizes = tuple(zip(best.effect.parameters, best.own_values.tolist(), strict=True))
    return AlternativeExplanation(
        best.effect.key,
        best.effect.words,
        best.effect.covariate,
        sizes,
        tuple(effect.key for effect in named),
        paid - _cost(best, begin),
        float(best.values[0]),
    )


def _cost(one: Candidate, begin: Fit) -> float:
    """chi^2 + 2 q, and what its range was searched for."""
    return one.cost + 2 * float(np.log(len(one.effect.starts(begin.data))))


def _inside(one: Candidate, begin: Fit) -> bool:
    """No parameter stands at an end of its range; an angle has none."""
    assert isinstance(one.effect, InstrumentError)
    return all(
        p.unit == "rad" or _clear(value, p.bounds)
        for value, p in zip(one.own_values, one.effect.parameters_on(begin.data), strict=True)
    )


def _clear(value: float, bounds: Pair) -> bool:
    """Of either end, relative to it where the range is of one sign: periods and times are."""
    low, high = bounds
    near_low, near_high = (EDGE * abs(end) if low > 0 else EDGE * (high - low) / 10 for end in bounds)
    return low + near_low < value < high - near_high


def _begin(searched: Searched) -> Fit:
    return replace(searched.start, noise=searched.current.noise)


def suggested(fitted: Fit) -> tuple[Candidate, ...]:
    """Plain errors that take more off a fit than they cost, the best first: what to try, not what is there."""
    others = [one for one in INSTRUMENT_ERRORS if one.key not in fitted.model.keys]
    better = [one for one in _fitted(fitted, others) if one.cost < fitted.chi2 - AS_GOOD]
    return tuple(sorted(better, key=lambda one: one.cost))


def _fitted(begin: Fit, effects: Sequence[Effect], each: Each = in_turn) -> Iterator[Candidate]:
    for refit in each(partial(refit_with, begin), [one for one in effects if not one.missing(begin.data)]):
        with suppress(*CANNOT_FIT):
            yield refit()
