"""How steep the gel looks to the light: what a recording may suffer after its reference pictures were taken.

    shown = S tanh(g s/S) s/|s|,    g = 1 + gain + drift t/T

s the slope (its size |s|), t the time and T the recording's end. A gel that clouds scatters light before it
reaches the ink, so that it comes from all around and brightness follows slopes less: g below 1. Ink that wears
smooth, or an exposure that clips, shows nothing steeper than S.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.synthetic.gel import Singles


@dataclass(frozen=True, slots=True)
class SlopeResponse:
    """`gain` and `drift` as shares of every slope; `steepest` S; `end_s` T on the camera's clock."""

    gain: float = 0.0
    drift: float = 0.0
    steepest: float = float("inf")
    end_s: float = 1.0

    def shown(self, slopes: tuple[Singles, Singles], time_s: float) -> tuple[Singles, Singles]:
        """The slopes dz/dx, dz/dy (H, W) that the light shows; the same arrays where all are shown as they are."""
        factor = 1 + self.gain + self.drift * time_s / self.end_s
        if factor == 1 and np.isinf(self.steepest):
            return slopes
        p, q = slopes
        share: Singles | np.float32 = np.float32(factor)
        if np.isfinite(self.steepest):
            x = np.maximum(np.hypot(p, q) * share / np.float32(self.steepest), np.float32(1e-6))
            share = np.asarray(share * np.tanh(x) / x, dtype=np.float32)
        return p * share, q * share


SOUND = SlopeResponse()
