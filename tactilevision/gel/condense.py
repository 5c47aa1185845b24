"""Compliance between loads on a solid, by one forward sweep over dense fronts.

Elements are halved by their coordinates again and again (nested dissection). A node belongs to the smallest part
of that tree that holds all its elements, and is eliminated there, from the leaves to the root. With K = L L^T and
loads B (unknowns, loads), each front has its rows of Y = L^-1 B, and

    C = B^T K^-1 B = sum over fronts of Y^T Y,

so no factor is kept, and a front has only the loads of its own part.

Source: George, Nested dissection of a regular finite element mesh (1973); Duff and Reid, The multifrontal solution
of indefinite sparse symmetric linear equations (1983).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import blas, lapack

from tactilevision.errors import ConvergenceError
from tactilevision.gel.elements import Ints
from tactilevision.records.measured import Bools, Floats

LEAF = 12  # elements of a leaf: below, the overhead of a front exceeds its work
Singles = npt.NDArray[np.float32]
Stiffness = Callable[[Ints], Floats]


@dataclass(frozen=True, slots=True)
class Front:
    """What a part leaves to its parent: `matrix` and `loads` of its outer `nodes`, by the loads `columns`."""

    nodes: Ints
    matrix: Floats
    columns: Ints
    loads: Floats


def condensed(
    elements: Ints, places_mm: Floats, held: Bools, *, stiffness: Stiffness, loads: sparse.csr_array
) -> Singles:
    """Return C (3, n, 3, n), mm/N: mean displacement of load j by load i, along x, y, z.

    `elements` (E, k) and `places_mm` (N, 3) are the mesh, `held` (N,) the fixed nodes, `stiffness` gives K
    (e, 3 k, 3 k) of some elements, and `loads` (N, n) are the nodal shares of unit loads. Raises ConvergenceError
    where the solid is not held.
    """
    depth = max(0, int(np.ceil(np.log2(len(elements) / LEAF))))
    leaf = _leaves(places_mm[elements].mean(axis=1), depth)
    sweep = _Sweep(elements, held, stiffness, loads, (leaf, _owners(elements, leaf, len(places_mm))))
    sweep.run(1)
    return sweep.result.reshape(3, loads.shape[1], 3, loads.shape[1])


def _leaves(middles: Floats, depth: int) -> Ints:
    """Return the leaf (E,) of each element: halves of halves along the longest side of each part."""
    leaf = np.zeros(len(middles), dtype=np.intp)
    for _ in range(depth):
        for part in range(leaf.max() + 1):
            own = np.flatnonzero(leaf == part)
            axis = int(np.argmax(np.ptp(middles[own], axis=0)))
            order = own[np.argsort(middles[own, axis], kind="stable")]
            leaf[order[: len(own) // 2]] = -2 * part - 1
            leaf[order[len(own) // 2 :]] = -2 * part - 2
        leaf = -leaf - 1
    return leaf


def _owners(elements: Ints, leaf: Ints, count: int) -> Ints:
    """Return the part (N,) that eliminates each node: root 1, halves 2 k and 2 k + 1; 0 for an unused node."""
    depth = int(leaf.max()).bit_length()
    first, last = np.full(count, np.iinfo(np.intp).max), np.full(count, -1)
    own = np.repeat(leaf + (1 << depth), elements.shape[1])
    np.minimum.at(first, elements.ravel(), own)
    np.maximum.at(last, elements.ravel(), own)
    first[last < 0] = last[last < 0] = 0
    while (apart := first != last).any():
        first[apart], last[apart] = first[apart] >> 1, last[apart] >> 1
    return first


class _Sweep:
    def __init__(
        self, elements: Ints, held: Bools, stiffness: Stiffness, loads: sparse.csr_array, owner: tuple[Ints, Ints]
    ) -> None:
        self.elements, self.held, self.stiffness, self.loads = elements, held, stiffness, loads
        self.leaf, self.owner = owner
        self.depth, self.loaded = int(self.leaf.max()).bit_length(), np.diff(loads.indptr) > 0
        self.result = np.zeros((3 * loads.shape[1],) * 2, dtype=np.float32)

    def run(self, part: int) -> Front:
        """Return what is left of a part after its own nodes are eliminated."""
        if part >> self.depth:
            front = self._leaf(np.flatnonzero(self.leaf == part - (1 << self.depth)))
        else:
            front = _joined(self.run(2 * part), self.run(2 * part + 1))
        return self._eliminated(front, self.owner[front.nodes] == part)

    def _leaf(self, own: Ints) -> Front:
        nodes, local = np.unique(self.elements[own], return_inverse=True)
        local = local.reshape(len(own), -1)
        unknowns = (3 * local[:, :, None] + np.arange(3)).reshape(len(own), -1)
        matrix = np.zeros((3 * len(nodes),) * 2, order="F")
        for row, block in zip(unknowns, self.stiffness(own), strict=True):
            matrix[np.ix_(row, row)] += block
        free = np.flatnonzero(~self.held[nodes])
        kept = _unknowns(free)
        return Front(nodes[free], matrix[np.ix_(kept, kept)], np.zeros(0, np.intp), np.zeros((3 * len(free), 0)))

    def _eliminated(self, front: Front, inner: Bools) -> Front:
        own, outer = np.flatnonzero(inner), np.flatnonzero(~inner)
        if not len(own):
            return front
        rows = self.loads[front.nodes[own]].tocoo() if self.loaded[front.nodes[own]].any() else None
        columns, right = front.columns, front.loads
        if rows is not None and rows.nnz:
            columns = np.union1d(columns, rows.col)
            wide = np.zeros((len(right), 3, len(columns)))
            wide[:, :, np.searchsorted(columns, front.columns)] = right.reshape(len(right), 3, -1)
            for i in range(3):
                wide[3 * own[rows.row] + i, i, np.searchsorted(columns, rows.col)] += rows.data
            right = wide.reshape(len(right), -1)
        a, b = _unknowns(own), _unknowns(outer)
        lower, fault = lapack.dpotrf(front.matrix[np.ix_(a, a)], lower=1, overwrite_a=1)
        if fault:
            raise ConvergenceError("the solid's stiffness is not positive definite: it is not held, or folded")
        across = blas.dtrsm(1.0, lower, front.matrix[np.ix_(a, b)], lower=1)
        y = blas.dtrsm(1.0, lower, right[a], lower=1) if len(columns) else right[a]
        if len(columns):
            single = y.astype(np.float32)
            place = (np.arange(3)[:, None] * self.loads.shape[1] + columns).ravel()
            self.result[np.ix_(place, place)] += single.T @ single
        left = front.matrix[np.ix_(b, b)]
        left -= across.T @ across
        return Front(front.nodes[outer], left, columns, right[b] - across.T @ y)


def _unknowns(nodes: Ints) -> Ints:
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _joined(one: Front, other: Front) -> Front:
    """Add two fronts over the union of their nodes and loads."""
    nodes, columns = np.union1d(one.nodes, other.nodes), np.union1d(one.columns, other.columns)
    matrix, loads = np.zeros((3 * len(nodes),) * 2), np.zeros((3 * len(nodes), 3, len(columns)))
    for part in (one, other):
        rows = _unknowns(np.searchsorted(nodes, part.nodes))
        matrix[np.ix_(rows, rows)] += part.matrix
        place = np.searchsorted(columns, part.columns)
        loads[np.ix_(rows, np.arange(3), place)] += part.loads.reshape(len(rows), 3, -1)
    return Front(nodes, matrix, columns, loads.reshape(3 * len(nodes), -1))
