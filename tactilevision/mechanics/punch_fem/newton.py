"""Solve a load step by Newton's method, and load and unload in adaptive steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from tactilevision.errors import ConvergenceError
from tactilevision.mechanics.punch_fem.contact import ContactHistory, ContactState, RoundedPunch, touch, untouched
from tactilevision.mechanics.punch_fem.discretisation import Discretisation, assemble, factorise, scatter
from tactilevision.mechanics.punch_fem.problem import Model
from tactilevision.mechanics.punch_fem.solid import ElementSystem, corner_volumes, deform, linearise
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats

# Newton's method for one load step: displacement and pressure.


@dataclass(frozen=True, slots=True)
class State:
    """An equilibrium: unknowns `u` (N,), `pressure` (E, 3), contact history, punch depth and force on the gel,
    Newton's iterations, and whether the surface has folded (only if the problem allows it).
    """

    u: Floats
    pressure: Floats
    history: ContactHistory | None
    depth_mm: float
    force_N: float
    iterations: int
    folded: bool = False


MAX_ITERATIONS = 10  # of one step
FORCE_TOLERANCE = 1e-6  # out-of-balance force over the punch's
CHATTER_TOLERANCE = 1e-4  # the same, where single contact points alternate between stick and slip; P is right
VOLUME_TOLERANCE = 1e-9  # of each element's volume
CHATTER_VOLUME = 1e-6  # of each element's volume, where contact points chatter
# A step that converges is here by the fifth iteration; more iterations cost more than a shorter step. But at first
# touch stick and slip have the same extent however short the step, and later points may change one by one: there
# more iterations are needed.
LATE = 5  # iterations, see above
LATE_ERROR = 1e-2  # relative out-of-balance force that is too much by then
WORST_ERROR = 3  # relative out-of-balance force that is too much at any time
MAX_WITH_PATIENCE = 30  # iterations of one step there


def at_rest(model: Model) -> State:
    """Return the undeformed gel, the punch just touching."""
    mesh, punch = model.mesh, model.problem.punch
    history = untouched(mesh.surface, punch) if isinstance(punch, RoundedPunch) else None
    return State(np.zeros(mesh.size), np.zeros((len(mesh.dofs), 3)), history, 0.0, 0.0, 0)


def solve_step(
    model: Model, last: State, *, depth_mm: float, guess: tuple[Floats, Floats], patient: bool = False
) -> State | str:
    """Return the equilibrium at `depth_mm`, from the converged `last` and a guess (u (n,) in mm, pressure), or
    why there is none.

    Where the guess has another depth, the first iteration is the tangent predictor. `patient`
    goes on where a shorter step would usually be cheaper.
    """
    mesh, (u, pressure) = model.mesh, guess
    jump, factors, errors = -depth_mm - u[mesh.punch], None, (np.inf, np.inf)
    history, most = last.history, MAX_WITH_PATIENCE if patient else MAX_ITERATIONS
    for iteration in range(most + 1):
        state = deform(mesh, u)
        if not (state.volume.min() > 0 and state.plane.min() > 0):
            return "an element turned inside out"
        solid = linearise(mesh, model.problem.law, material=model.problem.material, state=state, pressure=pressure)
        contact = contact_at(model, u, history=history, keep=iteration == 0)
        residual = _sum(model, solid.internal, contact)
        error = _imbalance(model, residual)
        late = iteration >= LATE and error > LATE_ERROR and not patient
        if not np.isfinite(error) or (iteration > 1 and error > WORST_ERROR) or late:
            return f"the iteration diverges (residual {error:.1e})"
        if abs(error - errors[0]) < FORCE_TOLERANCE * error and min(error, errors[1]) > CHATTER_TOLERANCE:
            break  # contact points alternate between two states
        errors = errors[1], error
        chatters = iteration > LATE
        settled = jump == 0 and (contact is None or iteration > 0)
        settled = settled and error < (CHATTER_TOLERANCE if chatters else FORCE_TOLERANCE)
        if settled and _volume_error(mesh, solid) < (CHATTER_VOLUME if chatters else VOLUME_TOLERANCE):
            folded = bool(corner_volumes(mesh, u).min() <= 0)
            if folded and not model.problem.may_fold:
                return "the surface folds at the punch's edge"
            reaction = -float(residual[mesh.punch])
            reached = None if contact is None else contact.history
            return State(u, pressure, reached, -float(u[mesh.punch]), reaction, iteration, folded)
        if jump or error > FORCE_TOLERANCE:  # else the volume alone is corrected, by the last factors
            factors = None
        du, factors = _increment(model, solid, contact, jump=jump, factors=factors)
        jump = 0.0
        if contact is not None and last.history is not None:
            history = replace(last.history, trial_MPa=contact.trial_MPa)
        u = u + du
        local = du[mesh.dofs]
        pressure = pressure + solid.recover_constant - (solid.recover_slope @ local[:, :, None])[:, :, 0]
    return f"no convergence in {iteration} iterations (residual {error:.1e})"


def contact_at(
    model: Model, u: Floats, *, history: ContactHistory | None, keep: bool = False
) -> ContactState | None:
    """Return the contact forces at the unknowns `u` (U,) mm; None for a glued face."""
    punch = model.problem.punch
    if not isinstance(punch, RoundedPunch) or history is None:
        return None
    return touch(model.mesh.surface, punch, stiffness=model.contact_stiffness, u=u, history=history, keep=keep)


def _imbalance(model: Model, residual: Floats) -> float:
    """Return the norm of the out-of-balance forces (N,) over the punch's force."""
    problem, punch = model.problem, model.mesh.punch
    floor = 1e-5 * problem.material.youngs_modulus_MPa * problem.thickness_mm**2
    scale = max(abs(float(residual[punch])), floor)
    return float(np.linalg.norm(residual[model.pattern.free])) / scale


def _volume_error(mesh: Discretisation, solid: ElementSystem) -> float:
    """Return the largest error of an element's mean volume change."""
    return float(np.abs(solid.pressure_residual[:, 0] / mesh.weight_mm3.sum(axis=1)).max())


def _sum(model: Model, forces: Floats, contact: ContactState | None) -> Floats:
    parts = (forces,) if contact is None else (forces, contact.force)
    return scatter(model.mesh.size, model.tables, forces=parts)


def _increment(
    model: Model, solid: ElementSystem, contact: ContactState | None, *, jump: float, factors: SuperLU | None
) -> tuple[Floats, SuperLU]:
    """Return Newton's increment of all unknowns, the punch's prescribed `jump` included, and the factors."""
    mesh, free = model.mesh, model.pattern.free
    right, du = -_sum(model, solid.force, contact), np.zeros(mesh.size)
    if factors is None:
        parts = (solid.stiffness,) if contact is None else (solid.stiffness, contact.stiffness)
        if jump:
            du[mesh.punch] = jump
            for dofs, stiffness in zip(model.tables, parts, strict=True):
                right -= scatter(mesh.size, (dofs,), forces=((stiffness @ du[dofs][:, :, None])[:, :, 0],))
        factors = factorise(assemble(model.pattern, parts))
    du[free] = factors.solve(right[free])
    return du, factors


# Loading and unloading in adaptive steps: a step that fails is cut.

SMALLEST_CUT = 1 / 64  # of a step, below which none is cut further
QUICK = 5  # iterations after which a step may grow


def march(model: Model, targets: Sequence[float], *, log: list[State | str]) -> Iterator[State]:
    """Yield the equilibrium at each depth (mm) of `targets` in turn.

    Every attempt is added to `log`: its equilibrium, or why there is none. Raises ConvergenceError where a step
    fails even at 1/64 of its length; what was yielded before stays true.
    """
    last, before, patient, punch = at_rest(model), None, True, model.problem.punch
    # the first touch wraps the edge's radius; a glued face has none
    step = punch.edge_radius_mm / 4 if isinstance(punch, RoundedPunch) else np.inf
    for target in targets:
        whole = abs(target - last.depth_mm)
        while abs(left := target - last.depth_mm) > 1e-12 * max(abs(target), whole):
            parts = np.ceil(abs(left) / step - ROUNDING)
            aim = target if parts <= 1 else last.depth_mm + left / parts
            guess = _extrapolate(before, last, aim)
            outcome = solve_step(model, last, depth_mm=aim, guess=guess, patient=patient)
            log.append(outcome)
            taken = abs(aim - last.depth_mm)
            if isinstance(outcome, str):
                step, patient = taken / 2, True
                if step < SMALLEST_CUT * whole:
                    raise ConvergenceError(_lost(last, aim, outcome))
                continue
            step = max(step, taken * 2) if outcome.iterations <= QUICK else max(step, taken)
            before, last, patient = last, outcome, False
        yield last


def reached(model: Model, targets: Sequence[float], *, log: list[State | str]) -> list[State]:
    """Return the equilibria at the depths (mm) of `targets`, as far as they are found; `log` as in march."""
    states = []
    with suppress(ConvergenceError):
        for state in march(model, targets, log=log):
            states.append(state)  # noqa: PERF402 - what was reached before an error is kept
    return states


def _extrapolate(before: State | None, last: State, aim: float) -> tuple[Floats, Floats]:
    """Continue the line through the last two equilibria.

    From one alone Newton's method makes its own prediction.
    """
    if before is None or last.depth_mm == before.depth_mm:
        return last.u, last.pressure
    share = (aim - last.depth_mm) / (last.depth_mm - before.depth_mm)
    if not 0 < share <= 2:
        return last.u, last.pressure
    return last.u + share * (last.u - before.u), last.pressure + share * (last.pressure - before.pressure)


def _lost(last: State, aim: float, failure: str) -> str:
    return (
        f"punch_fem: no equilibrium found at {aim:.5g} mm: {failure}. The press converged to depth "
        f"{last.depth_mm:.4g} mm, force {last.force_N:.4g} N. "
        "Use a finer mesh, a larger edge radius or smaller steps."
    )
