"""What models make of measurements, as numbers that a figure shows: curves, residuals, and how the error falls.

One row a model throughout, the plain law's first, then each with one more effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records.measured import Floats, Pair


@dataclass(frozen=True, slots=True)
class PressCurve:
    """The n samples of one press, and the force of m models at each.

    `time_s` (n,) since its first sample; `depth_mm`, `measured_N` (n,); `modelled_N` (m, n); `phase` one of load,
    hold, unload and free for each sample.
    """

    label: str
    indenter: str
    radius_mm: float
    time_s: Floats
    depth_mm: Floats
    measured_N: Floats
    modelled_N: Floats
    phase: tuple[str, ...]

    @property
    def residual_N(self) -> Floats:
        """Measured less modelled (m, n), N."""
        return np.asarray(self.measured_N - self.modelled_N)

    @property
    def rms_N(self) -> Floats:
        """Root mean square of each model's residual (m,), N."""
        return np.asarray(np.sqrt(np.mean(self.residual_N**2, axis=1)))


@dataclass(frozen=True, slots=True)
class ForceCurves:
    """The presses in the order in which they were made, under the models named; `whole` where presses are curves
    in time, not single points.
    """

    models: tuple[str, ...]
    presses: tuple[PressCurve, ...]
    whole: bool

    @property
    def radii_mm(self) -> tuple[float, ...]:
        """The radii that occur, the smallest first."""
        return tuple(sorted({one.radius_mm for one in self.presses}))

    def telling(self, most: int) -> tuple[PressCurve, ...]:
        """Return the presses whose rms changes most from the first model to the last, in the order of pressing; of
        one model those with the largest.
        """
        last = -1 if len(self.models) > 1 else slice(0, 0)
        by_change = sorted(self.presses, key=lambda one: -abs(float(one.rms_N[0] - np.sum(one.rms_N[last]))))
        kept = {one.label for one in by_change[:most]}
        return tuple(one for one in self.presses if one.label in kept)


@dataclass(frozen=True, slots=True)
class Strip:
    """The residuals of m models against one thing that was recorded, N samples, k bins.

    `words` what it is as a person says it; `values` (N,) in `unit`; `levels` the words for 0, 1, 2 ... where the
    values only count; `centre` (k,) of the bins, `mean_N` and `reach95_N` (m, k) the mean residual there and its
    95 % interval's half width; `p_adjusted` (m,) that each model's dependence on it is chance, for all looks;
    `p_trend` (m,) the same of a trend over the presses alone, NaN where none was looked for.
    """

    name: str
    words: str
    unit: str
    levels: tuple[str, ...]
    values: Floats
    centre: Floats
    mean_N: Floats
    reach95_N: Floats
    p_adjusted: tuple[float, ...]
    p_trend: tuple[float, ...]

    @property
    def swing_N(self) -> tuple[float, ...]:
        """How far the bins' means reach from each other, for each model, N."""
        return tuple(float(np.ptp(row)) for row in self.mean_N)


@dataclass(frozen=True, slots=True)
class ResidualStrips:
    """Strips of one set of samples, the most telling of the first model first, to be drawn on one scale.

    `residual_N` (m, N) measured less modelled; `radius_mm` (N,) of the punch; `reach_N` half the height that holds
    98 % of every model's residuals.
    """

    models: tuple[str, ...]
    strips: tuple[Strip, ...]
    residual_N: Floats
    radius_mm: Floats
    reach_N: float


@dataclass(frozen=True, slots=True)
class ErrorFall:
    """The error of each model, on presses left out of the fit (`held_out`) or, where there are too few, fitted.

    `error` and `repeatability` in `unit`, N or mm; `band` the 95 % interval of the repeatability, which is itself
    estimated from few presses; None where it is not known. `faces`: the error of faces, where `error` is of depths
    that the gel beside them tells.
    """

    models: tuple[str, ...]
    error: tuple[float, ...]
    repeatability: float
    band: Pair | None
    held_out: bool
    unit: str = "N"
    faces: tuple[float, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the last model is as near to the presses as they repeat."""
        return self.band is not None and self.error[-1] <= self.band[1]
