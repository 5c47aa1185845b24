"""Mullins effect (stress softening): below the largest depth that a place has seen, the gel is softer.

    P -> P [1 - A erf((w_max^2 - w^2)/(m^2 + g w_max^2))]

w_max is the largest depth so far at that place, the present one included. It is the damage function of Ogden and
Roxburgh with the squared depth in place of the energy: m in mm is the depth over which the softening sets in below
the maximum, g how much that width grows with it (Mars). The softening is permanent. Range: A up to 1, m .1 to 1
mm, g up to 3; vanishes at A = 0. Confused with incomplete recovery; a fresh place or varied waits distinguish it.
Sources: Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861, eq. 41; Mars, Tire Sci. Technol. 32 (2004) 120.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calibration.inputs.denoised_depth import nominal_depth
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.measured import Floats

KEPT = 8  # data sets whose history is cached: a fit asks at every step
SPOT_MM = 0.5  # presses nearer than this share their history


class Mullins(EffectBase):
    """An amplitude, a width and its growth."""

    key = "mullins"
    title = "the gel is softer where it was pressed before"
    stage = Stage.HISTORY
    seen_in = ("w", "load/unload", "order")
    confused_with = ("recovery",)
    separated_by = ("a virgin spot", "varied waits")
    source = "Ogden, Roxburgh, Proc. R. Soc. A 455 (1999) 2861; Mars, Tire Sci. Technol. 32 (2004) 120"
    order = 180
    largest = 0.15
    parameters = (
        Parameter("softening", "1", 0.0, (0, 1), "how much softer far below the largest depth", 0.05),
        Parameter("width_mm", "mm", 0.3, (0.1, 1), "depth over which the softening sets in", 0.1),
        Parameter("grows", "1", 0.0, (0, 3), "how much of that grows with the largest depth", 0.5),
    )
    start_values = tuple((0.03, *shape) for shape in ((0.15, 0), (0.3, 0), (0.6, 0), (0.1, 1)))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show softening; empty where they can."""
        if data.count < 2 and not data.is_curves:
            return "needs presses of a spot that was pressed before"
        if (data.depth_mm >= largest_past_depth(data) - TINY).all():
            return "no spot was pressed deeper before"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state softened below the past maximum."""
        from scipy.special import erf

        below, deepest = _below(data)
        width = values[1] ** 2 + values[2] * deepest
        return state.times(force_N=1 - values[0] * erf(below / width))


@lru_cache(maxsize=KEPT)
def _below(data: Observations) -> tuple[Floats, Floats]:
    """Return w_max^2 - w^2 and w_max^2 (N,) each, mm^2, from depths without most of their readings' noise."""
    level = data.shifted(nominal_depth(data) - data.depth_mm)
    deepest = largest_past_depth(level) ** 2
    return np.asarray(deepest - np.maximum(level.depth_mm, 0) ** 2), np.asarray(deepest)


def spots(data: Observations) -> list[tuple[float, float]]:
    """Return the place of each press on a grid of SPOT_MM; unknown places count as one."""
    place = np.round(np.nan_to_num(np.column_stack([data.presses.x_mm, data.presses.y_mm])) / SPOT_MM)
    return [(float(x), float(y)) for x, y in place]


def largest_past_depth(data: Observations) -> Floats:
    """Return the largest depth (N,) that each sample's place has seen up to it, mm."""
    seen: dict[tuple[float, float], float] = {}
    largest = np.empty(data.size)
    for key, one in zip(spots(data), data.spans, strict=True):
        run = np.maximum.accumulate(np.maximum(data.depth_mm[one], seen.get(key, MICRO)))
        largest[one], seen[key] = run, float(run[-1])
    return largest
