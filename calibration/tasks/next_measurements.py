"""What to measure next: presses that tell candidates apart, or follow what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calibration.diagnosis import manual_checks
from calibration.diagnosis.experiment_design import NextMeasurement, measure_next
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.unexplained import Unexplained
from calibration.fit.least_squares import Fit
from calibration.repeats.outlying_presses import OutlyingPresses

WORTH = 0.5  # std: an action that brings less is not worth its minutes
MAX_SIGMA = 10.0  # std: one that brings more is no better for it


def plan_next(
    base: Fit,
    sets: Sequence[Sequence[tuple[Candidate, ...]]],
    *,
    odd: OutlyingPresses,
    left: Unexplained | None,
    instead: Sequence[Candidate],
    bias: Mapping[str, float],
) -> tuple[NextMeasurement, ...]:
    """Odd presses first, then what tells candidates apart or follows what is left, then what nothing shows.

    `sets`: for each search, the candidates of each step; `instead`: those of a beta out of theory.
    """
    open_sets = [group for one in sets for group in one]
    if not open_sets and instead:
        open_sets = [tuple(instead)]
    plans = [plan for group in open_sets for plan in manual_checks.of_candidates(group)]
    for group in sets[0] or ([tuple(instead)] if instead else []):  # of forces: a picture is no press
        if len(group) > 1:
            plans += measure_next(base, group[0], rivals=group[1:])
            break
    worth = [plan for plan in plans if plan.separation_sigma > WORTH]
    worth.sort(key=lambda plan: -min(plan.separation_sigma, MAX_SIGMA) / plan.minutes)
    follow = manual_checks.of_left(left.covariates) if left is not None else []
    found = [*press_again(odd), *follow, *worth, *manual_checks.of_hidden(bias)]
    return tuple({plan.action: plan for plan in reversed(found)}.values())[::-1]


def press_again(odd: OutlyingPresses) -> tuple[NextMeasurement, ...]:
    """Presses that do not repeat the others are pressed again before anything else is asked of them."""
    if odd.presses:
        names = ", ".join(odd.presses)
        action, minutes = f"press {names} again: the same indenter at the same place", 2.0 * len(odd.presses)
    elif odd.wanders:
        action, minutes = "repeat the first press after the last one: is it still the same?", 3.0
    else:
        return ()
    return (NextMeasurement(action, minutes, float("nan")),)
