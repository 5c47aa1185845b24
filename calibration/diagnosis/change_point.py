"""Since which press something is different: a jump in the mean residual of presses, held against chance.

The presses' means are taken in the order of time, each press one number, and the largest cumulative sum over its
own spread is compared with that of the same numbers in other orders: like presses change places with like (same
indenter and rate), so that a protocol that runs from small to large punches is no jump.
"""

from __future__ import annotations

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import repeat_groups
from tactilevision.records import Floats

LEVEL = 0.05  # chance of a jump where there is none, for one order of presses
SHUFFLES = 999  # orders that chance is read from: p to .001
MIN_COUNT = 8  # presses; with fewer a jump and its place cannot be told from scatter


def change_point(fitted: Fit, rng: np.random.Generator) -> str | None:
    """The first press after the jump; None where none is beyond chance or there are fewer than eight presses."""
    data = fitted.data
    if data.count < MIN_COUNT:
        return None
    weight = np.bincount(data.press, fitted.about.force_N**2)
    mean = np.bincount(data.press, fitted.residual_N * fitted.about.force_N) / np.maximum(weight, 1e-300)
    groups = repeat_groups(data)
    rest = mean - (np.bincount(groups, mean) / np.bincount(groups))[groups]
    if not np.std(rest) > 0:
        return None
    place, size = _largest(rest)
    chance = [_largest(_shuffled(rest, groups, rng))[1] for _ in range(SHUFFLES)]
    beyond = (1 + np.count_nonzero(np.array(chance) >= size)) / (1 + SHUFFLES)
    return data.presses.label[place + 1] if beyond < LEVEL else None


def _largest(values: Floats) -> tuple[int, float]:
    path = np.abs(np.cumsum(values)[:-1])
    k = int(np.argmax(path))
    return k, float(path[k])


def _shuffled(
    values: Floats, groups: np.ndarray[tuple[int], np.dtype[np.int64]], rng: np.random.Generator
) -> Floats:
    """The values of each group in another order."""
    mixed = values.copy()
    for group in np.unique(groups):
        mine = np.flatnonzero(groups == group)
        mixed[mine] = values[rng.permutation(mine)]
    return mixed
