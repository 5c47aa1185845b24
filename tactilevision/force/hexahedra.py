"""Mesh a block or a disc of gel with triquadratic hexahedra, and integrate over its free sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

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

Elements = npt.NDArray[np.intp]
# places and weights of the three-point Gauss rule on (-1, 1)
GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
GAUSS_WEIGHT = np.array([5, 8, 5]) / 9  # of the same rule; they sum to 2


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


def stiffness(nodes_mm: Floats, elements: Elements, *, poisson_ratio: float) -> sparse.csc_matrix:
    """Return K (3 N, 3 N) of `nodes_mm` (N, 3) and `elements` (M, 27) at modulus 1 MPa.

    Unknown 3 n + i is node n along i.
    """
    parts = [
        _element_matrices(nodes_mm[chunk], poisson_ratio) for chunk in np.array_split(elements, _chunks(elements))
    ]
    blocks = np.concatenate(parts)
    dofs = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 81)
    rows, columns = np.repeat(dofs, 81, axis=1).ravel(), np.tile(dofs, (1, 81)).ravel()
    size = 3 * len(nodes_mm)
    return sparse.csc_matrix(sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=(size, size)))


def _chunks(elements: Elements) -> int:
    return max(1, len(elements) // 200)


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
    cross = np.matmul(
        weighted.transpose(0, 2, 3, 1).reshape(m, 81, 27), gradient.transpose(0, 1, 2, 3).reshape(m, 27, 81)
    )
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

Indices = npt.NDArray[np.intp]
DEPTHS = np.array([0.0, 0.15, 0.45, 1.0])  # ends of the elements through the thickness
CORE = 0.55  # half side of the disc's square core, of its radius


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
    depths = np.sort(np.concatenate([ends, (ends[1:] + ends[:-1]) / 2]))
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
    """Return the places of quadratic nodes on [-1, 1], closer together towards both ends.

    Middles halve their elements.
    """
    even = np.linspace(-1, 1, count + 1)
    ends = even + 0.6 * np.sin(np.pi * even) / np.pi
    return np.sort(np.concatenate([ends, (ends[1:] + ends[:-1]) / 2]))


def _disc(radius_mm: float, element_mm: float) -> list[Floats]:
    side = max(4, int(np.ceil(np.pi / 2 * radius_mm / element_mm)))
    out = max(3, int(np.ceil((1 - CORE) * radius_mm / element_mm)) + 1)
    flat = np.linspace(-1, 1, 2 * side + 1)
    x, y = np.meshgrid(flat * CORE * radius_mm * 0.75, flat * CORE * radius_mm * 0.75)
    patches = [np.stack([x, y], axis=-1)]
    step = np.linspace(0, 1, 2 * out + 1)
    ends = 1 - (1 - step[::2]) ** 1.4
    step[::2], step[1::2] = ends, (ends[1:] + ends[:-1]) / 2
    angle = flat * np.pi / 4
    inner = np.stack([np.full_like(flat, CORE * 0.75), flat * CORE * 0.75], axis=-1) * radius_mm
    outer = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radius_mm
    petal = inner[:, None, :] * (1 - step)[None, :, None] + outer[:, None, :] * step[None, :, None]
    for quarter in range(4):
        c, s = np.round(np.cos(quarter * np.pi / 2)), np.round(np.sin(quarter * np.pi / 2))
        patches.append(petal @ np.array([[c, s], [-s, c]]))
    return patches


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
        quads.append(
            np.stack(
                [grid[j : rows - 2 + j : 2, i : columns - 2 + i : 2].ravel() for j in range(3) for i in range(3)],
                1,
            )
        )
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
            if np.abs(local).max() < 1 + 1e-6:
                nodes[p], values[p] = quads[quad], _product(local)
                break
        else:
            raise ValueError(f"the place {place} lies outside the mesh")
    return nodes, values


def _local(corners: Floats, place: Floats) -> Floats:
    """Return the coordinates in [-1, 1]^2 of a place in a nine-node quad, by Newton's method."""
    local = np.zeros(2)
    for _ in range(12):
        value, slope = quadratic(local)
        shape = np.outer(value[:, 1], value[:, 0]).ravel() @ corners
        by = np.stack(
            [
                np.outer(value[:, 1], slope[:, 0]).ravel() @ corners,
                np.outer(slope[:, 1], value[:, 0]).ravel() @ corners,
            ],
            axis=1,
        )
        step = np.linalg.solve(by, place - shape)
        local = np.clip(local + step, -2, 2)
        if np.abs(step).max() < 1e-10:
            break
    return local


def _product(local: Floats) -> Floats:
    value, _ = quadratic(local)
    return np.outer(value[:, 1], value[:, 0]).ravel()


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
    places, share = [], np.zeros((3 * (len(depths_mm) // 2), len(depths_mm)))
    for element in range(len(depths_mm) // 2):
        top, bottom = depths_mm[2 * element], depths_mm[2 * element + 2]
        for p in range(3):
            places.append((top + bottom) / 2 + GAUSS[p] * (bottom - top) / 2)
            share[3 * element + p, 2 * element : 2 * element + 3] = (
                value[:, p] * GAUSS_WEIGHT[p] * (bottom - top) / 2
            )
    return np.array(places), share
