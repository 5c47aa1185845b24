"""Low-pass filter of the force sensor.

    tau dP_r/dt = P - P_r,    P_r the reading, which begins each press at rest

On a ramp it looks like a clock offset of tau; at corners it rounds. Between the frames of a camera that does not
show: forces by pictures are compared with an offset alone. Range: tau up to 2 s; vanishes at tau = 0. Source:
definition.
"""

from __future__ import annotations

from dataclasses import replace

from calibration.effects.viscoelasticity import relaxed
from calibration.inputs.conditions import missing_course
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


class ForceFilter(EffectBase):
    """One time constant."""

    key = "force_filter"
    title = "the force sensor's low-pass filter lags behind the force"
    stage = Stage.INSTRUMENT
    seen_in = ("log rate", "load/unload", "t")
    confused_with = ("clock_offset", "viscoelasticity")
    separated_by = ("the end of a ramp, sampled finely", "the filter's setting")
    source = "definition"
    order = 64
    acts_on = "punch"
    largest = 0.5
    check = ManualCheck("read the filter's setting on the force sensor, or tap it and look at the decay", 3, 0.005)
    parameters = (Parameter("tau_s", "s", 0.0, (0, 2.0), "time constant of the filter", 0.02),)
    start_values = ((0.01,), (0.1,))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_course(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force filtered."""
        if values[0] <= 0:
            return state
        begin = state.force_N[data.first][data.press]
        return replace(state, force_N=begin + relaxed(state.force_N - begin, values[0], data=data))
