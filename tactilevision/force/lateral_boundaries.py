"""Contribution of the gel's free sides to its compliance, by finite elements, as tables in a cache."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import skfem
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from tactilevision.files.cache import kept_array
from tactilevision.force.kernel import LayerStress, layer_stress
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

# Finite elements of a nearly incompressible solid: quadratic displacement, linear discontinuous pressure.
#
#     K = Int 2 mu eps(v) : eps(u) + lambda P(div v) P(div u),      P: projection on 1, x, y, z in each element
#
# P is the pressure, condensed inside each element; the pair is stable and does not lock as nu -> .5. The gel is
# its face times the line from the face to the base, and so is each basis function: integrals over the gel are
# products of one over the face and one over the line, and each block of K is a sum of Kronecker products. Modulus
# 1 MPa.
#
# Source: Hughes, The Finite Element Method (1987), section 4.4; Boffi, Brezzi, Fortin, Mixed Finite Element
# Methods (2013), section 8.7 (Q2/P-1).

Indices = npt.NDArray[np.intp]
Blocks = list[list[sparse.csr_array]]  # [a][b] over x, y, z: derivatives of the test and of the trial function
DEGREE = 5  # of the polynomials that the quadrature integrates exactly: three points along each axis


@dataclass(frozen=True, slots=True)
class GelMesh:
    """Bases of the gel's `face` (N nodes) and of the `line` from it, z = 0, to the base (K nodes).

    Unknown (i K + k) N + n is the displacement along i of the face's node n at the line's node k.
    """

    face: skfem.Basis
    line: skfem.Basis

    @property
    def above_base(self) -> Bools:
        """Which of the line's nodes (K,) are not fixed."""
        return np.asarray(self.line.doflocs[0] < self.line.doflocs[0].max())

    @property
    def numbers(self) -> Indices:
        """Numbers (3, K, N) of the unknowns."""
        return np.arange(3 * self.line.N * self.face.N).reshape(3, self.line.N, self.face.N)

    @property
    def free(self) -> Indices:
        """Numbers (3, levels above the base, N) of the unknowns that are not fixed there."""
        return self.numbers[:, self.above_base]

    @property
    def wall(self) -> Indices:
        """The wall's nodes (n,) among those of the face."""
        return np.asarray(self.face.get_dofs().flatten())


@dataclass(frozen=True, slots=True)
class Span:
    """Some displacements: products of `levels` (K, k) along the line and, for each axis, of `faces` (N, n)."""

    levels: sparse.csr_array
    faces: Sequence[sparse.csr_array]

    @property
    def basis(self) -> sparse.csr_array:
        """The displacements (3 K N, all)."""
        return sparse.csr_array(sparse.block_diag([sparse.kron(self.levels, face) for face in self.faces]))


def stiffness(mesh: GelMesh, *, poisson_ratio: float) -> sparse.csc_array:
    """Return K of all unknowns, (3 K N, 3 K N), at modulus 1 MPa."""
    every = Span(sparse.eye_array(mesh.line.N, format="csr"), [sparse.eye_array(mesh.face.N, format="csr")] * 3)
    ((shear, volume),) = stiffness_parts(mesh, [every])
    return combined(shear, volume, poisson_ratio=poisson_ratio)


def combined(shear: sparse.csc_array, volume: sparse.csc_array, *, poisson_ratio: float) -> sparse.csc_array:
    """Return mu times the one part of the stiffness and lambda times the other, at modulus 1 MPa."""
    mu = 1 / (2 * (1 + poisson_ratio))
    lame = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return sparse.csc_array(mu * shear + lame * volume)


def stiffness_parts(mesh: GelMesh, spans: Iterable[Span]) -> Iterator[tuple[sparse.csc_array, sparse.csc_array]]:
    """Yield the parts of K that mu and lambda multiply, on the displacements of each span."""
    face, face_0, face_1 = (_integrals(mesh.face, (0, 1), degree) for degree in (None, 0, 1))
    line, line_0, line_1 = (_integrals(mesh.line, (2,), degree) for degree in (None, 0, 1))

    def shear(i: int, j: int) -> list[tuple[Any, Any]]:
        """Return 2 eps : eps = u_i,j v_i,j + u_i,j v_j,i as products of line and face."""
        return [(line[j][i], face[j][i]), *((line[a][a], face[a][a]) for a in range(3) if i == j)]

    def volume(i: int, j: int) -> list[tuple[Any, Any]]:
        """Return P on 1, x, y (face) and on z (line)."""
        return [(line_0[i][j], face_1[i][j] - face_0[i][j]), (line_1[i][j], face_0[i][j])]

    def on(span: Span, part: Callable[[int, int], list[tuple[Any, Any]]]) -> sparse.csc_array:
        up, faces = span.levels, span.faces

        def block(i: int, j: int) -> Any:
            return sum(sparse.kron(up.T @ a @ up, faces[i].T @ b @ faces[j]) for a, b in part(i, j))

        columns = [sparse.vstack([block(i, j) for i in range(3)], format="csc") for j in range(3)]
        return sparse.csc_array(sparse.hstack(columns, format="csc"))  # a third of the copies at a time

    yield from ((on(span, shear), on(span, volume)) for span in spans)


# A gel is symmetric about both axes of its face, and so is its mesh. Displacements are sums of four parts, each
# even or odd in x and in y; each part is a problem of its own, on a quarter of the unknowns.


def symmetric_parts(mesh: GelMesh) -> Iterator[Span]:
    """Yield orthonormal displacements of each symmetry, about a quarter of those that are not fixed."""
    places, levels = mesh.face.doflocs.T, sparse.eye_array(mesh.line.N, format="csr")[:, mesh.above_base]
    mirrors = list(product((1, -1), (1, -1)))
    partners = np.stack([cKDTree(places).query(places * mirror)[1] for mirror in mirrors])
    first = np.unique(partners.min(axis=0))
    columns = np.tile(np.arange(first.size), len(mirrors))
    for parity in mirrors:
        faces = []
        for axis in range(3):
            turns = [mirror[axis] if axis < 2 else 1 for mirror in mirrors]  # of the component itself
            signs = [
                turn * parity[0] ** (x < 0) * parity[1] ** (y < 0)
                for turn, (x, y) in zip(turns, mirrors, strict=True)
            ]
            entries = np.repeat(np.array(signs, np.float64), first.size), (partners[:, first].ravel(), columns)
            faces.append(sparse.csr_array(_normalised(sparse.csc_array(entries, shape=(len(places), first.size)))))
        yield Span(levels, faces)


# Combinations (n, m) of a span's displacements, None for all, and the bases (3 K N, m) that share their stiffness
Share = tuple[sparse.csc_array | None, list[sparse.csr_array]]


def unmixed_parts(mesh: GelMesh) -> Iterator[tuple[Span, list[Share]]]:
    """Yield spans of the free displacements, each with its parts that the stiffness K does not couple.

    A gel that is its own mirror image on the diagonal x = y has two spans that are images of each other: K is
    assembled once for both. Any other span falls into an even and an odd half. A part lists all bases with one K.
    """
    places, twin = mesh.face.doflocs.T, False
    off, partners = cKDTree(places).query(places[:, ::-1])
    if np.max(off) > MICRO * np.ptp(places):
        for span in symmetric_parts(mesh):
            yield span, [(None, [span.basis])]
        return
    images = mesh.numbers[[1, 0, 2]][:, :, partners].ravel()
    mirror = sparse.csr_array((np.ones(images.size), (mesh.numbers.ravel(), images)))
    for span in symmetric_parts(mesh):
        basis = span.basis
        image = sparse.csc_array(basis.T @ mirror @ basis).rint()  # 1 or -1 for each, or 0 in all
        image.eliminate_zeros()
        if image.nnz:
            first = np.unique(np.minimum(image.indices, np.arange(image.shape[1])))
            every = sparse.eye_array(len(image.indices), format="csc")
            halves = [sparse.csc_array(every + sign * image)[:, first] for sign in (1, -1)]
            yield span, [(half, [basis @ half]) for half in map(_normalised, halves)]
        elif not twin:
            twin = True  # the other of the two is its image, and its basis is yielded here
            yield span, [(None, [basis, mirror @ basis])]


def _normalised(basis: sparse.csc_array) -> sparse.csc_array:
    """Return the columns at length 1, without those that are 0, as they cancel on an axis."""
    length = sparse.linalg.norm(basis, axis=0)
    return sparse.csc_array(basis[:, length > 0] @ sparse.diags_array(1 / length[length > 0]))


def _integrals(basis: skfem.Basis, axes: tuple[int, ...], degree: int | None) -> Blocks:
    """Return the integrals of two basis functions, each derived by x, y or z if that is one of the basis's `axes`.

    With a `degree`, 0 or 1, both are projected on the polynomials of that degree in each element first.
    """
    weight, dofs = np.asarray(basis.dx)[:, :, None], basis.element_dofs.T
    parts = [
        np.stack([one.grad[axes.index(a)] if a in axes else np.asarray(one) for (one,) in basis.basis], axis=-1)
        for a in range(3)
    ]  # (elements, points, nodes)
    if degree is not None:
        places = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        modes = np.concatenate([np.ones_like(weight), places], axis=-1)[..., : 1 + degree * len(axes)]
        moments = (weight * modes).transpose(0, 2, 1)
        parts = [modes @ np.linalg.solve(moments @ modes, moments @ part) for part in parts]
    rows, columns = np.repeat(dofs, dofs.shape[1], axis=1).ravel(), np.tile(dofs, dofs.shape[1]).ravel()

    def summed(test: Floats, trial: Floats) -> sparse.csr_array:
        entries = (weight * test).transpose(0, 2, 1) @ trial
        return sparse.csr_array((entries.ravel(), (rows, columns)), shape=(basis.N, basis.N))

    return [[summed(test, trial) for trial in parts] for test in parts]


# Mesh of a gel: a rectangle in rows and columns, a disc as a square core with four petals round it. Elements are
# smaller towards the free face and the sides; geometry is quadratic, so that a disc's side is round.

DEPTHS = np.array([0.0, 0.15, 0.45, 1.0])  # ends of the elements through the thickness
CORE = 0.55  # of the disc's radius: what the elements of a petal leave to its core
SQUARE = 0.75 * CORE  # half side of that square core, of the radius
NEAREST = 12  # elements that a place is looked for in
NEWTON_ROUNDS = 12  # of its own coordinates there: they double their digits in each


def gel_mesh(gel: Gel, element_mm: float) -> GelMesh:
    """Mesh a gel that has sides (disc or rectangle) with elements about `element_mm` wide."""
    if gel.shape == "disc" and gel.radius_mm is not None:
        face = _disc(gel.radius_mm, element_mm)
    elif gel.size_mm is not None:
        face = skfem.MeshQuad.init_tensor(
            *(_graded(max(4, int(np.ceil(length / element_mm)))) * length / 2 for length in gel.size_mm)
        )
    else:
        raise ValueError("an unbounded gel has no sides")
    line = skfem.MeshLine(DEPTHS * gel.thickness_mm)
    return GelMesh(
        skfem.Basis(face, skfem.ElementQuad2(), intorder=DEGREE),
        skfem.Basis(line, skfem.ElementLineP2(), intorder=DEGREE),
    )


def _graded(count: int) -> Floats:
    """Return the ends of elements on [-1, 1], smaller towards both ends."""
    even = np.linspace(-1, 1, count + 1)
    return np.asarray(even + 0.6 * np.sin(np.pi * even) / np.pi)


def _disc(radius_mm: float, element_mm: float) -> skfem.MeshQuad2:
    """Mesh a square with a square core and a ring of four petals, made round."""
    side = max(4, int(np.ceil(np.pi / 2 * radius_mm / element_mm)))
    out = max(3, int(np.ceil((1 - CORE) * radius_mm / element_mm)) + 1)
    flat = np.linspace(-1, 1, side + 1)
    square = skfem.MeshQuad.init_tensor(SQUARE * flat, SQUARE * flat)
    petal = skfem.MeshQuad.init_tensor(1 - (1 - SQUARE) * np.linspace(1, 0, out + 1) ** 1.4, flat)
    place = np.stack([petal.p[0], petal.p[0] * petal.p[1]])
    for _ in range(4):
        place = np.stack([-place[1], place[0]])
        square += skfem.MeshQuad(place, petal.t)
    whole = skfem.MeshQuad2.from_mesh(square)
    return replace(whole, doflocs=radius_mm * _rounded(whole.doflocs))


def _rounded(places: Floats) -> Floats:
    """Return places (2, n) of a square of half side 1 in a disc of radius 1: straight from the core to the rim."""
    far = np.abs(places).max(axis=0)
    square = places / np.maximum(far, TINY)
    rim = np.tan(np.pi / 4 * square)
    rim /= np.maximum(np.hypot(*rim), TINY)
    step = np.maximum(far - SQUARE, 0) / (1 - SQUARE)
    return np.asarray(np.minimum(far, SQUARE) * square * (1 - step) + rim * step)


def _shares(basis: skfem.Basis) -> sparse.csr_array:
    """Return the nodal load (points, nodes) of a unit load density at each of the basis's quadrature points."""
    values = np.stack([np.asarray(one) for (one,) in basis.basis]) * basis.dx
    points = np.broadcast_to(np.arange(basis.dx.size).reshape(basis.dx.shape), values.shape)
    nodes = np.broadcast_to(basis.element_dofs[:, :, None], values.shape)
    return sparse.csr_array((values.ravel(), (points.ravel(), nodes.ravel())), shape=(basis.dx.size, basis.N))


def interpolation(basis: skfem.Basis, places_mm: Floats) -> sparse.csr_array:
    """Return the matrix (P, N) from nodal values to `places_mm` (P, 2): Newton's method in the nearest elements.

    Raises ValueError for a place outside the mesh.
    """
    middle, size = basis.mapping.F(np.full((2, 1), 0.5))[:, :, 0], np.sqrt(np.sum(basis.dx, axis=1))
    near = np.argsort(np.hypot(*(places_mm.T[:, :, None] - middle[:, None])) / size, axis=1)[:, :NEAREST]
    cells, target = near.ravel(), np.repeat(places_mm.T, near.shape[1], axis=1)[:, :, None]
    local = np.full(target.shape, 0.5)  # coordinates in [0, 1]^2 of the element
    for _ in range(NEWTON_ROUNDS):
        off = target - basis.mapping.F(local, cells)
        local = np.clip(local + np.einsum("ijkl,jkl->ikl", basis.mapping.invDF(local, cells), off), -1, 2)
    inside = (np.abs(local - 0.5).max(axis=(0, 2)) < 0.5 + MICRO).reshape(near.shape)
    if not inside.any(axis=1).all():
        raise ValueError(f"the place {places_mm[~inside.any(axis=1)][0]} lies outside the mesh")
    count = np.arange(len(places_mm))
    chosen = near.shape[1] * count + np.argmax(inside, axis=1)
    parts = (basis.elem.gbasis(basis.mapping, local[:, chosen], k, cells[chosen])[0] for k in range(basis.Nbfun))
    values, nodes = np.concatenate([np.ravel(part) for part in parts]), basis.element_dofs[:, cells[chosen]]
    return sparse.csr_array((values, (np.tile(count, basis.Nbfun), nodes.ravel())), shape=(count.size, basis.N))


# The sides' part of the compliance, as a table between stations on the gel's face.
#
# For a load at station p the unbounded layer has the traction s(p) at the gel's side. The side is free, so -s(p)
# acts there with no load on the face: K v = -f(s(p)). The table is v at the stations. The loads of all stations
# span few shapes at a side, so K is solved for their leading singular vectors only. Between stations the table is
# interpolated linearly, in source and receiver. Stations outside the gel, or nearer to its side than half their
# load, are moved to the nearest place that is not.
#
# The table is a smooth function of Poisson's ratio, up to 1/2: it is solved for three values, and interpolated by
# the parabola through them, whose slope is its derivative. That is off by at most 2e-4 of the table from .35 on.
#
# The table is at most a few percent of the whole beyond one thickness from a side. Reciprocity is not imposed: it
# is a test of the mesh.

Singles = npt.NDArray[np.float32]
STATION_MM = 1.25  # mm between stations
LOAD_MM = 0.5  # mm: size of the loads of the table
FORGETS = 3.5  # thicknesses beyond which a side has no effect
RANK_TOLERANCE = 1e-4  # of the largest singular value: smaller ones are dropped
SOLVED_AT = ((0.35, 0.45, 0.4995), (0.0, 0.2, 0.35))  # Poisson's ratios of elastomers, and of what is softer
MAX_ELEMENTS = 280  # squares of an element's width in the gel's face


@dataclass(frozen=True)
class SideTable:
    """`table` (3 S, 3 S), x y z of each station over `grid` in turn: mm/N at 1 MPa, or its derivative by nu."""

    grid: NodeGrid
    table: Singles

    def block(self, cells: Cells, parts: int) -> Floats:
        """Return the sides' part of the compliance between cells (parts C, parts C), 1 MPa over a cell's area.

        (1, 1), a 0, where no side is near.
        """
        part, weights = self._between(cells, parts)
        if not part.any():
            return np.zeros((1, 1))
        inner = (weights @ part @ weights.T).transpose(0, 2, 1, 3)
        return np.asarray(self.grid.cell_mm2 * inner.reshape(parts * len(cells), parts * len(cells)))

    def moved(self, cells: Cells, traction: Floats) -> Floats:
        """Return the displacement (parts, C) by `traction` (parts, C) that the sides add at the same `cells`."""
        part, weights = self._between(cells, len(traction))
        by_stations = np.einsum("ijpq,jq->ip", part, traction @ weights)
        return np.asarray(self.grid.cell_mm2 * by_stations @ weights.T)

    def _between(self, cells: Cells, parts: int) -> tuple[Floats, Floats]:
        """Return the table (parts, parts, S, S) of the stations that `cells` lie between, and weights (cells, S)
        of linear interpolation.
        """
        places = np.divmod(cells, self.grid.shape[1])
        down, across = (along[place] for along, place in zip(self._weights, places, strict=True))
        rows, columns = (np.flatnonzero(one.any(axis=0)) for one in (down, across))
        weights = (down[:, rows, None] * across[:, None, columns]).reshape(len(cells), -1)
        near, count = np.flatnonzero(weights.any(axis=0)), len(self.table) // 3
        used = (rows[:, None] * across.shape[1] + columns).ravel()[near]
        table = self.table.reshape(count, 3, count, 3).transpose(1, 3, 0, 2)[-parts:, -parts:]
        return table[..., used[:, None], used].astype(np.float64), weights[:, near]

    @cached_property
    def _weights(self) -> list[Floats]:
        """Return the weights of the stations' rows for each row of cells, and those of columns."""
        return [
            np.stack([np.interp(mm / STATION_MM + (n - 1) / 2, np.arange(n), unit) for unit in np.eye(n)], axis=1)
            for mm, n in zip((self.grid.y_mm, self.grid.x_mm), station_shape(self.grid), strict=True)
        ]


def station_shape(grid: NodeGrid) -> tuple[int, int]:
    """Return the rows and columns of stations over a grid, centred on the pad."""
    rows, columns = (int(np.ceil((n - 1) * grid.spacing_mm / STATION_MM)) + 1 for n in grid.shape)
    return rows, columns


def side_tables(gel: Gel, grid: NodeGrid, *, poisson_ratio: float) -> tuple[SideTable, SideTable] | None:
    """Return the table for the stations over `grid` and its derivative by nu, solved or from the cache.

    The cache keeps the tables of SOLVED_AT for each shape of a gel. None if no side is near the view.
    """
    rows, columns = station_shape(grid)
    x, y = ((np.arange(count) - (count - 1) / 2) * STATION_MM for count in (columns, rows))
    places = _admissible(gel, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    if not (from_side(gel, places) < FORGETS * gel.thickness_mm).any():
        return None
    at = next((one for one in SOLVED_AT if poisson_ratio >= one[0]), SOLVED_AT[-1])
    key = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, at, rows, columns, STATION_MM, LOAD_MM
    solved = kept_array("sides", key, make=lambda: solve_sides(gel, places, poisson_ratios=at))
    parabolas = np.linalg.inv(np.vander(at))  # coefficients by value, the highest power first
    powers = np.array([[poisson_ratio**2, poisson_ratio, 1], [2 * poisson_ratio, 1, 0]])
    table, slope = np.tensordot(powers @ parabolas, solved, 1).astype(np.float32)
    return SideTable(grid, table), SideTable(grid, slope)


def solve_sides(
    gel: Gel, places_mm: Floats, *, poisson_ratios: Sequence[float], element_mm: float | None = None
) -> Singles:
    """Return the displacement (ratios, 3 S, 3 S), mm/N at 1 MPa, that the free sides add at `places_mm` (S, 2)."""
    mesh = gel_mesh(gel, element_mm or _element_mm(gel))
    near = from_side(gel, places_mm) < FORGETS * gel.thickness_mm
    stations = interpolation(mesh.face, places_mm[near])
    three, index = np.arange(3), np.flatnonzero(near)
    tables = np.zeros((len(poisson_ratios), len(places_mm), 3, len(places_mm), 3), dtype=np.float32)
    loads = [
        _wall_forces(
            mesh,
            layer_stress(
                np.ravel(mesh.line.global_coordinates()),
                LOAD_MM,
                thickness_mm=gel.thickness_mm,
                poisson_ratio=nu,
                reach_mm=FORGETS * gel.thickness_mm,
            ),
            places_mm[near],
        )
        for nu in poisson_ratios
    ]
    for span, shares in unmixed_parts(mesh):
        ((shear, volume),) = stiffness_parts(mesh, [span])
        for half, bases in shares:
            own = (shear, volume) if half is None else (half.T @ shear @ half, half.T @ volume @ half)
            for table, nu, load in zip(tables, poisson_ratios, loads, strict=True):
                seen = _answers(mesh, combined(*own, poisson_ratio=nu), bases, load, stations)
                table[np.ix_(index, three, index, three)] += np.reshape(seen, (len(index), 3, len(index), 3))
    return tables.reshape(len(poisson_ratios), 3 * len(places_mm), 3 * len(places_mm))


def _answers(
    mesh: GelMesh, matrix: sparse.csc_array, bases: Sequence[sparse.csr_array], loads: Floats, stations: Any
) -> Floats:
    """Return the displacement (3 S, 3 S) at the stations by the part of the loads in the bases (3 K N, n) of K."""
    total = np.zeros((3 * stations.shape[0], loads.shape[1]))
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    for basis in bases:
        on_wall = sparse.csr_array(basis[mesh.free[:, :, mesh.wall].ravel()].T)
        loaded = np.flatnonzero(np.diff(on_wall.indptr))
        load = -(on_wall[loaded] @ loads)
        squares, shapes = np.linalg.eigh(load @ load.T)
        shapes = shapes[:, squares > RANK_TOLERANCE**2 * squares[-1]]
        right = np.zeros((basis.shape[1], shapes.shape[1]))
        right[loaded] = shapes
        solved = factor.solve(right)
        seen = np.stack([stations @ (basis[face] @ solved) for face in mesh.numbers[:, 0]], axis=1)
        total += seen.reshape(-1, shapes.shape[1]) @ (shapes.T @ load)
    return total


def _element_mm(gel: Gel) -> float:
    """Return an element size of three fifths of the thickness, or the least that keeps the mesh factorised in
    seconds.
    """
    if gel.shape == "disc" and gel.radius_mm is not None:
        area = np.pi * gel.radius_mm**2
    else:
        area = float(np.prod(gel.size_mm)) if gel.size_mm is not None else 0.0
    return float(max(0.6 * gel.thickness_mm, np.sqrt(area / MAX_ELEMENTS)))


def _wall_forces(mesh: GelMesh, field: LayerStress, places_mm: Floats) -> Floats:
    """Return the nodal forces (U, 3 S) on the wall of the layer's traction by loads at `places_mm` (S, 2)."""
    wall = skfem.FacetBasis(mesh.face.mesh, mesh.face.elem, intorder=DEGREE)
    nodes = mesh.wall
    along, levels = _shares(wall)[:, nodes].toarray(), _shares(mesh.line).toarray()[:, mesh.above_base]
    places, normals = (np.reshape(part, (2, -1)).T for part in (wall.global_coordinates(), wall.normals))
    offset = (places[:, None, :] - places_mm).reshape(-1, 2)
    total = np.zeros((3, levels.shape[1], len(nodes), len(places_mm), 3))
    for level, share in enumerate(levels):
        stress = field.at(level, offset).reshape(len(places), len(places_mm), 3, 3, 3)
        traction = np.einsum("qplij,qj->qipl", stress[..., :2], normals)
        force = np.einsum("qn,qipl->inpl", along, traction, optimize=True)
        used = np.flatnonzero(share)
        total[:, used] += share[used, None, None, None] * force[:, None]
    return np.asarray(total.reshape(-1, 3 * len(places_mm)))


def from_side(gel: Gel, places_mm: Floats) -> Floats:
    """Return the distance in mm of places (..., 2) from the nearest side; below 0 outside."""
    if gel.radius_mm is not None and gel.shape == "disc":
        return np.asarray(gel.radius_mm - np.linalg.norm(places_mm, axis=-1))
    if gel.size_mm is not None and gel.shape == "rectangle":
        return np.asarray((np.array(gel.size_mm) / 2 - np.abs(places_mm)).min(axis=-1))
    return np.full(places_mm.shape[:-1], np.inf)


def _admissible(gel: Gel, places_mm: Floats) -> Floats:
    """Return each place, or the nearest one that keeps half a load's distance from the side."""
    keep = LOAD_MM / 2
    if gel.shape == "disc" and gel.radius_mm is not None:
        distance = np.hypot(*places_mm.T)
        return np.asarray(
            places_mm * np.minimum(1.0, (gel.radius_mm - keep) / np.maximum(distance, TINY))[:, None]
        )
    if gel.shape == "rectangle" and gel.size_mm is not None:
        most = np.array(gel.size_mm) / 2 - keep
        return np.clip(places_mm, -most, most)
    return places_mm
