"""Shape gradients, weights and degrees of freedom of a mesh, computed once; everything nonlinear reads them.

Displacement is Q2 (nine nodes), pressure linear and discontinuous (three modes an element): the pair is
stable up to the incompressible limit. Source: Boffi, Brezzi, Fortin, Mixed Finite Element Methods (2013), 8.6.
Degrees of freedom: 2 i is u_r and 2 i + 1 is u_z of node i; the last one of all is the punch's own displacement
(up, so -depth).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import skfem

from tactilevision.records import Floats

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Surface:
    """The upper surface, element edge by element edge, from the axis outward.

    `dofs` (K, 7): u_r of an edge's three nodes, u_z of them, the punch. `shape` (K, Q, 3) and `slope` (K, Q, 3),
    the derivative by r; `weight_mm2` (K, Q) areas; `r_mm` (K, Q) reference radii.
    """

    dofs: Ints
    shape: Floats
    slope: Floats
    weight_mm2: Floats
    r_mm: Floats


@dataclass(frozen=True, slots=True)
class Discretisation:
    """`nodes_mm` (M, 2); `dofs` (E, 18), first the nine u_r; `gradient` (E, Q, 5, 18) maps them to F - 1;
    `weight_mm3` (E, Q) volumes; `modes` (E, Q, 3) pressure modes; `points_mm` (E, Q, 2) quadrature points;
    `values` (E, Q, 9) of the displacement's shape functions; `corner_gradient` (E, 4, 4, 18) the in-plane part of
    `gradient` at the four corners."""

    nodes_mm: Floats
    dofs: Ints
    gradient: Floats
    weight_mm3: Floats
    modes: Floats
    points_mm: Floats
    values: Floats
    corner_gradient: Floats
    surface: Surface

    @property
    def size(self) -> int:
        """Number of displacement unknowns, the punch's among them."""
        return 2 * len(self.nodes_mm) + 1

    @property
    def punch(self) -> int:
        """The punch's own degree of freedom."""
        return 2 * len(self.nodes_mm)


def discretise(mesh: skfem.MeshQuad, *, order: int = 4, surface_order: int = 8) -> Discretisation:
    """Tabulate basis and quadrature of `mesh`; `order` and `surface_order` are polynomial degrees integrated
    exactly."""
    basis = skfem.Basis(mesh, skfem.ElementQuad2(), intorder=order)
    points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    values = np.stack([np.broadcast_to(np.asarray(b[0]), points.shape[:2]) for b in basis.basis], axis=-1)
    radius = points[..., 0]
    gradient = np.zeros((*radius.shape, 5, 18))
    gradient[:, :, :4] = _plane_gradient(basis)
    gradient[:, :, 4, :9] = values / radius[..., None]
    centre = points.mean(axis=1, keepdims=True)
    spread = np.ptp(points, axis=1, keepdims=True)
    modes = np.concatenate([np.ones((*radius.shape, 1)), (points - centre) / spread], axis=-1)
    nodes = np.asarray(basis.element_dofs).T
    corners = (np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), np.full(4, 0.25))
    return Discretisation(
        nodes_mm=np.asarray(basis.doflocs).T.copy(),
        dofs=np.concatenate([2 * nodes, 2 * nodes + 1], axis=1).astype(np.int64),
        gradient=gradient,
        weight_mm3=2 * np.pi * radius * np.asarray(basis.dx),
        modes=modes,
        points_mm=points,
        values=values,
        corner_gradient=_plane_gradient(skfem.Basis(mesh, skfem.ElementQuad2(), quadrature=corners)),
        surface=_surface(mesh, surface_order),
    )


def _plane_gradient(basis: skfem.Basis) -> Floats:
    """(E, Q, 4, 18): the unknowns of an element to F_rr, F_rz, F_zr, F_zz less the identity."""
    slopes = np.stack([np.moveaxis(np.asarray(b[0].grad), 0, -1) for b in basis.basis], axis=-1)
    gradient = np.zeros((*slopes.shape[:2], 4, 18))
    gradient[:, :, 0:2, :9] = slopes
    gradient[:, :, 2:4, 9:] = slopes
    return gradient


def _surface(mesh: skfem.MeshQuad, order: int) -> Surface:
    top = mesh.p[1].max()
    facets = mesh.facets_satisfying(lambda x: np.isclose(x[1], top), boundaries_only=True)
    facets = facets[np.argsort(mesh.p[0, mesh.facets[:, facets]].min(axis=0))]
    basis = skfem.FacetBasis(mesh, skfem.ElementQuad2(), facets=facets, intorder=order)
    radius = np.asarray(basis.global_coordinates())[0]
    values = np.stack([np.broadcast_to(np.asarray(b[0]), radius.shape) for b in basis.basis], axis=-1)
    slopes = np.stack([np.asarray(b[0].grad)[0] for b in basis.basis], axis=-1)
    element_nodes = np.asarray(basis.element_dofs).T
    on_top = np.isclose(basis.doflocs[1, element_nodes], top)
    pick = np.stack([np.flatnonzero(row) for row in on_top])
    nodes = np.take_along_axis(element_nodes, pick, axis=1)
    punch = np.full((len(nodes), 1), 2 * basis.doflocs.shape[1])
    return Surface(
        dofs=np.concatenate([2 * nodes, 2 * nodes + 1, punch], axis=1).astype(np.int64),
        shape=np.take_along_axis(values, pick[:, None, :], axis=2),
        slope=np.take_along_axis(slopes, pick[:, None, :], axis=2),
        weight_mm2=2 * np.pi * radius * np.asarray(basis.dx),
        r_mm=radius,
    )
