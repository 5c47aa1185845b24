"""How far E's interval reaches to what other explanations would make of E.

Each names E with it over E of the fit that stands; the interval is stretched by that, its value stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.diagnosis.confirmation import inside
from calibration.diagnosis.forward_selection import Searched
from calibration.diagnosis.outcome import Outcome
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.score_test import LEVEL
from calibration.diagnosis.vision_depth_check import risen
from calibration.result.result import CalibrationResult


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
