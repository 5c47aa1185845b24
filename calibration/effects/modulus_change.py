"""Change of the gel's modulus since its calibration: it aged, dried, swelled or warmed.

    P -> (1 + a) P

a is dimensionless. Range: |a| up to .5; vanishes at a = 0. It shows only where forces are computed with a modulus
that was calibrated before. Exactly confused with a gain of the force sensor, which a dead weight distinguishes,
and with a factor on the height map, which a gauge distinguishes. Source: definition.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ModulusChange(EffectBase):
    """One relative change."""

    key = "modulus_change"
    title = "E has changed since the calibration"
    acts_on = "resultant"
    stage = Stage.MATERIAL
    seen_in = ("w",)
    confused_with = ("force_gain", "photometric_gain")
    separated_by = ("a dead weight", "a gauge", "a new calibration")
    source = "definition"
    order = 205
    largest = 0.5
    check = ManualCheck("put a dead weight on the force sensor, then calibrate again", 25, 0.003)
    parameters = (amplitude("relative", "1", 0.5, "E over the calibrated one, less 1", 0.05),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if data.resultants is not None else "E is fitted to these data"

    def of_modulus(self, values: Floats) -> float:
        """Return E over the calibrated one."""
        return 1 + float(values[0])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with force and stiffness scaled."""
        return state.times(force_N=1 + values[0], stiffness_N_per_mm=1 + values[0])
