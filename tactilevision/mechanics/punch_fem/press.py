"""Press a flat punch into a gel pad to given depths, and return the solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.newton import State, contact_at, march
from tactilevision.mechanics.punch_fem.problem import Model, PunchProblem, build
from tactilevision.mechanics.punch_fem.solid import stored_energy
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class PunchSolution:
    """A press at T depths. Axes: r outward, z up, out of the gel; material coordinates are those before the press.

    `depth_mm`, `force_N`, `energy_N_mm` (T,): the punch's depth and force into the gel, and the strain energy.
    `r_mm` (S,) material radii of the surface's nodes; `u_r_mm`, `u_z_mm` (T, S) their displacements, the rise
    around the punch positive. `pressure_MPa`, `shear_MPa` (T, C) true contact
    tractions on the gel, shear positive outward along the punch; None where a face is glued. `steps`: the
    equilibrium of every attempted step, or why there is none.
    """

    depth_mm: Floats
    force_N: Floats
    energy_N_mm: Floats
    r_mm: Floats
    u_r_mm: Floats
    u_z_mm: Floats
    pressure_MPa: Floats | None
    shear_MPa: Floats | None
    steps: tuple[State | str, ...]


def surface_profile(model: Model, state: State) -> tuple[Floats, Floats]:
    """Return the material radii (S,) of the surface nodes, and (u_r, u_z) there (2, S), all in mm."""
    dofs = model.mesh.surface.dofs
    _, first = np.unique(dofs[:, :3], return_index=True)
    across, along = dofs[:, :3].ravel()[first], dofs[:, 3:6].ravel()[first]
    r = model.mesh.nodes_mm[across // 2, 0]
    order = np.argsort(r)
    return r[order], np.stack([state.u[across[order]], state.u[along[order]]])


def contact_tractions(model: Model, state: State) -> tuple[Floats, Floats] | None:
    """Return the true pressure and shear (C,), in MPa, at the contact points; None for a glued face."""
    contact = contact_at(model, state.u, history=state.history)
    if contact is None or state.history is None:
        return None
    surface = model.mesh.surface
    local = state.u[surface.dofs]
    r = surface.r_mm + np.einsum("kqn,kn->kq", surface.shape, local[:, :3])
    dr = 1 + np.einsum("kqn,kn->kq", surface.slope, local[:, :3])
    dz = np.einsum("kqn,kn->kq", surface.slope, local[:, 3:6])
    stretch = r / surface.r_mm * np.hypot(dr, dz)  # deformed over reference area
    return (contact.pressure_MPa / stretch).ravel(), (state.history.shear_MPa / stretch).ravel()


def energy(model: Model, state: State) -> float:
    """Return the strain energy in N mm, without that of the contact penalty."""
    return stored_energy(
        model.mesh, model.problem.law, material=model.problem.material, u=state.u, pressure=state.pressure
    )


def press_to_depths(problem: PunchProblem, depths_mm: npt.ArrayLike) -> PunchSolution:
    """Solve `problem` at each depth (mm, into the gel) in the given order; smaller after larger ones unload.

    Assumes quasi-static, hyperelastic gel; the rest is stated in problem, laws and contact. Friction depends on
    the path, so ask for the depths in the order in which they occur; intermediate steps are added where needed.
    Raises InputError for depths outside [0, thickness), ConvergenceError where no equilibrium is found.
    """
    depths = np.atleast_1d(np.asarray(depths_mm, dtype=float))
    if depths.ndim != 1 or depths.size == 0 or not np.isfinite(depths).all() or depths.min() < 0:
        raise InputError("depths_mm is a list of finite numbers from 0 up", where="punch_fem", value=depths_mm)
    if depths.max() >= problem.thickness_mm:
        raise InputError(
            "a depth reaches through the gel",
            where="press_to_depths",
            value=float(depths.max()),
            remedy=f"The gel is {problem.thickness_mm} mm thick.",
        )
    model = build(problem)
    steps: list[State | str] = []
    states = list(march(model, depths.tolist(), log=steps))
    profiles = np.stack([surface_profile(model, state)[1] for state in states])
    touching = [found for state in states if (found := contact_tractions(model, state)) is not None]
    return PunchSolution(
        depth_mm=np.array([state.depth_mm for state in states]),
        force_N=np.array([state.force_N for state in states]),
        energy_N_mm=np.array([energy(model, state) for state in states]),
        r_mm=surface_profile(model, states[0])[0],
        u_r_mm=profiles[:, 0],
        u_z_mm=profiles[:, 1],
        pressure_MPa=np.stack([found[0] for found in touching]) if touching else None,
        shear_MPa=np.stack([found[1] for found in touching]) if touching else None,
        steps=tuple(steps),
    )
