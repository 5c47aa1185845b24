"""Mesh a gel pad, precompute its shape gradients, and assemble vectors and sparse matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import skfem
from scipy import sparse
from scipy.sparse.linalg import SuperLU, spilu, splu

from tactilevision.errors import InputError
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats

# The graded mesh of a gel pad: fine at the punch's edge, coarse far away. Axes r outward, z up from the base.


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """How fine the mesh is.

    Elements of `edge_size_mm` lie along the surface, and under the punch's edge from `inside_mm` within it to
    `outside_mm` beyond it; from there each is at most `growth` times its neighbour, up to `largest_mm`.
    """

    edge_size_mm: float
    largest_mm: float
    inside_mm: float = 0.0
    outside_mm: float = 0.0
    growth: float = 1.5

    def __post_init__(self) -> None:
        if not (
            0 < self.edge_size_mm <= self.largest_mm
            and self.growth > 1
            and min(self.inside_mm, self.outside_mm) >= 0
        ):
            raise InputError(
                "a mesh needs 0 < edge_size_mm <= largest_mm, growth > 1 and inside_mm, outside_mm >= 0",
                where="MeshSettings",
                value=(self.edge_size_mm, self.largest_mm, self.growth, self.inside_mm, self.outside_mm),
            )


def sizes_from(first: float, length: float, *, settings: MeshSettings) -> Floats:
    """Return the element sizes (N,) mm over `length`, from about `first` growing.

    Scaled so that they fill it exactly.
    """
    sizes, total = [first], first
    while total < length * (1 - ROUNDING):
        sizes.append(min(sizes[-1] * settings.growth, settings.largest_mm))
        total += sizes[-1]
    return np.array(sizes) * (length / total)


def graded_lines(
    radius_mm: float, thickness_mm: float, *, pad_radius_mm: float, settings: MeshSettings
) -> tuple[Floats, Floats]:
    """Return the r (N,) and z (M,) mm of the mesh lines; one of them lies at r = radius_mm exactly."""
    fine = settings.edge_size_mm
    inner = min(settings.inside_mm, radius_mm / 2)
    outer = min(settings.outside_mm, (pad_radius_mm - radius_mm) / 2)
    zone_in = np.full(round(inner / fine), inner / max(round(inner / fine), 1))
    zone_out = np.full(round(outer / fine), outer / max(round(outer / fine), 1))
    inward = sizes_from(fine, radius_mm - zone_in.sum(), settings=settings)
    outward = sizes_from(fine, pad_radius_mm - radius_mm - zone_out.sum(), settings=settings)
    r = np.concatenate([[0.0], np.cumsum(np.concatenate([inward[::-1], zone_in, zone_out, outward]))])
    down = sizes_from(fine, thickness_mm, settings=settings)
    z = thickness_mm - np.concatenate([np.cumsum(down)[::-1], [0.0]])
    r[-1], z[0], z[-1] = pad_radius_mm, 0.0, thickness_mm
    return r, z


def graded_mesh(
    radius_mm: float, thickness_mm: float, *, pad_radius_mm: float, settings: MeshSettings
) -> skfem.MeshQuad:
    """Mesh with quadrilaterals 0 <= r <= pad_radius_mm, 0 <= z <= thickness_mm.

    Raises InputError unless 0 < a < R, h > 0.
    """
    if not (thickness_mm > 0 and 0 < radius_mm < pad_radius_mm):
        raise InputError(
            "the punch's radius lies between 0 and the pad's, and the gel has a thickness",
            where="punch_fem",
            value={"radius_mm": radius_mm, "pad_radius_mm": pad_radius_mm, "thickness_mm": thickness_mm},
        )
    return skfem.MeshQuad.init_tensor(
        *graded_lines(radius_mm, thickness_mm, pad_radius_mm=pad_radius_mm, settings=settings)
    )


# Shape gradients, weights and degrees of freedom of a mesh, computed once; everything nonlinear reads them.
#
# Displacement is Q2 (nine nodes), pressure linear and discontinuous (three modes an element): the pair is
# stable up to the incompressible limit. Source: Boffi, Brezzi, Fortin, Mixed Finite Element Methods (2013), 8.6.
# Degrees of freedom: 2 i is u_r and 2 i + 1 is u_z of node i; the last one of all is the punch's own displacement
# (up, so -depth).

Ints = npt.NDArray[np.int64]

# of SuperLU: the pattern is symmetric, and the values nearly so
SYMMETRIC = {"SymmetricMode": True, "DiagPivotThresh": 0.001}


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
    `weight_mm3` (E, Q) volumes; `modes` (E, Q, 3) pressure modes, the first one 1, orthonormal on an element's
    average; `points_mm` (E, Q, 2) quadrature points; `values` (E, Q, 9) of the displacement's shape functions;
    `corner_gradient` (E, 4, 4, 18) the in-plane part of `gradient` at the four corners."""

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
    """Tabulate basis and quadrature of `mesh`.

    `order` and `surface_order` are polynomial degrees integrated exactly.
    """
    basis = skfem.Basis(mesh, skfem.ElementQuad2(), intorder=order)
    points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    values = np.stack([np.broadcast_to(np.asarray(b[0]), points.shape[:2]) for b in basis.basis], axis=-1)
    radius = points[..., 0]
    gradient = np.zeros((*radius.shape, 5, 18))
    gradient[:, :, :4] = _plane_gradient(basis)
    gradient[:, :, 4, :9] = values / radius[..., None]
    centre = points.mean(axis=1, keepdims=True)
    spread = np.ptp(points, axis=1, keepdims=True)
    linear = np.concatenate([np.ones((*radius.shape, 1)), (points - centre) / spread], axis=-1)
    weight = 2 * np.pi * radius * np.asarray(basis.dx)
    root = np.sqrt(weight)[..., None]
    modes = np.linalg.qr(root * linear)[0] / root
    nodes = np.asarray(basis.element_dofs).T
    corners = (np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), np.full(4, 0.25))
    return Discretisation(
        nodes_mm=np.asarray(basis.doflocs).T.copy(),
        dofs=np.concatenate([2 * nodes, 2 * nodes + 1], axis=1).astype(np.int64),
        gradient=gradient,
        weight_mm3=weight,
        modes=modes / modes[:, :1, :1],
        points_mm=points,
        values=values,
        corner_gradient=_plane_gradient(skfem.Basis(mesh, skfem.ElementQuad2(), quadrature=corners)),
        surface=_surface(mesh, surface_order),
    )


def _plane_gradient(basis: skfem.Basis) -> Floats:
    """Return (E, Q, 4, 18): the unknowns of an element to F_rr, F_rz, F_zr, F_zz less the identity."""
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


# Global vectors and the sparse matrix: the pattern is found once, each tangent only fills in numbers.


@dataclass(frozen=True, slots=True)
class Pattern:
    """Where element entries go among the free unknowns.

    `free` (n,) numbers of the free unknowns, in an order of little fill; `slot` the stored entry to which each
    entry of all element tables adds, one beyond the last where it does not couple two free unknowns.
    """

    free: Ints
    slot: Ints
    indices: npt.NDArray[np.int32]
    indptr: npt.NDArray[np.int32]


def find_pattern(tables: tuple[Ints, ...], free: Bools) -> Pattern:
    """Return the pattern of all `tables` (K, n) of unknowns together, restricted to `free` (N,)."""
    number, size = np.where(free, np.cumsum(free) - 1, -1), int(free.sum())
    rows = np.concatenate([np.repeat(number[table], table.shape[1], axis=1).ravel() for table in tables])
    columns = np.concatenate([np.tile(number[table], (1, table.shape[1])).ravel() for table in tables])
    both = np.minimum(rows, columns) >= 0
    alike = sparse.csc_array((np.ones(both.sum()), (rows[both], columns[both])), shape=(size, size))
    alike.setdiag(size)  # dominant: no pivot moves, and all else is dropped, since only the order is asked for
    ordered = spilu(alike, drop_tol=1, fill_factor=1, permc_spec="MMD_AT_PLUS_A", options=SYMMETRIC)
    order = np.argsort(ordered.perm_c)
    moved = alike[order][:, order].tocsc()
    moved.sort_indices()
    stored = np.repeat(size * np.arange(size), np.diff(moved.indptr)) + moved.indices
    place = np.argsort(order)
    keys = np.where(both, size * place[columns] + place[rows], size**2)
    return Pattern(np.flatnonzero(free)[order], np.searchsorted(stored, keys), moved.indices, moved.indptr)


def assemble(pattern: Pattern, stiffnesses: tuple[Floats, ...]) -> sparse.csc_array:
    """Sum element stiffnesses (K, n, n), N per mm, one array a table, into the free unknowns' matrix."""
    size, entries = len(pattern.free), len(pattern.indices)
    values = np.concatenate([stiffness.ravel() for stiffness in stiffnesses])
    data = np.bincount(pattern.slot, values, minlength=entries)[:entries]
    return sparse.csc_array((data, pattern.indices, pattern.indptr), shape=(size, size))


def factorise(matrix: sparse.csc_array) -> SuperLU:
    """Return LU of a matrix in its pattern's order, column by column: its blocks are too small for panels."""
    return splu(matrix, permc_spec="NATURAL", panel_size=1, relax=1, options=SYMMETRIC)


def scatter(size: int, tables: tuple[Ints, ...], *, forces: tuple[Floats, ...]) -> Floats:
    """Sum element forces (K, n), in N, into a vector of all `size` unknowns."""
    total = np.zeros(size)
    for table, force in zip(tables, forces, strict=True):
        total += np.bincount(table.ravel(), force.ravel(), minlength=size)
    return total
