"""Creep of the force sensor's zero from the moment of touch, whatever the load.

    P -> P + b (1 - exp(-s/tau)),    s the time since the touch, 0 before

It starts anew with each press. Range: |b| up to 1 N, tau .05 to 100 s; vanishes at b = 0. Source: definition.
"""

from __future__ import annotations

import numpy as np

from calibration.effects.viscoelasticity import TAU_S, TAUS
from calibration.inputs.conditions import missing_course
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats


class ZeroCreep(EffectBase):
    """Size and time constant."""

    key = "zero_creep"
    title = "the force reading creeps from the moment of touch, whatever the load"
    stage = Stage.INSTRUMENT
    seen_in = ("t", "load/unload")
    confused_with = ("viscoelasticity", "sensor_creep", "adhesion")
    separated_by = ("a dead weight on the sensor for a minute", "presses of different depth")
    source = "definition"
    order = 32
    largest = 0.1
    check = ManualCheck("leave a dead weight on the force sensor for a minute: does its reading creep?", 3, 0.004)
    parameters = (
        amplitude("size_N", "N", 1.0, "size", 0.02),
        Parameter("tau_s", "s", 3, TAU_S, "time constant", 3),
    )
    start_values = tuple((sign * 0.01, tau) for tau in TAUS for sign in (1, -1))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_course(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the creep."""
        return state.plus(force_N=values[0] * -np.expm1(-since_touch(data) / values[1]))


def since_touch(data: Observations) -> Floats:
    """Return the time since the depth passed 0 (N,), s, 0 before; the first sample of a press begun in the gel."""
    parts = []
    for one in data.spans:
        time, depth = data.time_s[one], data.depth_mm[one]
        before = max(int(np.argmax(depth > 0)) - 1, 0)
        (t0, *t1), (w0, *w1) = time[before : before + 2], depth[before : before + 2]
        touch = t0 - w0 * (t1[0] - t0) / (w1[0] - w0) if w1 and w1[0] > w0 else t0
        parts.append(np.maximum(time - touch, 0.0))
    return np.concatenate(parts)
