"""The decision rule of a diagnosis: ADEQUATE, IDENTIFIED, AMBIGUOUS or UNKNOWN."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.forward_selection import MAX_EFFECTS, Searched, Step
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.score_test import LEVEL
from calibration.diagnosis.unexplained import (
    AlternativeExplanation,
    Remainder,
    alternative_explanation,
    plain_errors,
    remainder,
)
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import STANDS_OUT, WANDERS, OutlyingPresses, outlying_presses
from calibration.inputs.deadline import Watch
from calibration.result.material import AT_BOUND

MOSTLY = 0.9  # of a misfit explained: an effect's form that is off by a third leaves a tenth of the squares
CORRECTED = 0.5  # the same where the last effect has a treatment: its form need only name the cause
STRANGE_BETA = {"beta_outside_theory", AT_BOUND}  # flags of a slope that is not the contact's
NOTHING_ODD = OutlyingPresses()


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one search, of the force or of the picture's depth.

    `steps` are the effects that stand; `tried` what fitted best where none does; `left` the smallest p of the last
    model's residual; `unknown` is defined in `decide`; `remainder` what is significant of the residual;
    `alternative_explanation` the instrument error that explains as much as the steps did, `plain` the nearest one.
    """

    searched: Searched
    steps: tuple[Step, ...]
    tried: tuple[str, ...]
    left: float
    unknown: bool
    flags: tuple[str, ...]
    odd: OutlyingPresses = NOTHING_ODD
    remainder: Remainder | None = None
    alternative_explanation: AlternativeExplanation | None = None
    plain: Candidate | None = None

    @property
    def sets(self) -> list[tuple[Candidate, ...]]:
        """The candidates of each step that stands, the best first."""
        return [step.equals for step in self.steps]

    @property
    def fitted(self) -> Fit:
        """The last fit that stands."""
        return self.steps[-1].fitted if self.steps else self.searched.start


def decide(searches: Sequence[Outcome], flags: Sequence[str]) -> str:
    """Return the verdict of the searches of the force and of the picture's depth.

    Each search tests, refits and confirms, at most three times; the level is .05, half of it where there are two:

    1. *Significant.* One score test of all effects, covariates, instrument errors and odd presses, calibrated by
       one parametric bootstrap, has p adjusted for all of them at or below the level (`score_test`). Where nothing
       is significant the verdict is ADEQUATE.
    2. *Confirmed.* An effect is added when it is significant (a second one at .005), its size lies inside its
       range, chi^2 + 2 q falls by 6, also without any one reading, and presses held out are predicted better
       (`forward_selection`). Where the freedom that theory leaves the law (a bend, another term of a relaxation)
       costs no more than 6 above that effect, it is used first.
    3. *Equal.* Other effects within 6 of chi^2 + 2 q of it, or nearer than 3 standard deviations, are its rivals
       (`refit.equals`).
    4. *Unknown.* The search explains too little where
       a. a significant residual moves E or a reading by more than .65 std (`Remainder.matters`), unless the
          effects added explain 90 % of the misfit (50 % where the last one has a treatment);
       b. a press is unlike all others, or like presses scatter more than they may and no effect is added;
       c. an instrument error outside the catalogue explains as much as the effects added, or more than all that
          was tried (`unexplained.alternative_explanation`).
       The effects of that search then do not stand.

    The first of these that holds is the verdict:

    - UNKNOWN: a search is unknown;
    - AMBIGUOUS: an effect has rivals, or beta is not one that theory allows (`flags`);
    - IDENTIFIED: an effect was added;
    - ADEQUATE: none was.

    Presses unlike all others are set aside where they are few, and the rest is decided on by itself; the whole is
    UNKNOWN where the other presses' tails reach none of them (`OutlyingPresses.foreign`).
    """
    if any(one.unknown for one in searches):
        return "UNKNOWN"
    if STRANGE_BETA & set(flags) or any(len(equal) > 1 for one in searches for equal in one.sets):
        return "AMBIGUOUS"
    return "IDENTIFIED" if any(one.steps for one in searches) else "ADEQUATE"


def odd_presses(searched: Searched, level: float) -> OutlyingPresses:
    """Return what is odd among the presses, as far as it is significant."""
    significant = {s.key: s.p_adjusted for s in searched.last.others if s.p_adjusted <= level}
    wanders = [(key.removeprefix(WANDERS), p) for key, p in significant.items() if key.startswith(WANDERS)]
    odd = outlying_presses(searched.current, wanders=wanders)
    return odd if STANDS_OUT in significant else replace(odd, presses=(), foreign=False)


def outcome(searched: Searched, level: float, odd: OutlyingPresses = NOTHING_ODD) -> Outcome:
    """Return whether the steps of a search stand, by points 4a and 4b of `decide`."""
    left, steps = searched.last.lack_of_fit, searched.steps
    over = remainder(searched.current, searched.last, level=level) if left <= level else None
    flags = ["bend_within_theory"] if getattr(searched.current.model.law, "bent", False) else []
    flags += ["press_stands_out"] if odd.presses else []
    flags += ["presses_wander"] if odd.wanders else []
    flags += ["presses_scatter"] if odd.scattered else []
    if searched.stopped:
        so_far = tuple(c.effect.key for c in searched.rounds[-1].candidates)
        return Outcome(searched, steps, () if steps else so_far, left, not steps, tuple(flags), odd)
    flags += ["small_remainder"] if over else []
    enough = CORRECTED if searched.to_be_treated else MOSTLY
    mostly = 0 < len(steps) < MAX_EFFECTS and searched.explained > enough and not odd.wanders
    matters = over is not None and over.matters and not mostly
    if not (matters or odd.presses or (odd.scattered and not steps)):
        return Outcome(searched, steps, (), left, False, tuple(flags), replace(odd, wanders=()), over)
    tried = [s.best.effect.key for s in steps] or [s.key for s in searched.first.effects if s.p_adjusted < LEVEL]
    return Outcome(searched, (), tuple(tried), left, True, tuple(flags), odd, over)


def against_instrument_errors(force: Outcome, watch: Watch, *, level: float) -> Outcome:
    """Return the outcome by point 4c of `decide`, with the nearest instrument error."""
    if watch.over or not (force.steps or (force.unknown and not force.odd.presses)):
        return force
    watch.tell("comparing with instrument errors")
    plain = plain_errors(force.searched, watch.each)
    found = alternative_explanation(force.searched, plain, level=level)
    nothing = np.inf if force.searched.steps else force.searched.start.chi2
    helps = (one for one in plain if one.cost < nothing)
    nearest_of_all = next(helps, None) if found is not None or force.unknown else None
    if found is None:
        return replace(force, plain=nearest_of_all)
    tried = force.tried or found.instead_of
    return replace(force, steps=(), tried=tried, unknown=True, alternative_explanation=found, plain=nearest_of_all)
