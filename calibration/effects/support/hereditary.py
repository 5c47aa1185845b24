"""The hereditary integral of linear viscoelasticity over many presses at once.

    q(t) = P_e(t) - Int_0^t exp(-(t - s)/tau) dP_e(s),    so that P = P_e - sum_i g_i q_i

P_e elastic force (instantaneous modulus), taken as straight between samples, so each step is exact:
h_new = h exp(-dt/tau) + dP tau/dt (1 - exp(-dt/tau)). A press starts from 0 at its
first sample.
Source: Fung, Biomechanics (1993), sec. 7.6 (quasi-linear viscoelasticity); Taylor, Pister, Goudreau,
Int. J. Numer. Meth. Eng. 2 (1970) 45 (the recursion).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Ints, Observations
from tactilevision.records import Bools, Floats

KEPT = 8  # data sets of which the rectangle is kept: a fit asks for it at every step


@dataclass(frozen=True, slots=True)
class Grid:
    """Samples of presses as a rectangle (M, T): `rows` indices into the samples, `real` False where padded."""

    rows: Ints
    real: Bools
    step_s: Floats

    @staticmethod
    @lru_cache(maxsize=KEPT)
    def of(data: Observations) -> Grid:
        """One row a press, padded at its end by its last sample; step_s (M, T) from the sample before."""
        first = data.first
        length = np.diff(np.append(first, data.size))
        offset = np.arange(int(length.max()))
        rows = first[:, None] + np.minimum(offset, (length - 1)[:, None])
        time = data.time_s[rows]
        step = np.diff(time, axis=1, prepend=time[:, :1])
        return Grid(rows, offset < length[:, None], np.maximum(step, 0))

    def flatten(self, table: Floats) -> Floats:
        """Back from (M, T) to (N,)."""
        return np.asarray(table[self.real])


def relaxed(force_N: Floats, tau_s: float, *, data: Observations) -> Floats:
    """q (N,): the part of the elastic force that a Prony term of this time constant has let go of."""
    grid = Grid.of(data)
    force = force_N[grid.rows]
    decay = np.exp(-grid.step_s / tau_s)
    ratio = grid.step_s / tau_s
    gain = np.where(ratio > 1e-8, -np.expm1(-ratio) / np.maximum(ratio, 1e-300), 1.0)
    held = np.empty_like(force)
    held[:, 0] = force[:, 0]
    rise = np.diff(force, axis=1) * gain[:, 1:]
    for k in range(1, force.shape[1]):
        held[:, k] = held[:, k - 1] * decay[:, k] + rise[:, k - 1]
    return force_N - grid.flatten(held)
