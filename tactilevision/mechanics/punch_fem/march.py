"""Loading and unloading in adaptive steps: a step that fails is cut, and what cannot be reached is said."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import ConvergenceError
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.newton import Equations, Failure, State, at_rest, solve_step
from tactilevision.records import Floats

SMALLEST_CUT = 1 / 64  # of a step, below which none is cut further
QUICK = 5  # iterations after which a step may grow


@dataclass(frozen=True, slots=True)
class StepRecord:
    """One attempted step: the load that it aimed at (mm or N), iterations, the out-of-balance force left over the
    punch's, and why it failed ("" where it did not)."""

    target: float
    iterations: int
    imbalance: float
    failure: str = ""


def march(system: Equations, targets: Sequence[float], *, log: list[StepRecord]) -> Iterator[State]:
    """Yield the equilibrium at each of `targets` in turn (depths in mm, or forces in N where force drives).

    Every attempt is added to `log`. Raises ConvergenceError where a step fails even at 1/64 of its length; what
    was yielded before stays true.
    """
    last, before, step = at_rest(system.model), None, first_step(system)
    patient = True
    for target in targets:
        whole = abs(target - _load(system, last))
        while abs(left := target - _load(system, last)) > 1e-12 * max(abs(target), whole):
            parts = np.ceil(abs(left) / step - 1e-9)
            aim = target if parts <= 1 else _load(system, last) + left / parts
            outcome = solve_step(
                system, last, target=aim, guess=_extrapolate(system, before, last, aim), patient=patient
            )
            taken = abs(aim - _load(system, last))
            if isinstance(outcome, Failure):
                log.append(StepRecord(float(aim), 0, float("nan"), outcome.why))
                step, patient = taken / 2, True
                if step < SMALLEST_CUT * whole:
                    raise ConvergenceError(_lost(system, last, aim, outcome))
                continue
            log.append(StepRecord(float(aim), outcome.iterations, outcome.imbalance))
            step = max(step, taken * 2) if outcome.iterations <= QUICK else max(step, taken)
            before, last, patient = last, outcome, False
        yield last


def first_step(system: Equations) -> float:
    """The first step to try: a quarter of the edge radius, since the first touch wraps the edge; glued, any."""
    punch = system.model.problem.punch
    if not isinstance(punch, RoundedPunch):
        return np.inf
    depth = punch.edge_radius_mm / 4
    if not system.by_force:
        return depth
    return 2 * punch.radius_mm * system.model.problem.material.youngs_modulus_MPa * depth


def _load(system: Equations, state: State) -> float:
    return state.force_N if system.by_force else state.depth_mm


def _extrapolate(system: Equations, before: State | None, last: State, aim: float) -> tuple[Floats, Floats]:
    """Continue the line through the last two equilibria; from one alone Newton's method makes its own
    prediction."""
    if before is None or _load(system, last) == _load(system, before):
        return last.u, last.pressure
    share = (aim - _load(system, last)) / (_load(system, last) - _load(system, before))
    if not 0 < share <= 2:
        return last.u, last.pressure
    return last.u + share * (last.u - before.u), last.pressure + share * (last.pressure - before.pressure)


def _lost(system: Equations, last: State, aim: float, failure: Failure) -> str:
    unit = "N" if system.by_force else "mm"
    return (
        f"punch_fem: no equilibrium found at {aim:.5g} {unit}: {failure.why}. The press converged to depth "
        f"{last.depth_mm:.4g} mm, force {last.force_N:.4g} N. "
        "Use a finer mesh, a larger edge radius or smaller steps."
    )
