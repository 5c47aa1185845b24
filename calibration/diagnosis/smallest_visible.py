"""The least size of each effect that four of five such data would show.

Where many presses tell the noise, that is 3.6 std. Few hardly do: the limit is then the one that draws of the
model put on each effect's likelihood ratio, and a larger gain of the presses may stand for part of what is there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calibration.diagnosis.projection import Cast
from calibration.diagnosis.tail_probability import Tail
from calibration.model.stages import Effect
from tactilevision.records import Floats

KNOWN = 3.6  # std that stand beyond the level in four of five such data, where presses tell the noise
FOUR_OF_FIVE = 0.84  # std beyond a limit: a normal's four fifths
MOST = 1e6  # of a statistic


def smallest_visible(
    cast: Cast, effects: Sequence[Effect], keys: Sequence[str], *, level: float, drawn: Floats | None
) -> dict[str, float]:
    """Amplitude of the first parameter of each effect of these `keys`, whose tables are the first of `cast`; inf
    where the model takes all of it.

    It is that of the most visible start; of those where no other size (of the same unit) is off, if there are any.
    `drawn` (n, k), dimensionless: their statistics where nothing is there, of few presses; None of many.
    `level` of all of them.
    """
    by_key, found = {e.key: e for e in effects}, {}
    ends, std = np.concatenate([[0], cast.ends]), np.full(cast.sizes.size, KNOWN)
    if drawn is not None and drawn.shape[1]:
        ratio = (np.sqrt(_limits(drawn, level)) + FOUR_OF_FIVE) ** 2
        each = np.repeat(ratio, np.diff(ends[: len(keys) + 1]))
        std = cast.shown(np.pad(each, (0, std.size - each.size)))
    for k, key in enumerate(keys):
        mine, table = slice(ends[k], ends[k + 1]), by_key[key].parameters
        off = np.abs(by_key[key].starts(cast.fitted.data) - np.array([p.default for p in table]))
        others = [q for q in range(1, len(table)) if table[q].unit == table[0].unit]
        alone = (off[:, others] == 0).all(axis=1) & (off[:, 0] > 0)
        may = cast.left[k] & (cast.sizes[mine] > 1e-9) & (off[:, 0] > 0) & (alone | ~alone.any())
        best = int(np.argmax(np.where(may, cast.sizes[mine], 0.0)))
        found[key] = float(off[best, 0] * std[mine][best] / cast.sizes[mine][best]) if may[best] else float("inf")
    return found


def _limits(drawn: Floats, level: float) -> Floats:
    """Of each statistic (k,) where it comes to the level of all, by drawn ones (n, k)."""
    tails = [Tail(column) for column in drawn.T]
    seen = [tail.of_each() for tail, column in zip(tails, drawn.T, strict=True) if column.any()]
    family = Tail(-np.log(np.min(seen, axis=0, initial=1.0)))
    p = float(np.exp(-_crossing(family, level)))
    return np.array([_crossing(tail, p) for tail in tails])


def _crossing(tail: Callable[[float], float], p: float) -> float:
    """Where p, which falls, comes down to this one."""
    low, high = 0.0, 1.0
    while tail(high) > p and high < MOST:
        high *= 2
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if tail(middle) > p else (low, middle)
    return high
