"""The free side of a gel's mesh: quadrature points on it, and the way from tractions there to nodal forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.force.lateral_boundaries.hexahedra import GAUSS, GAUSS_WEIGHT, quadratic
from tactilevision.force.lateral_boundaries.mesh import GelMesh
from tactilevision.records import Floats


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
    """Three by three points on every element's side on the wall."""
    value, slope = quadratic(GAUSS)
    corners = mesh.nodes_mm[mesh.edges, :2]
    places = np.einsum("np,eni->epi", value, corners).reshape(-1, 2)
    along = np.einsum("np,eni->epi", slope, corners).reshape(-1, 2)
    length = np.hypot(*along.T)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    nodes = np.unique(mesh.edges)
    number = {int(n): k for k, n in enumerate(nodes)}
    spread = np.zeros((len(nodes), len(places)))  # nodal share of a unit line load at each point
    for e, edge in enumerate(mesh.edges):
        for n in range(3):
            for p in range(3):
                q = 3 * e + p
                spread[number[int(edge[n])], q] += value[n, p] * GAUSS_WEIGHT[p] * length[q]
    depths, level_share = _levels(mesh.depths_mm)
    free = len(mesh.depths_mm) - 1
    weights = np.zeros((len(depths), free, len(nodes), 3, len(places), 3))
    for i in range(3):
        weights[:, :, :, i, :, i] = level_share[:, :free, None, None] * spread
    unknowns = 3 * (np.arange(free)[:, None] * mesh.per_layer + nodes)[:, :, None] + np.arange(3)
    return WallPoints(places, normals, depths, weights.reshape(len(depths), -1, len(places), 3), unknowns.ravel())


def _levels(depths_mm: Floats) -> tuple[Floats, Floats]:
    """Quadrature depths (L,) and the share (L, node levels) of each in the nodal levels, times its length."""
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
