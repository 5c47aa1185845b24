"""A block of gel in hexahedra: a rectangle in rows and columns, a disc as a square core with four petals round it.

Nodes are numbered layer by layer, from the free face z = 0 to the base z = h. Elements shrink towards the free
face and the sides, where the correction lives; geometry is quadratic, so that a disc's side is round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.force.lateral_boundaries.hexahedra import quadratic
from tactilevision.records import Floats, Gel

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
        """Unknowns that are not held at the base."""
        return np.arange(3 * self.per_layer * (len(self.depths_mm) - 1))


def gel_mesh(gel: Gel, element_mm: float) -> GelMesh:
    """Mesh of a gel that has sides (disc or rectangle) with elements about `element_mm` wide."""
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
    """Node places (2 n + 1, 2 m + 1, 2) of the whole plane, x fastest."""
    axes = [_graded(max(4, int(np.ceil(length / element_mm)))) * length / 2 for length in size_mm]
    x, y = np.meshgrid(*axes)
    return np.stack([x, y], axis=-1)


def _graded(count: int) -> Floats:
    """Places of quadratic nodes on [-1, 1], closer together towards both ends; middles halve their elements."""
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
    """Places (N, 2) without doubles and nine-node quads (M, 9), x fastest within each."""
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
    """Sides (S, 3) of the quads that no other quad shares, counter-clockwise (x right, y up) round the element."""
    sides = np.concatenate([quads[:, list(side)] for side in ((0, 1, 2), (2, 5, 8), (8, 7, 6), (6, 3, 0))])
    _, number, count = np.unique(sides[:, 1], return_inverse=True, return_counts=True)
    return np.asarray(sides[count[number] == 1])


def face_values(mesh: GelMesh, places_mm: Floats) -> tuple[Indices, Floats]:
    """Nodes (P, 9) of the face's element that each place lies in, and their shape functions (P, 9) there.

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
    """Coordinates in [-1, 1]^2 of a place in a nine-node quad, by Newton's method."""
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
