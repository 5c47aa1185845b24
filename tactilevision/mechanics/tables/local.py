"""Interpolation that looks only at its neighbours."""

from __future__ import annotations

import numpy as np

from tactilevision.records import Floats


def cubic_weights(nodes: Floats, at: Floats) -> Floats:
    """Lagrange weights (T, N) of the cubic through the four nodes nearest about each of `at` (T,).

    Exact for cubics; error O(spacing^4) for smooth functions. `nodes` ascend; fewer than four give what they can.
    """
    size = min(4, len(nodes))
    cell = np.searchsorted(nodes, at, side="right") - 1
    start = np.clip(cell - 1, 0, len(nodes) - size)
    weights = np.zeros((len(at), len(nodes)))
    for i in range(size):
        basis = np.ones(len(at))
        for j in range(size):
            if j != i:
                basis *= (at - nodes[start + j]) / (nodes[start + i] - nodes[start + j])
        weights[np.arange(len(at)), start + i] = basis
    return weights
