"""Creep of the force sensor under load.

    P -> P + s q(P; tau)

q is the part of the force that a relaxation of time constant tau has reached (`viscoelasticity.relaxed`), s its
share. A reading that creeps down has the form of a gel that relaxes and is counted as that, hence s >= 0. Range: s
up to .3, tau .05 to 100 s; vanishes at s = 0. Source: OIML R 60 (2017), creep of load cells.
"""

from __future__ import annotations

from calibration.effects.viscoelasticity import TAU_S, TAUS, relaxed
from calibration.inputs.conditions import missing_course
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


class SensorCreep(EffectBase):
    """Share of the load and time constant."""

    key = "sensor_creep"
    title = "the force sensor creeps up under load"
    stage = Stage.INSTRUMENT
    seen_in = ("t", "log rate", "load/unload")
    confused_with = ("viscoelasticity", "zero_creep")
    separated_by = ("a dead weight on the sensor for a minute",)
    source = "OIML R 60 (2017)"
    order = 42
    largest = 0.1
    check = ManualCheck("leave a dead weight on the force sensor for a minute: does its reading creep?", 3, 0.005)
    parameters = (
        Parameter("share", "1", 0.0, (0, 0.3), "share of the load that it creeps by", 0.03),
        Parameter("tau_s", "s", 3, TAU_S, "time constant", 3),
    )
    start_values = tuple((0.02, tau) for tau in TAUS)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_course(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the part that follows the load late."""
        return state.plus(force_N=values[0] * relaxed(state.force_N, values[1], data=data))
