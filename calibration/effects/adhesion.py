"""The gel clings to the face while it is drawn off: the line of unloading goes on into tension down to pull-off.

    P = K0 w for w < 0 in unloading, down to P_off = -sqrt(8 pi a^3 E* W),    E* = K0/(2 a)

W work of adhesion in N/mm (1 J/m^2 = .001 N/mm). A flat punch's contact does not shrink before it lets
go, so loading shows nothing. Letting go is spread over a tenth of P_off, so that a fit sees a slope. Vanishes
at W = 0. Source: Kendall, J. Phys. D 4 (1971) 1186; Johnson, Kendall, Roberts, Proc. R. Soc. A 324 (1971) 301.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Adhesion(EffectBase):
    """One work of adhesion."""

    key = "adhesion"
    title = "the gel clings to the punch"
    stage = Stage.HISTORY
    seen_in = ("load/unload",)
    confused_with = ("force_bias", "depth_zero")
    separated_by = ("unloading to pull-off",)
    source = "Kendall, J. Phys. D 4 (1971) 1186"
    threshold = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """W."""
        return (Parameter("work_N_per_mm", "N/mm", 0.0, (0.0, 0.005), "work of adhesion", 0.0003),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not (drawn_off(data) & (data.depth_mm < 0)).any():
            return "needs unloading beyond the first touch, down to pull-off"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[1e-5], [5e-5], [2e-4], [1e-3]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Tension before pull-off."""
        pulled = drawn_off(data) & (state.depth_mm < 0)
        tension = state.stiffness_N_per_mm * np.minimum(state.depth_mm, 0)
        modulus = state.stiffness_N_per_mm / (2 * state.radius_mm)
        limit = np.sqrt(8 * np.pi * state.radius_mm**3 * modulus * values[0])
        over = (-tension - limit) / np.maximum(0.1 * limit, 1e-12)
        clings = pulled / (1 + np.exp(np.clip(over, -50, 50)))
        return replace(state, force_N=state.force_N + np.where(limit > 0, clings * tension, 0.0))


def drawn_off(data: Observations) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Samples (N,) after the deepest of their press."""
    after = np.zeros(data.size, dtype=bool)
    for start, end in zip(data.first, [*data.first[1:], data.size], strict=True):
        after[start + int(np.argmax(data.depth_mm[start:end])) + 1 : end] = True
    return after
