"""How much speaks for each effect that is not in the model, and what it would leave: the screen of `diagnose`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT, Candidate, refit_with
from calibration.diagnosis.score_test import LEVEL, Scored, score_test
from calibration.diagnosis.vision_depth_check import in_picture
from calibration.effects import PLAIN
from calibration.fit.least_squares import Fit
from calibration.model.stages import Effect
from calibration.report.drawing import overlay
from calibration.workbench.models import Fitted
from calibration.workbench.opened import Opened
from tactilevision.plots.diagnosis import Overlay

REFITTED = 6  # cards that show at once what they would leave; the others do when they are opened
OF_FORCE, OF_PICTURE = "the force", "the picture's depth"


@dataclass(frozen=True, slots=True)
class Evidence:
    """One effect that could be added.

    `p_adjusted` for having looked at all, NaN where it was not looked at, then `why`; `of` what it acts on;
    `fitted` and `shown` what it would leave, where it was fitted.
    """

    effect: Effect
    p_adjusted: float = nan
    why: str = ""
    of: str = OF_FORCE
    fitted: Candidate | None = None
    shown: Overlay | None = None

    @property
    def stands_out(self) -> bool:
        """Whether it is beyond chance."""
        return self.p_adjusted < LEVEL


def look(opened: Opened, now: Fitted, *, seed: int = 0) -> tuple[Evidence, ...]:
    """Every effect that is not in the model: what stands out most first, what these data cannot show last."""
    base, rng = now.found.models[-1].fitted, np.random.default_rng(seed)
    tested = score_test(base, opened.catalogue, rng=rng, of_rig=True)
    known = {effect.key: effect for effect in (*opened.catalogue, *PLAIN.values())}
    scored = sorted((*tested.effects, *(one for one in tested.others if one.key in PLAIN)), key=_rank)
    seen = _of_picture(now, rng)
    there = {one.effect.key for one in seen}
    found = [Evidence(known[one.key], one.p_adjusted) for one in scored if one.key not in there]
    untested = [
        Evidence(known[key], why=why)
        for key, why in tested.not_testable.items()
        if key not in there and key not in base.model.keys
    ]
    return (*sorted((*found, *seen), key=lambda one: one.p_adjusted), *untested)


def _rank(one: Scored) -> tuple[float, float]:
    return one.p_adjusted, -one.statistic


def _of_picture(now: Fitted, rng: np.random.Generator) -> list[Evidence]:
    """Effects on the depth that the picture reads, where there is a certified one."""
    pictured = now.found.pictured
    with suppress(*CANNOT_FIT):
        seen = pictured[-1].fitted if pictured else None
        if seen is not None:
            shown = {one.key: one for one in in_picture(seen.data) if one.key not in seen.model.keys}
            tested = score_test(seen, list(shown.values()), rng=rng)
            return [Evidence(shown[one.key], one.p_adjusted, of=OF_PICTURE) for one in tested.effects]
    return []


def with_pictures(
    now: Fitted, evidence: Sequence[Evidence], *, tell: Callable[[tuple[Evidence, ...]], bool]
) -> None:
    """Fit the effects that stand out most, and hand over all after each; `tell` answers whether to go on."""
    table = list(evidence)
    for k, one in enumerate(table[:REFITTED]):
        if one.stands_out and one.of == OF_FORCE:
            table[k] = opened_card(now, one)
            if not tell(tuple(table)):
                return
    tell((*sorted(table[:REFITTED], key=_cost), *table[REFITTED:]))


def _cost(one: Evidence) -> float:
    """What is left with it and what it costs, as a diagnosis ranks candidates; those not fitted come last."""
    return inf if one.fitted is None else one.fitted.cost


def opened_card(now: Fitted, one: Evidence) -> Evidence:
    """The effect fitted on top of the model, with what it would leave; with `why` where it cannot be fitted."""
    base: Fit = now.found.models[-1].fitted
    if one.of != OF_FORCE or one.fitted is not None:
        return one
    try:
        fitted = refit_with(base, one.effect)
        return replace(one, fitted=fitted, shown=overlay(base, fitted))
    except Exception as fault:  # a private effect may raise anything; the page lives on
        return replace(one, why=f"it cannot be fitted: {str(fault) or type(fault).__name__}")
