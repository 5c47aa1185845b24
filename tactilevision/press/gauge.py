"""The scale in which the camera reads the depth of a face, from the certified events of all presses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.records import Floats, Pair


@dataclass(frozen=True, slots=True)
class Gauge:
    """True over seen depth, a polynomial in the seen depth (lowest power first), held beyond `limits_mm`;
    scatter.
    """

    coefficients: tuple[float, ...]
    limits_mm: Pair
    scatter: float

    def scale(self, seen_mm: Floats | float) -> Floats:
        held = np.clip(np.asarray(seen_mm, dtype=np.float64), *self.limits_mm)
        return np.asarray(np.polynomial.polynomial.polyval(held, self.coefficients), dtype=np.float64)


def find_gauge(pairs: Sequence[Pair]) -> Gauge | None:
    """Gauge through (seen, true) depths at the events: constant, linear or square as the depths are spread."""
    usable = np.array([p for p in pairs if p[0] > 0 and p[1] > 0]).reshape(-1, 2)
    if not len(usable):
        return None
    seen, scale = usable[:, 0], usable[:, 1] / usable[:, 0]
    spread = len(np.unique(np.round(usable[:, 1] / (0.1 * usable[:, 1].max()))))
    degree = int(np.clip(min(spread, len(usable) // 2) - 1, 0, 2))
    coefficients = np.polynomial.polynomial.polyfit(seen, scale, degree)
    residual = scale - np.polynomial.polynomial.polyval(seen, coefficients)
    return Gauge(
        tuple(float(c) for c in coefficients), (float(seen.min()), float(seen.max())), float(residual.std())
    )
