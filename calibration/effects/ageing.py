"""Ageing: the gel's modulus drifts with the logarithm of its age, fast at first.

    E(t) = E0 [1 + alpha ln(1 + t/t0)]

t is the time in days since the first press, alpha the relative change per e-fold of age, t0 the age from which it
counts. Range: |alpha| up to .3, t0 .01 to 100 days; vanishes at alpha = 0. Confused with a changed force gain or
temperature; later recordings with a dead weight on the force sensor distinguish them.
Source: Struik, Physical Aging in Amorphous Polymers (1978), ch. 4 (logarithmic ageing).
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.conditions import SESSION_D
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats


class Ageing(EffectBase):
    """Logarithmic drift with a rate and an onset."""

    key = "ageing"
    title = "the gel hardens with age"
    stage = Stage.MATERIAL
    seen_in = ("recording date", "order")
    confused_with = ("force_gain", "temperature")
    separated_by = ("a dead weight each time", "later recordings")
    source = "Struik (1978), ch. 4"
    order = 200
    check = ManualCheck("repeat the presses in a month", 10)
    parameters = (
        amplitude("rate", "1", 0.3, "relative change for each e-fold of age", 0.03),
        Parameter("onset_days", "d", 1.0, (0.01, 100), "age from which it counts", 1.0),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show ageing; empty where they can."""
        day = data.presses.day
        return "" if np.isfinite(day).all() and np.ptp(day) >= SESSION_D else "needs recordings of several days"

    def starts(self, data: Observations) -> Floats:
        """Return starts of either sign with onsets spread over the recorded days."""
        rate, onset = self.parameters
        onsets = np.clip(np.ptp(data.presses.day) * np.array([0.02, 0.3, 3.0]), *onset.bounds)
        return np.array([[sign * rate.scale, one] for one in onsets for sign in (1, -1)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with force and stiffness scaled by age."""
        age = np.log1p(np.maximum(data.presses.day - np.min(data.presses.day), 0) / values[1])
        factor = (1 + values[0] * age)[data.press]
        return state.times(force_N=factor, stiffness_N_per_mm=factor)
