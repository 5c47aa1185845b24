"""What one search for effects ends in: what stands, what is left, and what plain error would do as well."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.diagnosis.alternative_explanation import (
    AlternativeExplanation,
    alternative_explanation,
    plain_errors,
)
from calibration.diagnosis.diagnosis import NOTHING_ODD
from calibration.diagnosis.forward_selection import MOST, Searched, Step
from calibration.diagnosis.refit import Candidate
from calibration.fit.least_squares import Fit
from calibration.inputs.deadline import Watch
from calibration.repeats.outlying_presses import OutlyingPresses

LEVEL = 0.05  # family-wise chance of naming an effect where there is none
MOSTLY = 0.9  # of a misfit explained: an effect's form that is off by a third leaves a tenth of the squares


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one search ends in: the steps that stand, what was tried where something is left or `otherwise` does as
    well, p of what is left, and the plain error nearest to it.
    """

    searched: Searched
    steps: tuple[Step, ...]
    tried: tuple[str, ...]
    left: float
    unknown: bool
    flags: tuple[str, ...]
    odd: OutlyingPresses = NOTHING_ODD
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


def outcome(searched: Searched, level: float, odd: OutlyingPresses = NOTHING_ODD) -> Outcome:
    """Whether the steps stand: not where they leave something and explain but a part of it, or are all used up."""
    left, steps = searched.last.lack_of_fit, searched.steps
    flags = ["bend_within_theory"] if getattr(searched.current.model.law, "bent", False) else []
    flags += ["press_stands_out"] if odd.presses else []
    flags += ["presses_wander"] if odd.wanders else []
    flags += ["presses_scatter"] if odd.scattered else []
    if searched.stopped:
        so_far = tuple(c.effect.key for c in searched.rounds[-1].candidates)
        return Outcome(searched, steps, () if steps else so_far, left, not steps, tuple(flags), odd)
    odd_alone = odd or (odd.scattered and not steps)
    if left >= level and not odd_alone:
        return Outcome(searched, steps, (), left, False, tuple(flags))
    if 0 < len(steps) < MOST and searched.explained > MOSTLY and not odd_alone:  # named; its form is not exact
        return Outcome(searched, steps, (), left, False, (*flags, "small_remainder"))
    tried = [s.best.effect.key for s in steps] or [s.key for s in searched.first.effects if s.p_adjusted < LEVEL]
    return Outcome(searched, (), tuple(tried), left, True, tuple(flags), odd)


def against_instrument_errors(force: Outcome, watch: Watch) -> Outcome:
    """With the plain error that does as well as what was named, which then stands no more, or better than what was
    tried.
    """
    if watch.over or not (force.steps or (force.unknown and not force.odd)):
        return force
    watch.tell("holding plain errors of an instrument against it")
    plain = plain_errors(force.searched)
    found = alternative_explanation(force.searched, plain)
    nearest_of_all = next(iter(plain), None) if found is not None or force.unknown else None
    if found is None:
        return replace(force, plain=nearest_of_all)
    return replace(
        force,
        steps=(),
        tried=force.tried or found.instead_of,
        unknown=True,
        alternative_explanation=found,
        plain=nearest_of_all,
    )
