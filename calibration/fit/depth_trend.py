"""Does an error grow or fall with depth? A straight line through the errors, and Student's test of its slope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactilevision.records import Floats, Pair

LEVEL = 0.01  # below this chance of a mere coincidence a trend is said to be one
SAME = 1e-6  # errors that leave the line by less than this are on it: rounding, not scatter


@dataclass(frozen=True, slots=True)
class Trend:
    """`over_range` is the line's rise from the shallowest to the deepest sample, `interval95` its interval;
    `p_value` the chance of such a slope where there is none; all None where `why` says what is missing."""

    over_range: float | None
    interval95: Pair | None
    p_value: float | None
    why: str = ""

    @property
    def found(self) -> bool:
        """True where the error follows the depth."""
        return self.p_value is not None and self.p_value < LEVEL

    def as_json(self) -> dict[str, Any]:
        """For validation.json."""
        return {
            "over_range": self.over_range,
            "interval95": None if self.interval95 is None else list(self.interval95),
            "p_value": self.p_value,
            "found": self.found if self.p_value is not None else None,
        } | ({"why": self.why} if self.why else {})


def find_trend(depth_mm: Floats, error: Floats) -> Trend:
    """The trend of `error` (N,) along `depth_mm` (N,); samples with an error that is not finite are left out.

    Least squares, t = slope / std with N - 2 degrees of freedom; the samples count as independent and alike.
    """
    from scipy.stats import t as student

    use = np.isfinite(error)
    x, y = depth_mm[use], error[use]
    if np.unique(x).size < 3:
        return Trend(None, None, None, "fewer than three depths: a trend cannot be told from scatter")
    span = float(np.ptp(x))
    x = (x - x.mean()) / span
    slope = float(x @ y / (x @ x))
    left = y - y.mean() - slope * x
    dof = x.size - 2
    std = max(float(np.sqrt(left @ left / dof)), SAME) / float(np.sqrt(x @ x))
    reach = float(student.ppf(0.975, dof)) * std
    return Trend(slope, (slope - reach, slope + reach), float(2 * student.sf(abs(slope) / std, dof)))
