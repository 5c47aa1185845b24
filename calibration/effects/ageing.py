"""The gel's modulus drifts with age, fast at first.

    E(t) = E0 [1 + alpha ln(1 + t/t0)],    t in days since the first press

Vanishes at alpha = 0. Source: Struik, Physical Aging in Amorphous Polymers (1978), ch. 4 (logarithmic ageing).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class Ageing(EffectBase):
    """A rate and a time."""

    key = "ageing"
    title = "the gel hardens with age"
    stage = Stage.MATERIAL
    seen_in = ("recording date", "order")
    confused_with = ("force_gain", "temperature")
    separated_by = ("a dead weight each time", "later recordings")
    source = "Struik (1978), ch. 4"
    order = 200
    check = ManualCheck("repeat the presses in a month", 10.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """alpha and t0."""
        return (
            Parameter("rate", "1", 0.0, (-0.3, 0.3), "relative change for each e-fold of age", 0.03),
            Parameter("onset_days", "d", 1.0, (0.01, 100.0), "age from which it counts", 1.0),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        day = data.presses.day
        if not np.isfinite(day).all() or np.ptp(day) < 0.2:
            return "needs recordings of several days"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        span = float(np.ptp(data.presses.day))
        return np.array(
            [[s * 0.03, float(np.clip(q * span, 0.01, 100))] for q in (0.02, 0.3, 3.0) for s in (1, -1)]
        )

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale by age."""
        age = np.log1p(np.maximum(data.presses.day - np.min(data.presses.day), 0) / values[1])
        factor = (1 + values[0] * age)[data.press]
        return replace(state, force_N=state.force_N * factor, stiffness_N_per_mm=state.stiffness_N_per_mm * factor)
