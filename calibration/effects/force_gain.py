"""Gain of the force sensor: every reading is too large by a factor.

    P -> (1 + g) P

g is dimensionless. Range: |g| up to .2; vanishes at g = 0. It is exactly a factor on E, so no press can show it;
a dead weight does. Next to forces computed with a known E it shows, with a prior of 1 % (a judgement: sensors as
they are sold). Source: definition.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ForceGain(EffectBase):
    """One factor on every reading."""

    key = "force_gain"
    title = "the force sensor reads too large by a factor"
    stage = Stage.INSTRUMENT
    seen_in = ("P",)
    confused_with = ("youngs_modulus",)
    separated_by = ("a dead weight",)
    source = "definition"
    order = 40
    largest = 0.02
    std_at_known_E = 0.01
    check = ManualCheck("put a dead weight on the force sensor", 5, 0.003)
    parameters = (amplitude("gain", "1", 0.2, "relative error of the force", 0.02),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where E is known."""
        alone = "a factor on the force is E exactly; a dead weight would show it"
        return alone if data.resultants is None else ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force scaled."""
        return state.times(force_N=1 + values[0])
