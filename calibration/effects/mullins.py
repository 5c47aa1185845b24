"""Stress softening: below the largest depth that a spot has seen, the gel is softer.

    P -> P [1 - A erf((w_max^2 - w^2)/(m^2 + g w_max^2))],    w_max the largest depth so far at that spot, now too

Ogden and Roxburgh's damage function with the squared depth for the energy; m is the depth over which the
softening sets in below the maximum, and g how much that width grows with it (Mars). Permanent: no wait heals it.
Vanishes at A = 0.
Sources: Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861, eq. 41; Mars, Tire Sci. Technol. 32 (2004) 120.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.inputs.denoised_depth import nominal_depth
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats

KEPT = 8  # data sets of which a history is kept: a fit asks at every step
SPOT_MM = 0.5  # presses nearer than this share what the gel went through


@dataclass(frozen=True, slots=True)
class Mullins(EffectBase):
    """An amplitude, a width and how that grows."""

    key = "mullins"
    title = "the gel is softer where it was pressed before"
    stage = Stage.HISTORY
    seen_in = ("w", "load/unload", "order")
    confused_with = ("recovery",)
    separated_by = ("a virgin spot", "varied waits")
    source = "Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861; Mars, Tire Sci. Technol. 32 (2004) 120"
    order = 180
    largest = 0.15

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A, m and g."""
        return (
            Parameter("softening", "1", 0.0, (0.0, 1.0), "how much softer far below the largest depth", 0.05),
            Parameter("width_mm", "mm", 0.3, (0.1, 1.0), "depth over which the softening sets in", 0.1),
            Parameter("grows", "1", 0.0, (0.0, 3.0), "how much of that grows with the largest depth", 0.5),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.count < 2 and not data.is_curves:
            return "needs presses of a spot that was pressed before"
        if (data.depth_mm >= largest_past_depth(data) - 1e-9).all():
            return "no spot was pressed deeper before"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.03, 0.15, 0.0], [0.03, 0.3, 0.0], [0.03, 0.6, 0.0], [0.03, 0.1, 1.0]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Soften below the past maximum."""
        from scipy.special import erf

        below, deepest = _below(data)
        width = values[1] ** 2 + values[2] * deepest
        return replace(state, force_N=state.force_N * (1 - values[0] * erf(below / width)))


@lru_cache(maxsize=KEPT)
def _below(data: Observations) -> tuple[Floats, Floats]:
    """How far each sample (N,) lies below the largest past depth of its spot, as a difference of squares, and that
    depth squared; both in mm^2.
    """
    level = data.shifted(nominal_depth(data) - data.depth_mm)  # the largest reading is the luckiest
    deepest = largest_past_depth(level) ** 2
    return np.asarray(deepest - np.maximum(level.depth_mm, 0) ** 2), np.asarray(deepest)


def spots(data: Observations) -> list[tuple[float, float]]:
    """The place of each press on a grid of SPOT_MM; unknown places count as one spot."""
    place = np.round(np.nan_to_num(np.column_stack([data.presses.x_mm, data.presses.y_mm])) / SPOT_MM)
    return [(float(x), float(y)) for x, y in place]


def largest_past_depth(data: Observations) -> Floats:
    """The largest depth (N,) that each sample's spot has seen up to it."""
    seen: dict[tuple[float, float], float] = {}
    largest = np.empty(data.size)
    for key, start, end in zip(spots(data), data.first, [*data.first[1:], data.size], strict=True):
        run = np.maximum.accumulate(np.maximum(data.depth_mm[start:end], seen.get(key, 1e-6)))
        largest[start:end], seen[key] = run, float(run[-1])
    return largest
