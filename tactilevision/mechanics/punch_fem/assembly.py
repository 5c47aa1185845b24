"""Global vectors and the sparse matrix: the pattern is found once, each tangent only fills in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from tactilevision.mechanics.punch_fem.discretisation import Ints
from tactilevision.records import Bools, Floats


@dataclass(frozen=True, slots=True)
class Pattern:
    """Where element entries go among the free unknowns.

    `free` (n,) numbers of the free unknowns; `kept` and `slot` per element table: which of its flattened entries
    couple two free unknowns, and to which stored entry each adds.
    """

    free: Ints
    kept: tuple[Ints, ...]
    slot: tuple[Ints, ...]
    indices: Ints
    indptr: Ints


def find_pattern(tables: tuple[Ints, ...], free: Bools) -> Pattern:
    """The pattern of all `tables` (K, n) of unknowns together, restricted to `free` (N,)."""
    number = np.cumsum(free) - 1
    size = int(free.sum())
    kept, keys = [], []
    for table in tables:
        rows = np.repeat(table, table.shape[1], axis=1).ravel()
        columns = np.tile(table, (1, table.shape[1])).ravel()
        keep = np.flatnonzero(free[rows] & free[columns])
        kept.append(keep)
        keys.append(number[columns[keep]] * size + number[rows[keep]])
    unique, slots = np.unique(np.concatenate(keys), return_inverse=True)
    splits = np.cumsum([len(k) for k in keys])[:-1]
    return Pattern(
        free=np.flatnonzero(free),
        kept=tuple(kept),
        slot=tuple(np.split(slots, splits)),
        indices=unique % size,
        indptr=np.searchsorted(unique // size, np.arange(size + 1)),
    )


def assemble(pattern: Pattern, stiffnesses: tuple[Floats, ...]) -> sparse.csc_array:
    """Sum element stiffnesses (K, n, n), N per mm, one array a table, into the free unknowns' matrix."""
    data = np.zeros(len(pattern.indices))
    for kept, slot, stiffness in zip(pattern.kept, pattern.slot, stiffnesses, strict=True):
        data += np.bincount(slot, stiffness.reshape(-1)[kept], minlength=len(data))
    size = len(pattern.free)
    return sparse.csc_array((data, pattern.indices, pattern.indptr), shape=(size, size))


def factorise(matrix: sparse.csc_array) -> SuperLU:
    """LU in SuperLU's symmetric mode: the pattern is symmetric, and the values nearly so."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True, "DiagPivotThresh": 0.001})


def scatter(size: int, tables: tuple[Ints, ...], *, forces: tuple[Floats, ...]) -> Floats:
    """Sum element forces (K, n), in N, into a vector of all `size` unknowns."""
    total = np.zeros(size)
    for table, force in zip(tables, forces, strict=True):
        total += np.bincount(table.ravel(), force.ravel(), minlength=size)
    return total
