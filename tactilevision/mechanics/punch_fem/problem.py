"""A punch problem and its discrete model, which stay the same during one press."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import (
    Discretisation,
    Ints,
    MeshSettings,
    Pattern,
    discretise,
    find_pattern,
    graded_mesh,
)
from tactilevision.mechanics.punch_fem.laws import Law, NeoHooke
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Material


@dataclass(frozen=True, slots=True)
class GluedFace:
    """A perfectly sharp flat punch: the nodes with r <= radius_mm move down with it.

    With `slides` they keep their freedom along r, as in Hayes' linear problem: valid for small depths only, since
    nodes may pass the edge. Glued, the surface at the edge folds beyond a depth of .13 to .2 of the thickness.
    """

    radius_mm: float
    slides: bool = False


@dataclass(frozen=True, slots=True)
class PunchProblem:
    """One gel pad and one punch.

    The pad is a disc of `thickness_mm` and `pad_radius_mm`, bonded to a rigid base; its side is free, or held in
    both directions with `side_fixed`. `penalty` is the contact stiffness times edge_size_mm over Young's modulus:
    the punch sinks in by edge_size_mm / penalty times pressure over modulus; made stiffer, contact points chatter.
    `mesh` None takes `default_mesh`. A press ends where the surface folds at the punch's edge: where a corner of
    an element turns inside out. With `may_fold` it goes on while all quadrature points keep their volume, and the
    caller must show that the results do not depend on the fold.
    """

    material: Material
    punch: RoundedPunch | GluedFace
    thickness_mm: float
    pad_radius_mm: float
    law: Law = field(default_factory=NeoHooke)
    side_fixed: bool = False
    penalty: float = 80
    mesh: MeshSettings | None = None
    may_fold: bool = False


def default_mesh(problem: PunchProblem) -> MeshSettings:
    """Return element sizes of a third of the edge radius at the edge (1/50 of the radius if sharp), growing to 1/6
    of the gel.

    Where there is little friction, gel from further inside slides out round the edge, and is meshed for it.
    """
    largest = problem.thickness_mm / 6
    if isinstance(problem.punch, GluedFace):
        return MeshSettings(min(problem.punch.radius_mm / 50, largest), largest)
    edge = problem.punch.edge_radius_mm
    slides_out = max(0.0, 1 - 3 * problem.punch.friction) * problem.thickness_mm / 12
    return MeshSettings(min(edge / 3, largest), largest, inside_mm=2 * edge + slides_out, outside_mm=edge)


@dataclass(frozen=True, eq=False)
class Model:
    """A problem on its mesh. `held` (N,) unknowns that stay 0; glued ones share the punch's own number already."""

    problem: PunchProblem
    mesh: Discretisation
    held: Bools

    @property
    def contact_stiffness(self) -> float:
        """The penalty in MPa/mm."""
        size_mm = (self.problem.mesh or default_mesh(self.problem)).edge_size_mm
        return self.problem.penalty * self.problem.material.youngs_modulus_MPa / size_mm

    @property
    def tables(self) -> tuple[Ints, ...]:
        """The unknowns (K, n) of the elements and, unless the face is glued, of the surface's edges."""
        mesh = self.mesh
        return (mesh.dofs,) if isinstance(self.problem.punch, GluedFace) else (mesh.dofs, mesh.surface.dofs)

    @cached_property
    def pattern(self) -> Pattern:
        """The sparse pattern of the unknowns that are free at given depths of the punch."""
        free = ~self.held
        free[self.mesh.punch] = False
        return find_pattern(self.tables, free)


def build(problem: PunchProblem) -> Model:
    """Mesh `problem` and set its boundary conditions. Raises InputError for a pad that cannot be."""
    if not problem.penalty > 0:
        raise InputError("the contact penalty must be above 0", where="PunchProblem", value=problem.penalty)
    settings = problem.mesh or default_mesh(problem)
    grid = graded_mesh(
        problem.punch.radius_mm, problem.thickness_mm, pad_radius_mm=problem.pad_radius_mm, settings=settings
    )
    mesh = discretise(grid)
    r, z = mesh.nodes_mm.T
    held = np.zeros(mesh.size, dtype=bool)
    tiny = ROUNDING * problem.thickness_mm
    base = z < tiny
    held[:-1:2] |= base | (r < tiny)
    held[1:-1:2] |= base
    if problem.side_fixed:
        side = r > problem.pad_radius_mm - tiny
        held[:-1:2] |= side
        held[1:-1:2] |= side
    if isinstance(problem.punch, GluedFace):
        glued = np.flatnonzero((z > problem.thickness_mm - tiny) & (r <= problem.punch.radius_mm + tiny))
        alias = np.arange(mesh.size)
        alias[2 * glued + 1] = mesh.punch
        held[2 * glued + 1] = True
        if not problem.punch.slides:
            held[2 * glued] = True
        # Material turns without bound at the very edge of a sharp glued face; only elsewhere is that a fold.
        corner_gradient = mesh.corner_gradient.copy()
        corner_gradient[np.isin(mesh.dofs[:, :4] // 2, glued[np.argmax(r[glued])])] = 0.0
        surface = replace(mesh.surface, dofs=alias[mesh.surface.dofs])
        mesh = replace(mesh, dofs=alias[mesh.dofs], surface=surface, corner_gradient=corner_gradient)
    return Model(problem, mesh, held)
