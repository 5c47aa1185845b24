"""Does the scatter itself depend on what the punch does? What comes at random places has no mean to be seen.

A gel that sticks and slips, a contact that rattles: the force jumps at another depth in each press, so no
covariate's mean shows it, but the samples of loading scatter more than those of the hold and the way back. For
each press

    d = mean v_i^2 over loading less the same over the rest,

v the white residual. Student's t of d over the presses, where above 0, squared.
A heavy tail widens t's own spread and noise that is correlated throughout cancels, so neither passes for it. The
mean under the model comes from its bootstrap.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.denoised_depth import LOAD, branches
from calibration.inputs.observations import Observations
from calibration.noise.rectangles import rectangles
from tactilevision.records import Bools, Floats

MIN_PRESSES = 6  # that show both loading and rest; fewer cannot say that one scatters more
MIN_SAMPLES = 3  # of each in a press, to have a scatter at all


class Scatter:
    """The statistic for residuals of one set of measurements; `seen` False where they cannot show it."""

    def __init__(self, data: Observations) -> None:
        loading = branches(data) == LOAD
        self._parts = [(p, loading[p.rows] & p.real, ~loading[p.rows] & p.real) for p in rectangles(data)]
        enough = [_enough(load) & _enough(rest) for _, load, rest in self._parts]
        self._use = np.concatenate(enough)
        self.seen = bool(np.count_nonzero(self._use) >= MIN_PRESSES)

    def differences(self, white: Floats) -> Floats:
        """d of each press (M',), for a white residual (N,)."""
        tables = [(white[part.rows] ** 2, load, rest) for part, load, rest in self._parts]
        d = np.concatenate([_mean(table, load) - _mean(table, rest) for table, load, rest in tables])
        return np.asarray(d[self._use])

    def statistic(self, d: Floats, expected: float) -> float:
        """t^2 of `differences` d against the mean that the model lets expect; 0 where loading scatters less."""
        error = max(float(d.std(ddof=1)) / np.sqrt(d.size), 1e-300)
        return float(max((d.mean() - expected) / error, 0.0) ** 2)


def _enough(where: Bools) -> Bools:
    return np.asarray(where.sum(axis=1) >= MIN_SAMPLES)


def _mean(values: Floats, where: Bools) -> Floats:
    return np.asarray(np.sum(values * where, axis=1) / np.maximum(where.sum(axis=1), 1))
