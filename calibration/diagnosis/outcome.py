"""What one search for effects ends in: what stands, what is left, and what plain error would do as well."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.alternative_explanation import (
    AlternativeExplanation,
    alternative_explanation,
    plain_errors,
)
from calibration.diagnosis.diagnosis import NOTHING_ODD
from calibration.diagnosis.forward_selection import MAX_EFFECTS, Searched, Step
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.remainder import Remainder, remainder
from calibration.diagnosis.score_test import LEVEL
from calibration.fit.least_squares import Fit
from calibration.inputs.deadline import Watch
from calibration.repeats.outlying_presses import STANDS_OUT, WANDERS, OutlyingPresses, outlying_presses

MOSTLY = 0.9  # of a misfit explained: an effect's form that is off by a third leaves a tenth of the squares
CURED = 0.5  # the same where frames are then read anew: the form need only name the cause, and is looked at again


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one search ends in: the steps that stand, what was tried where something is left or `otherwise` does as
    well, p of what is left, what it is, and the plain error nearest to it.
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
        """The candidates of each step that stands."""
        return [step.equals for step in self.steps]

    @property
    def fitted(self) -> Fit:
        """The last fit that stands."""
        return self.steps[-1].fitted if self.steps else self.searched.start


def odd_presses(searched: Searched, level: float) -> OutlyingPresses:
    """What is odd among the presses, as far as the test says so."""
    told = {s.key: s.p_adjusted for s in searched.last.others if s.p_adjusted <= level}
    wanders = [(key.removeprefix(WANDERS), p) for key, p in told.items() if key.startswith(WANDERS)]
    odd = outlying_presses(searched.current, wanders=wanders)
    return odd if STANDS_OUT in told else replace(odd, presses=(), foreign=False)


def outcome(searched: Searched, level: float, odd: OutlyingPresses = NOTHING_ODD) -> Outcome:
    """Whether the steps stand: not where they leave what matters and explain but a part, or are all used up."""
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
    enough = CURED if searched.to_be_cured else MOSTLY
    # its form is not exact
    mostly = 0 < len(steps) < MAX_EFFECTS and searched.explained > enough and not odd.wanders
    matters = over is not None and over.matters and not mostly
    if not (matters or odd.presses or (odd.scattered and not steps)):
        return Outcome(searched, steps, (), left, False, tuple(flags), replace(odd, wanders=()), over)
    tried = [s.best.effect.key for s in steps] or [s.key for s in searched.first.effects if s.p_adjusted < LEVEL]
    return Outcome(searched, (), tuple(tried), left, True, tuple(flags), odd, over)


def against_instrument_errors(force: Outcome, watch: Watch, *, level: float) -> Outcome:
    """With the plain error that does as well as what was named, which then stands no more, or better than what was
    tried.
    """
    if watch.over or not (force.steps or (force.unknown and not force.odd.presses)):
        return force
    watch.tell("holding plain errors of an instrument against it")
    plain = plain_errors(force.searched, watch.each)
    found = alternative_explanation(force.searched, plain, level=level)
    nothing = np.inf if force.searched.steps else force.searched.start.chi2
    helps = (one for one in plain if one.cost < nothing)
    nearest_of_all = next(helps, None) if found is not None or force.unknown else None
    if found is None:
        return replace(force, plain=nearest_of_all)
    tried = force.tried or found.instead_of
    return replace(force, steps=(), tried=tried, unknown=True, alternative_explanation=found, plain=nearest_of_all)
