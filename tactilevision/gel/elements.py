"""Element stiffness of nearly incompressible solids: hexahedra of 27 nodes and tetrahedra of 10.

    K = Int 2 mu eps(v) : eps(u) + lambda P(div v) P(div u)

P is the L2 projection in each element on 1, x, y, z for hexahedra (Q2/P-1, stable as nu -> .5), and on constants
for tetrahedra (P2/P0). Geometry has the same nodes as displacement, so faces are curved.

Nodes of a hexahedron are numbered i + 3 j + 9 k with i, j, k in 0, 1, 2 along its own axes; those of a tetrahedron
are its corners 0 to 3 and the middles of the edges 01, 02, 03, 12, 13, 23.

Source: Boffi, Brezzi, Fortin, Mixed Finite Element Methods (2013), sections 8.6 and 8.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from tactilevision.records.measured import Floats

Ints = npt.NDArray[np.intp]
HEX = 27  # nodes of a hexahedron
TET = 10  # nodes of a tetrahedron
EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # of a tetrahedron, in the order of their middle nodes
GAUSS = (np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 9)  # points and weights on [-1, 1]


@dataclass(frozen=True, slots=True)
class Table:
    """Shape `values` (Q, n) and `slopes` (Q, n, 3) at quadrature points of `weight` (Q,); `modes` of pressure."""

    values: Floats
    slopes: Floats
    weight: Floats
    modes: int


def quadratic(x: Floats) -> tuple[Floats, Floats]:
    """Return the quadratic shape functions on [-1, 1] at `x` (n,), and their slopes, (n, 3), dimensionless."""
    values = np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], axis=-1)
    return values, np.stack([x - 0.5, -2 * x, x + 0.5], axis=-1)


def tetrahedral(at: Floats) -> tuple[Floats, Floats]:
    """Return ten shape functions (n, 10) at `at` (n, 3) in [0, 1], and their slopes (n, 10, 3), dimensionless."""
    corner = np.column_stack([1 - at.sum(axis=1), at])
    steep = np.vstack([-np.ones(3), np.eye(3)])
    a, b = (list(one) for one in zip(*EDGES, strict=True))
    values = np.concatenate([corner * (2 * corner - 1), 4 * corner[:, a] * corner[:, b]], axis=1)
    own = (4 * corner - 1)[:, :, None] * steep
    between = 4 * (corner[:, a, None] * steep[b] + corner[:, b, None] * steep[a])
    return values, np.concatenate([own, between], axis=1)


@cache
def table_of(nodes: int) -> Table:
    """Return the quadrature of an element with `nodes` nodes."""
    if nodes == HEX:
        x, w = GAUSS
        f, s = quadratic(x)
        values = np.einsum("ra,qb,pc->rqpabc", f, f, f).reshape(27, 27)
        parts = [
            np.einsum("ra,qb,pc->rqpabc", *order).reshape(27, 27) for order in ((f, f, s), (f, s, f), (s, f, f))
        ]
        return Table(values, np.stack(parts, axis=-1), np.einsum("r,q,p->rqp", w, w, w).ravel(), 4)
    a, b = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20  # four points, exact for quadratic functions
    values, slopes = tetrahedral(np.where(np.eye(4)[:, 1:] > 0, b, a))
    return Table(values, slopes, np.full(4, 1 / 24), 1)


def volumes(places_mm: Floats) -> Floats:
    """Return the volume element (E, Q), mm³, at the quadrature points of elements (E, n, 3); below 0: inverted."""
    slopes = table_of(places_mm.shape[1]).slopes
    return np.asarray(np.linalg.det(np.einsum("eni,qnj->eqij", places_mm, slopes)))


def stiffness(places_mm: Floats, shear: Floats, lame: Floats) -> Floats:
    """Return K (E, 3 n, 3 n), N/mm, of elements with nodes at `places_mm` (E, n, 3); x, y, z of each node in turn.

    `shear` and `lame` (E,) are mu and lambda, MPa.
    """
    one, (count, n, _) = table_of(places_mm.shape[1]), places_mm.shape
    turn = np.einsum("eni,qnj->eqij", places_mm, one.slopes)
    weight = np.linalg.det(turn) * one.weight
    slope = (one.slopes @ np.linalg.inv(turn)).reshape(count, -1, 3 * n)
    heavy = weight[:, :, None] * slope
    product = (heavy.transpose(0, 2, 1) @ slope).reshape(count, n, 3, n, 3)
    found = product.transpose(0, 1, 4, 3, 2).copy()
    trace = np.einsum("eaibi->eab", product)
    for i in range(3):
        found[:, :, i, :, i] += trace
    found *= shear[:, None, None, None, None]
    modes = np.ones((count, len(one.weight), 1))
    if one.modes > 1:
        place = np.einsum("qn,eni->eqi", one.values, places_mm)
        modes = np.concatenate([modes, place - place.mean(axis=1, keepdims=True)], axis=2)
    spread = modes.transpose(0, 2, 1) @ heavy
    mass = modes.transpose(0, 2, 1) @ (weight[:, :, None] * modes)
    volume = spread.transpose(0, 2, 1) @ np.linalg.solve(mass, lame[:, None, None] * spread)
    return np.asarray(found.reshape(count, 3 * n, 3 * n) + volume)
