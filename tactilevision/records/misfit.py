"""Numbers behind the figures of a fit: curves, residuals, and error by model.

Models are ordered: the base model first, then each with one more effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactilevision.records.measured import Floats, Pair


@dataclass(frozen=True, slots=True)
class PressCurve:
    """The n samples of one press, and the force of m models at each.

    `time_s` (n,) since its first sample; `depth_mm`, `measured_N` (n,); `modelled_N` (m, n); `phase` (n,) of
    load, hold, unload and free.
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
    """The presses in order of time, under the models named; `whole` if they are curves in time, not points."""

    models: tuple[str, ...]
    presses: tuple[PressCurve, ...]
    whole: bool

    @property
    def radii_mm(self) -> tuple[float, ...]:
        """The distinct radii, ascending."""
        return tuple(sorted({one.radius_mm for one in self.presses}))

    def most_changed(self, most: int) -> tuple[PressCurve, ...]:
        """Return the presses whose rms changes most from the first model to the last, in the order of pressing.

        Of one model those with the largest.
        """
        last = -1 if len(self.models) > 1 else slice(0, 0)
        by_change = sorted(self.presses, key=lambda one: -abs(float(one.rms_N[0] - np.sum(one.rms_N[last]))))
        kept = {one.label for one in by_change[:most]}
        return tuple(one for one in self.presses if one.label in kept)


@dataclass(frozen=True, slots=True)
class Strip:
    """The residuals of m models against one recorded quantity, N samples, k bins.

    `words` name it; `values` (N,) in `unit`; `levels` the words for 0, 1, 2 ... of a categorical quantity;
    `centre` (k,) of the bins, `mean_N` and `reach95_N` (m, k) the mean residual there and its 95 % interval's half
    width; `p_adjusted` (m,) of no dependence on it, adjusted for all tests; `p_trend` (m,) the same of a trend
    over the presses alone, NaN if not tested.
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


@dataclass(frozen=True, slots=True)
class ResidualStrips:
    """Strips of one set of samples, the most significant of the first model first, plotted on one scale.

    `residual_N` (m, N) measured less modelled; `radius_mm` (N,) of the punch; `reach_N` the bound on 98 % of every
    model's residuals; `press` (N,) the label of each sample's press.
    """

    models: tuple[str, ...]
    strips: tuple[Strip, ...]
    residual_N: Floats
    radius_mm: Floats
    reach_N: float
    press: tuple[str, ...] = ()

    def outside(self, model: int) -> dict[str, int]:
        """Return the presses with samples beyond `reach_N`, farthest first, and the farthest sample of each."""
        size, found = np.abs(self.residual_N[model]), dict[str, int]()
        for k in np.argsort(-size, kind="stable"):
            if not size[k] > self.reach_N or k >= len(self.press):
                break
            found.setdefault(self.press[k], int(k))
        return found


def share_removed(before: float, after: float, repeatability: float) -> float:
    """Return the share of the error that can be removed, in mean squares above the repeatability.

        s = (e_0^2 - e_1^2) / (e_0^2 - r^2)

    At most 1; negative where the error grows; NaN where nothing repeats (r is NaN) or where nothing above the
    repeatability can be removed.
    """
    avoidable = before**2 - repeatability**2
    return min((before**2 - after**2) / avoidable, 1.0) if avoidable > 0 else math.nan


@dataclass(frozen=True, slots=True)
class ErrorFall:
    """The error of each model, on presses held out of the fit (`held_out`) or, if there are too few, fitted ones.

    `error` and `repeatability` in `unit`, N or mm; the latter is the scatter of true repeats, `band` its 95 %
    interval; NaN and None where nothing repeats. `faces`: the error of faces, where `error` is that of the gel
    outside the contact.
    """

    models: tuple[str, ...]
    error: tuple[float, ...]
    repeatability: float
    band: Pair | None
    held_out: bool
    unit: str = "N"
    faces: tuple[float, ...] = ()

    @property
    def removed(self) -> float:
        """Share of the removable error of the first model that the last one removes; see `share_removed`."""
        return share_removed(self.error[0], self.error[-1], self.repeatability)

    @property
    def reached(self) -> bool:
        """Whether the last model's error is within the repeatability."""
        return self.band is not None and self.error[-1] <= self.band[1]
