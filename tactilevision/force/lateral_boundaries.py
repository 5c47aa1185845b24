"""Contribution of the gel's free sides to its compliance, by finite elements, as a table in a cache."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import splu

from tactilevision.errors import InputError, OutputError
from tactilevision.files.arrays import read_arrays
from tactilevision.files.writing import replacing
from tactilevision.force.kernel import LayerStress, layer_stress
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

# Cache of tables that take seconds to compute, under a hash of what they depend on. The folder is
# $TACTILEVISION_CACHE, else $XDG_CACHE_HOME/tactilevision, else ~/.cache/tactilevision. A file that cannot be read
# is computed anew; a folder that cannot be written to is ignored.

VERSION = 1  # part of every hash: raise it when the numbers change


def cache_folder() -> Path:
    """Return the folder that keeps tables; it is made when something is written."""
    own = os.environ.get("TACTILEVISION_CACHE")
    if own:
        return Path(own)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root and Path(root).is_absolute() else Path.home() / ".cache") / "tactilevision"


def kept(name: str, key: object, *, make: Callable[[], npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Return the array of `key`, of any shape and of its unit: read from the cache, else computed and kept."""
    digest = hashlib.sha256(repr((VERSION, name, key)).encode()).hexdigest()[:20]
    path = cache_folder() / f"{name}-{digest}.npz"
    found = _read(path, repr(key))
    if found is not None:
        return found
    made = make()
    try:
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, table=made, key=np.array(repr(key)))
    except OutputError:
        pass
    return made


def _read(path: Path, key: str) -> npt.NDArray[Any] | None:
    try:
        file = read_arrays(path)
        return file["table"] if str(file["key"]) == key else None
    except (OSError, KeyError, InputError):
        return None


# Triquadratic hexahedra for a nearly incompressible solid: displacement Q2, discontinuous pressure P1.
#
#     K = Int 2 mu eps : eps + B^T (M/lambda)^-1 B,      B = Int p div u,  M = Int p p
#
# The pressure (1, x, y, z about the element's middle) is condensed inside each element; the pair is stable and
# does not lock as nu -> .5. Modulus 1 MPa. Quadrature 3 x 3 x 3. Nodes of an element: index = a + 3 b + 9 c for
# the places (a, b, c) in {0, 1, 2}^3 along its own axes.
#
# Source: Hughes, The Finite Element Method (1987), section 4.4 and table 4.3; Boffi, Brezzi, Fortin, Mixed Finite
# Element Methods (2013), section 8.7 (Q2/P-1).

Indices = npt.NDArray[np.intp]
GAUSS, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(3)  # on (-1, 1)


def quadratic(xi: Floats) -> tuple[Floats, Floats]:
    """Return the values and slopes (3, N) of the three quadratic functions on [-1, 1] at `xi` (N,)."""
    values = np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2])
    return values, np.stack([xi - 0.5, -2 * xi, xi + 0.5])


def shape_functions() -> tuple[Floats, Floats, Floats]:
    """Return values (27 points, 27 nodes), slopes (27, 27, 3) by the element's own axes and weights (27,) at the
    27 points.
    """
    value, slope = quadratic(GAUSS)
    values = np.einsum("ip,jq,kr->rqpkji", value, value, value).reshape(27, 27)
    slopes = [
        np.einsum("ip,jq,kr->rqpkji", *parts).reshape(27, 27)
        for parts in ((slope, value, value), (value, slope, value), (value, value, slope))
    ]
    weights = np.einsum("i,j,k->kji", GAUSS_WEIGHT, GAUSS_WEIGHT, GAUSS_WEIGHT).ravel()
    return values, np.stack(slopes, axis=-1), weights


def stiffness(nodes_mm: Floats, elements: Indices, *, poisson_ratio: float) -> sparse.csc_matrix:
    """Return K (3 N, 3 N) of `nodes_mm` (N, 3) and `elements` (M, 27) at modulus 1 MPa.

    Unknown 3 n + i is node n along i.
    """
    chunks = np.array_split(elements, max(1, len(elements) // 200))
    blocks = np.concatenate([_element_matrices(nodes_mm[chunk], poisson_ratio) for chunk in chunks])
    dofs = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 81)
    rows, columns = np.repeat(dofs, 81, axis=1).ravel(), np.tile(dofs, (1, 81)).ravel()
    size = 3 * len(nodes_mm)
    return sparse.csc_matrix(sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=(size, size)))


def _element_matrices(corners: Floats, poisson_ratio: float) -> Floats:
    """Return (m, 81, 81) of elements with node places `corners` (m, 27, 3)."""
    values, slopes, weights = shape_functions()
    jacobian = np.einsum("pna,mni->mpia", slopes, corners)
    measure = np.linalg.det(jacobian) * weights
    gradient = np.einsum("pna,mpai->mpni", slopes, np.linalg.inv(jacobian))
    mu = 1 / (2 * (1 + poisson_ratio))
    lame = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    weighted = gradient * measure[..., None, None]
    m = len(corners)
    # 2 mu eps(u):eps(v) = mu (u_i,j v_i,j + u_i,j v_j,i): `same` is the first, `cross` the second
    same = np.einsum("mpna,mpka->mnk", weighted, gradient, optimize=True)
    cross = np.matmul(weighted.transpose(0, 2, 3, 1).reshape(m, 81, 27), gradient.reshape(m, 27, 81))
    matrix = mu * cross.reshape(m, 27, 3, 27, 3).transpose(0, 1, 4, 3, 2)
    for i in range(3):
        matrix[:, :, i, :, i] += mu * same
    matrix = matrix.reshape(m, 81, 81)
    place = np.einsum("pn,mni->mpi", values, corners) - corners.mean(axis=1)[:, None]
    basis = np.concatenate([np.ones((m, 27, 1)), place], axis=2)
    mass = np.einsum("mp,mpa,mpb->mab", measure, basis, basis, optimize=True)
    divergence = np.einsum("mpa,mpni->mani", basis, weighted, optimize=True).reshape(m, 4, 81)
    projected = np.matmul(divergence.transpose(0, 2, 1), np.linalg.solve(mass, divergence))
    return np.asarray(matrix + lame * projected)


# Mesh of a gel: a rectangle in rows and columns, a disc as a square core with four petals round it. Nodes are
# numbered layer by layer, from the free face z = 0 to the base z = h. Elements are smaller towards the free face
# and the sides; geometry is quadratic, so that a disc's side is round.

DEPTHS = np.array([0.0, 0.15, 0.45, 1.0])  # ends of the elements through the thickness
CORE = 0.55  # of the disc's radius: what the elements of a petal leave to its core
SQUARE = 0.75 * CORE  # half side of that square core, of the radius


@dataclass(frozen=True, slots=True)
class GelMesh:
    """`nodes_mm` (N, 3), `elements` (M, 27); `per_layer` nodes in each of the `layers` levels (base last);
    `edges` (S, 3) nodes of one layer along each element's side on the wall, the gel on the left hand going
    along."""

    nodes_mm: Floats
    elements: Indices
    per_layer: int
    depths_mm: Floats
    edges: Indices

    @property
    def free(self) -> Indices:
        """Unknowns that are not fixed at the base."""
        return np.arange(3 * self.per_layer * (len(self.depths_mm) - 1))


def gel_mesh(gel: Gel, element_mm: float) -> GelMesh:
    """Mesh a gel that has sides (disc or rectangle) with elements about `element_mm` wide."""
    if gel.shape == "disc" and gel.radius_mm is not None:
        patches = _disc(gel.radius_mm, element_mm)
    elif gel.size_mm is not None:
        patches = [_rectangle(gel.size_mm, element_mm)]
    else:
        raise ValueError("an unbounded gel has no sides")
    places, quads = _merge(patches)
    ends = DEPTHS * gel.thickness_mm
    depths = _with_middles(ends)
    nodes = np.concatenate([np.column_stack([places, np.full(len(places), z)]) for z in depths])
    layers = [
        np.concatenate([quads + (2 * k + level) * len(places) for level in range(3)], axis=1)
        for k in range(len(ends) - 1)
    ]
    return GelMesh(nodes, np.concatenate(layers), len(places), depths, _outline(quads))


def _rectangle(size_mm: tuple[float, float], element_mm: float) -> Floats:
    """Return the node places (2 n + 1, 2 m + 1, 2) of the whole plane, x fastest."""
    axes = [_graded(max(4, int(np.ceil(length / element_mm)))) * length / 2 for length in size_mm]
    x, y = np.meshgrid(*axes)
    return np.stack([x, y], axis=-1)


def _graded(count: int) -> Floats:
    """Return the places of quadratic nodes on [-1, 1], closer together towards both ends."""
    even = np.linspace(-1, 1, count + 1)
    return _with_middles(even + 0.6 * np.sin(np.pi * even) / np.pi)


def _with_middles(ends: Floats) -> Floats:
    """Return the ends of elements (n,) with the middle of each between them (2 n - 1,)."""
    return np.interp(np.arange(2 * len(ends) - 1) / 2, np.arange(len(ends)), ends)


def _disc(radius_mm: float, element_mm: float) -> list[Floats]:
    side = max(4, int(np.ceil(np.pi / 2 * radius_mm / element_mm)))
    out = max(3, int(np.ceil((1 - CORE) * radius_mm / element_mm)) + 1)
    flat = np.linspace(-1, 1, 2 * side + 1)
    inner = np.stack([np.full_like(flat, 1.0), flat], axis=-1) * SQUARE * radius_mm
    patches = [np.stack(np.meshgrid(inner[:, 1], inner[:, 1]), axis=-1)]
    step = _with_middles(1 - np.linspace(1, 0, out + 1) ** 1.4)
    angle = flat * np.pi / 4
    outer = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radius_mm
    petal = inner[:, None, :] * (1 - step)[None, :, None] + outer[:, None, :] * step[None, :, None]
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return patches + [petal @ np.linalg.matrix_power(quarter, turns) for turns in range(4)]


def _merge(patches: list[Floats]) -> tuple[Floats, Indices]:
    """Merge equal places (N, 2); return them and nine-node quads (M, 9), x fastest within each."""
    places = np.concatenate([p.reshape(-1, 2) for p in patches])
    scale = np.abs(places).max()
    _, first, number = np.unique(np.round(places / scale, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    quads, start = [], 0
    for patch in patches:
        rows, columns = patch.shape[:2]
        grid = number.ravel()[start + np.arange(rows * columns)].reshape(rows, columns)
        start += rows * columns
        corners = (grid[j : rows - 2 + j : 2, i : columns - 2 + i : 2] for j in range(3) for i in range(3))
        quads.append(np.stack([corner.ravel() for corner in corners], axis=1))
    return places[first], np.concatenate(quads)


def _outline(quads: Indices) -> Indices:
    """Return the sides (S, 3) of the quads that no other quad shares, counter-clockwise (x right, y up) round the
    element.
    """
    sides = np.concatenate([quads[:, list(side)] for side in ((0, 1, 2), (2, 5, 8), (8, 7, 6), (6, 3, 0))])
    _, number, count = np.unique(sides[:, 1], return_inverse=True, return_counts=True)
    return np.asarray(sides[count[number] == 1])


def face_values(mesh: GelMesh, places_mm: Floats) -> tuple[Indices, Floats]:
    """Return the nodes (P, 9) of the face's element that each place lies in, and their shape functions (P, 9)
    there.

    Raises ValueError for a place outside the mesh.
    """
    quads = mesh.elements[mesh.elements[:, 0] < mesh.per_layer][:, :9]
    corners = mesh.nodes_mm[quads][:, :, :2]
    nodes, values = np.empty((len(places_mm), 9), dtype=np.intp), np.empty((len(places_mm), 9))
    middle, reach = corners[:, 4], np.abs(corners - corners[:, 4:5]).max(axis=(1, 2))
    for p, place in enumerate(places_mm):
        for quad in np.argsort(np.hypot(*(middle - place).T) / reach)[:12]:
            local = _local(corners[quad], place)
            if np.abs(local).max() < 1 + MICRO:
                nodes[p], values[p] = quads[quad], _face_functions(local)[0]
                break
        else:
            raise ValueError(f"the place {place} lies outside the mesh")
    return nodes, values


def _local(corners: Floats, place: Floats) -> Floats:
    """Return the coordinates in [-1, 1]^2 of a place in a nine-node quad, by Newton's method."""
    local = np.zeros(2)
    for _ in range(12):
        shape, *slopes = _face_functions(local) @ corners
        step = np.linalg.solve(np.transpose(slopes), place - shape)
        local = np.clip(local + step, -2, 2)
        if np.abs(step).max() < 1e-10:
            break
    return local


def _face_functions(local: Floats) -> Floats:
    """Return the nine shape functions, and their slopes along both axes, (3, 9), at a place in [-1, 1]^2."""
    ((x, y), (dx, dy)) = (part.T for part in quadratic(local))
    return np.stack([np.outer(y, x).ravel(), np.outer(y, dx).ravel(), np.outer(dy, x).ravel()])


@dataclass(frozen=True, slots=True)
class WallPoints:
    """`places_mm` (Q, 2) and outward `normals` (Q, 2) along the outline; `depths_mm` (L,) of the levels.

    `weights` (L, U, Q, 3): nodal force on the wall's unknown u by a unit traction along i at point q of level l.
    `unknowns` (U,): numbers of those unknowns in the mesh.
    """

    places_mm: Floats
    normals: Floats
    depths_mm: Floats
    weights: Floats
    unknowns: npt.NDArray[np.intp]


def wall_points(mesh: GelMesh) -> WallPoints:
    """Return three by three points on every element's side on the wall."""
    value, slope = quadratic(GAUSS)
    corners = mesh.nodes_mm[mesh.edges, :2]
    places = np.einsum("np,eni->epi", value, corners).reshape(-1, 2)
    along = np.einsum("np,eni->epi", slope, corners).reshape(-1, 2)
    length = np.hypot(*along.T)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    nodes = np.unique(mesh.edges)
    spread = np.zeros((len(nodes), len(places)))  # nodal share of a unit line load at each point
    node, point = np.searchsorted(nodes, mesh.edges)[:, :, None], np.arange(len(places)).reshape(-1, 1, 3)
    spread[node, point] = value * GAUSS_WEIGHT * length.reshape(-1, 1, 3)
    depths, level_share = _levels(mesh.depths_mm)
    free = len(mesh.depths_mm) - 1
    weights = np.zeros((len(depths), free, len(nodes), 3, len(places), 3))
    for i in range(3):
        weights[:, :, :, i, :, i] = level_share[:, :free, None, None] * spread
    unknowns = 3 * (np.arange(free)[:, None] * mesh.per_layer + nodes)[:, :, None] + np.arange(3)
    return WallPoints(places, normals, depths, weights.reshape(len(depths), -1, len(places), 3), unknowns.ravel())


def _levels(depths_mm: Floats) -> tuple[Floats, Floats]:
    """Return the quadrature depths (L,) and the share (L, node levels) of each in the nodal levels, times its
    length.
    """
    value, _ = quadratic(GAUSS)
    ends = depths_mm[::2]
    half = np.diff(ends) / 2
    share = np.zeros((len(half), 3, len(depths_mm)))
    for element, size in enumerate(half):
        share[element, :, 2 * element : 2 * element + 3] = size * (value * GAUSS_WEIGHT).T
    return ((ends[:-1] + half)[:, None] + np.outer(half, GAUSS)).ravel(), share.reshape(-1, len(depths_mm))


# The sides' part of the compliance, as a table between stations on the gel's face.
#
# For a load at station p the unbounded layer has the traction s(p) at the gel's side. The side is free, so -s(p)
# acts there with no load on the face: K v = -f(s(p)). The table is v at the stations. The loads of all stations
# span few shapes at a side, so K is solved for their leading singular vectors only. Between stations the table is
# interpolated linearly, in source and receiver. Stations outside the gel, or nearer to its side than half their
# load, are moved to the nearest place that is not.
#
# The table is at most a few percent of the whole beyond one thickness from a side. Reciprocity is not imposed: it
# is a test of the mesh.

Singles = npt.NDArray[np.float32]
STATION_MM = 1.25  # mm between stations
LOAD_MM = 0.5  # mm: size of the loads of the table
FORGETS = 3.5  # thicknesses beyond which a side has no effect
RANK_TOLERANCE = 1e-4  # of the largest singular value: smaller ones are dropped
AT_ONCE = 32  # shapes solved together
MAX_ELEMENTS = 280  # squares of an element's width in the gel's face


@dataclass(frozen=True, slots=True)
class SideTable:
    """`table` (3 S, 3 S), x y z of each station over `grid` in turn, mm/N at modulus 1 MPa."""

    grid: NodeGrid
    table: Singles

    def block(self, cells: Cells, parts: int) -> Floats:
        """Return the sides' part of the compliance between cells (parts C, parts C), 1 MPa over a cell's area.

        (1, 1), a 0, where no side is near.
        """
        used, weights = self._stations(cells)
        count = len(self.table) // 3
        part = self.table.reshape(count, 3, count, 3)[used][:, -parts:, used, -parts:].astype(np.float64)
        if not part.any():
            return np.zeros((1, 1))
        inner = np.einsum("rp,piqj,sq->irjs", weights, part, weights, optimize=True)
        return np.asarray(self.grid.cell_mm2 * inner.reshape(parts * len(cells), parts * len(cells)))

    def _stations(self, cells: Cells) -> tuple[Cells, Floats]:
        """Return the stations that `cells` lie between and the weights (cells, stations) of linear
        interpolation.
        """
        row, column = np.divmod(cells, self.grid.shape[1])
        down, across = (
            np.stack([np.interp(mm / STATION_MM + (n - 1) / 2, np.arange(n), unit) for unit in np.eye(n)], axis=1)
            for mm, n in zip((self.grid.y_mm[row], self.grid.x_mm[column]), station_shape(self.grid), strict=True)
        )
        weights = (down[:, :, None] * across[:, None, :]).reshape(len(cells), -1)
        used = np.flatnonzero(weights.any(axis=0))
        return used, weights[:, used]


def station_shape(grid: NodeGrid) -> tuple[int, int]:
    """Return the rows and columns of stations over a grid, centred on the pad."""
    rows, columns = (int(np.ceil((n - 1) * grid.spacing_mm / STATION_MM)) + 1 for n in grid.shape)
    return rows, columns


def side_table(gel: Gel, grid: NodeGrid, *, poisson_ratio: float) -> SideTable | None:
    """Return the table for the stations over `grid`, computed or from the cache.

    None if no side is near the view.
    """
    rows, columns = station_shape(grid)
    x, y = ((np.arange(count) - (count - 1) / 2) * STATION_MM for count in (columns, rows))
    places = _admissible(gel, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    if not (from_side(gel, places) < FORGETS * gel.thickness_mm).any():
        return None
    key = (gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9), rows, columns,
           STATION_MM, LOAD_MM)  # fmt: skip
    return SideTable(grid, kept("sides", key, make=lambda: solve_sides(gel, places, poisson_ratio=poisson_ratio)))


def solve_sides(gel: Gel, places_mm: Floats, *, poisson_ratio: float, element_mm: float | None = None) -> Singles:
    """Return (3 S, 3 S) displacement at `places_mm` (S, 2) that the free sides add to a force of 1 N at each,
    float32.
    """
    mesh = gel_mesh(gel, element_mm or _element_mm(gel))
    wall = wall_points(mesh)
    near = from_side(gel, places_mm) < FORGETS * gel.thickness_mm
    field = layer_stress(
        wall.depths_mm,
        LOAD_MM,
        thickness_mm=gel.thickness_mm,
        poisson_ratio=poisson_ratio,
        reach_mm=FORGETS * gel.thickness_mm,
    )
    loads = -_wall_forces(mesh, wall, field, places_mm[near])
    shapes, sizes, mix = np.linalg.svd(loads, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    matrix = stiffness(mesh.nodes_mm, mesh.elements, poisson_ratio=poisson_ratio)[mesh.free][:, mesh.free]
    factor = splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    answers = []
    for first in range(0, rank, AT_ONCE):  # whole fields are large; only the stations are kept
        shape = shapes[:, first : min(first + AT_ONCE, rank)]
        right = np.zeros((len(mesh.free), shape.shape[1]))
        right[wall.unknowns] = shape
        answers.append(_at_places(mesh, factor.solve(right), places_mm[near]))
    seen = np.hstack(answers) @ (sizes[:rank, None] * mix[:rank])
    three = np.arange(3)
    table = np.zeros((len(places_mm), 3, len(places_mm), 3), dtype=np.float32)
    index = np.flatnonzero(near)
    table[np.ix_(index, three, index, three)] = seen.reshape(len(index), 3, len(index), 3)
    return table.reshape(3 * len(places_mm), 3 * len(places_mm))


def _element_mm(gel: Gel) -> float:
    """Return an element size of three fifths of the thickness, or the least that keeps the mesh factorised in
    seconds.
    """
    if gel.shape == "disc" and gel.radius_mm is not None:
        area = np.pi * gel.radius_mm**2
    else:
        area = float(np.prod(gel.size_mm)) if gel.size_mm is not None else 0.0
    return float(max(0.6 * gel.thickness_mm, np.sqrt(area / MAX_ELEMENTS)))


def _wall_forces(mesh: GelMesh, wall: WallPoints, field: LayerStress, places_mm: Floats) -> Floats:
    """Return (unknowns on the wall, 3 S): nodal forces of the layer's traction on the wall, by loads at
    `places_mm`.
    """
    count = len(places_mm)
    total = np.zeros((len(wall.unknowns), count, 3))
    for level in range(len(wall.depths_mm)):
        offset = wall.places_mm[:, None, :] - places_mm[None, :, :]
        stress = field.at(level, offset.reshape(-1, 2)).reshape(len(wall.places_mm), count, 3, 3, 3)
        traction = np.einsum("qplij,qj->qipl", stress[..., :2], wall.normals)
        total += np.einsum("uqi,qipl->upl", wall.weights[level], traction, optimize=True)
    return total.reshape(len(wall.unknowns), 3 * count)


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


def _at_places(mesh: GelMesh, answer: Floats, places_mm: Floats) -> Floats:
    """Return (3 P, R): the solutions at places on the free face, interpolated by the elements' own functions."""
    nodes, values = face_values(mesh, places_mm)
    unknowns = answer[: 3 * mesh.per_layer].reshape(mesh.per_layer, 3, -1)
    return np.asarray(np.einsum("pn,pnir->pir", values, unknowns[nodes]).reshape(3 * len(places_mm), -1))
