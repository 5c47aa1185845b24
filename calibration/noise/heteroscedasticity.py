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

from calibration.effects.support.hereditary import Grid
from calibration.inputs.denoised_depth import LOAD, branches
from calibration.inputs.observations import Observations
from tactilevision.records import Bools, Floats

MIN_PRESSES = 6  # that show both loading and rest; fewer cannot say that one scatters more
MIN_SAMPLES = 3  # of each in a press, to have a scatter at all


class Scatter:
    """The statistic for residuals of one set of measurements; `seen` False where they cannot show it."""

    def __init__(self, data: Observations) -> None:
        self._grid = Grid.of(data)
        self._load, self._rest = self._sides(branches(data) == LOAD)
        enough = (self._load.sum(axis=1) >= MIN_SAMPLES) & (self._rest.sum(axis=1) >= MIN_SAMPLES)
        self._use = enough
        self.seen = bool(np.count_nonzero(enough) >= MIN_PRESSES)

    def _sides(self, loading: Bools) -> tuple[Bools, Bools]:
        real = self._grid.real
        return loading[self._grid.rows] & real, ~loading[self._grid.rows] & real

    def differences(self, white: Floats) -> Floats:
        """d of each press (M',), for a white residual (N,)."""
        table = white[self._grid.rows] ** 2
        return np.asarray((_mean(table, self._load) - _mean(table, self._rest))[self._use])

    def statistic(self, d: Floats, expected: float) -> float:
        """t^2 of `differences` d against the mean that the model lets expect; 0 where loading scatters less."""
        error = max(float(d.std(ddof=1)) / np.sqrt(d.size), 1e-300)
        return float(max((d.mean() - expected) / error, 0.0) ** 2)


def _mean(values: Floats, where: Bools) -> Floats:
    return np.asarray(np.sum(values * where, axis=1) / np.maximum(where.sum(axis=1), 1))
