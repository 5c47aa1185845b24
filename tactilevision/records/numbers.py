"""Arrays by their numbers' type, and a number with what is not known about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with what is not known about it.

    `value` is None where the data cannot fix it; `why` then says so, and `interval95` still holds the
    range that the stated assumptions allow.
    """

    value: float | None
    std: float | None
    interval95: Pair | None
    unit: str
    why: str = ""

    def as_json(self) -> dict[str, Any]:
        """The form of every result file: value, std, interval95, unit, and why, where there is one."""
        interval = None if self.interval95 is None else list(self.interval95)
        content = {"value": self.value, "std": self.std, "interval95": interval, "unit": self.unit}
        return content | ({"why": self.why} if self.why else {})
