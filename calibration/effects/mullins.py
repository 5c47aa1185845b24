"""Stress softening: below the largest depth that a spot has seen, the gel is softer.

    P -> P [1 - A (1 - (w/w_max)^2)],    w_max the largest depth so far at that spot, now included

A linear measure of the energy below its maximum, the first term of Ogden and Roxburgh's damage function.
Permanent: no wait heals it. Vanishes at A = 0. Source: Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861, eq. 41.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Mullins(EffectBase):
    """One amplitude."""

    key = "mullins"
    title = "the gel is softer where it was pressed before"
    stage = Stage.HISTORY
    seen_in = ("w/w_max", "order")
    confused_with = ("recovery",)
    separated_by = ("a virgin spot", "varied waits")
    source = "Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A."""
        return (Parameter("softening", "1", 0.0, (0.0, 0.5), "how much softer at small depth", 0.05),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.count < 2 and not data.is_curves:
            return "needs presses of a spot that was pressed before"
        if (data.depth_mm >= largest_past_depth(data) - 1e-9).all():
            return "no spot was pressed deeper before"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Soften below the past maximum."""
        most = largest_past_depth(data)
        part = np.clip(data.depth_mm / most, 0, 1) ** 2
        return replace(state, force_N=state.force_N * (1 - values[0] * (1 - part)))


def largest_past_depth(data: Observations, same_spot_mm: float = 0.5) -> Floats:
    """The largest depth (N,) that each sample's spot has seen up to it; unknown places count as one spot."""
    place = np.nan_to_num(np.column_stack([data.presses.x_mm, data.presses.y_mm]))
    spot = np.round(place / same_spot_mm)
    seen: dict[tuple[float, float], float] = {}
    largest = np.empty(data.size)
    for k, (start, end) in enumerate(zip(data.first, [*data.first[1:], data.size], strict=True)):
        key = (float(spot[k, 0]), float(spot[k, 1]))
        run = np.maximum.accumulate(np.maximum(data.depth_mm[start:end], seen.get(key, 1e-6)))
        largest[start:end], seen[key] = run, float(run[-1])
    return largest
