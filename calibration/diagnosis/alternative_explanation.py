"""What a search has named, held against one plain error of an instrument that no effect of the catalogue has.

Several effects can follow together what one function of one covariate does alone (a force sensor that creeps
looks like a relaxation beside an adhesion), and then leave nothing. In place of all that was named, each plain
error is fitted on what the search began with, under the noise that it ended with, and costs chi^2 + 2 q. What was
named is not identified where one plain error costs no more than an equally good fit may (search.AS_GOOD), and less
by as much than each of the named effects does alone, which are as plain as it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.diagnosis.forward_selection import AS_GOOD, Searched
from calibration.diagnosis.refit import CANNOT_FIT, Candidate, refit_with
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS, InstrumentError
from calibration.fit.least_squares import Fit
from calibration.model.parameters import Parameter
from calibration.model.stages import Effect


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


def plain_errors(searched: Searched) -> tuple[Candidate, ...]:
    """Each plain error on what a search began with, under the noise that it ended with, the nearest first."""
    return tuple(sorted(_fitted(_begin(searched), INSTRUMENT_ERRORS), key=lambda one: one.cost))


def alternative_explanation(
    searched: Searched, plain: Sequence[Candidate] | None = None
) -> AlternativeExplanation | None:
    """The plain error that does as well as all that was added and better than each part of it; else None.

    `plain`: the plain errors where they have been fitted already.
    """
    named, start, begin = [step.best.effect for step in searched.steps], searched.start, _begin(searched)
    paid = searched.current.chi2 + 2 * (searched.current.values.size - start.values.size)
    best = next(iter(plain_errors(searched) if plain is None else plain), None)
    if best is None or best.cost >= paid + (AS_GOOD if named else -AS_GOOD):
        return None
    if best.cost >= min((one.cost for one in _fitted(begin, named)), default=np.inf) - AS_GOOD:
        return None
    assert isinstance(best.effect, InstrumentError)
    sizes = tuple(zip(best.effect.parameters, best.own_values.tolist(), strict=True))
    return AlternativeExplanation(
        best.effect.key,
        best.effect.words,
        best.effect.covariate,
        sizes,
        tuple(effect.key for effect in named),
        paid - best.cost,
        float(best.values[0]),
    )


def _begin(searched: Searched) -> Fit:
    return replace(searched.start, noise=searched.current.noise)


def suggested(fitted: Fit) -> tuple[Candidate, ...]:
    """Plain errors that take more off a fit than they cost, the best first: what to try, not what is there."""
    others = [one for one in INSTRUMENT_ERRORS if one.key not in fitted.model.keys]
    better = [one for one in _fitted(fitted, others) if one.cost < fitted.chi2 - AS_GOOD]
    return tuple(sorted(better, key=lambda one: one.cost))


def _fitted(begin: Fit, effects: Sequence[Effect]) -> Iterator[Candidate]:
    for effect in effects:
        if not effect.missing(begin.data):
            with suppress(*CANNOT_FIT):
                yield refit_with(begin, effect)
