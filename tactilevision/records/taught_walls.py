"""What certified faces taught of walls: how much of a face's depth they hide, beside what their law finds.

    change = hidden (share + growth (w/w0 - 1))     w0 = USUAL_MM

hidden: what the law of steep walls finds missing in the slopes as read; w: depth of the face. Zero without a wall.
The depth is held within that of the faces that taught.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records.numbers import Pair

USUAL_MM = 0.45  # mm: depth of a face at which `share` holds; benchmarks.rendered


@dataclass(frozen=True, slots=True)
class TaughtWalls:
    """`share` and `growth` without unit, their covariance (two variances, then the covariance), the depths taught.

    `scatter` is what faces elsewhere of the same sensor differ by, a part of their depth.
    """

    share: float
    growth: float
    covariance: tuple[float, float, float]
    limits_mm: Pair
    scatter: float

    def change_mm(self, hidden_mm: float, depth_mm: float) -> Pair:
        """What a wall hides beyond `hidden_mm` round a face of `depth_mm`, and the deviation of its step; mm.

        No wall hides less than nothing.
        """
        excess = self.excess(depth_mm)
        of_share, of_growth, between = self.covariance
        variance = of_share + 2.0 * excess * between + excess * excess * of_growth
        change = hidden_mm * max(self.share + self.growth * excess, -1.0)
        return change, float(np.hypot(hidden_mm * np.sqrt(max(variance, 0.0)), self.scatter * depth_mm))

    def excess(self, depth_mm: float) -> float:
        """The face's depth over the usual, less 1, held within the depths that taught."""
        return float(np.clip(depth_mm, *self.limits_mm)) / USUAL_MM - 1.0


@dataclass(frozen=True, slots=True)
class WallLessons:
    """Of pictures whose cast shadows are `left`, and of those where they are `undone`; None: nothing taught."""

    left: TaughtWalls | None = None
    undone: TaughtWalls | None = None
