"""Generic errors of an instrument that no effect of the catalogue has: one function of one covariate each.

    force   b (1 - exp(-s/tau)), s since the touch                zero that creeps
            b s/S or b (1 - exp(-s/tau)), s the rig's working time     zero that drifts b P s/S
            gain that drifts, or a gel that softens or hardens b in unloading
            reading that lags behind the load s q(P; tau), q the relaxed part of a Prony term       sensor that
            creeps under load
    depth   d in unloading                                        lost motion
            d cos(2 pi w/L + u)                                   periodic error of a screw or a scale

A search compares them with the effects that it names and never names them itself: another measurement must show
which a rig has. Source: definitions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibration.effects.viscoelasticity import TAU_S, TAUS, relaxed
from calibration.inputs.conditions import missing_course, missing_times, running_share
from calibration.inputs.denoised_depth import UNLOAD, branches
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Bools, Floats

FINEST_MM = 0.05  # shortest period of a wave in depth, mm
PERIODS = 24  # periods at which the fits begin, a factor 1.1 to 1.2 apart
PHASES = 4  # starts of each period, a quarter of a turn apart
MIN_PLACES = 12  # distinct depths: four for each number of the wave
FORCE = amplitude("size_N", "N", 1.0, "size", 0.02)
SIGNS = (1, -1)  # of an amplitude at the start


class InstrumentError(EffectBase):
    """Base of the errors: `words` describe it, `covariate` is what it is a function of."""

    words: ClassVar[str]
    covariate: ClassVar[str]


class _InPress(InstrumentError):
    """A force error over time within a press: size and time constant; `begin` is the size of the starts."""

    stage = Stage.INSTRUMENT
    covariate = "t"
    size: ClassVar[Parameter] = FORCE
    begin: ClassVar[float] = 0.01

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The size and tau."""
        return (self.size, Parameter("tau_s", "s", 3, TAU_S, "time constant", 3))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_course(data)

    def starts(self, data: Observations) -> Floats:
        """Return starts of either sign over the time constants."""
        return np.array([[sign * self.begin, tau] for tau in TAUS for sign in SIGNS])


class SinceTouch(_InPress):
    """Zero of the force that drifts from the moment of touch, whatever the load, and resets between presses."""

    key = "force_since_touch"
    words = "a force error that grows from the moment of touch"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the error."""
        grown = -np.expm1(-since_touch(data) / values[1])
        return state.plus(force_N=values[0] * grown)


class UnderLoad(_InPress):
    """Creep of the force sensor in proportion to its load, of either sign."""

    key = "force_under_load"
    words = "a force sensor that creeps in proportion to its load"
    size, begin = amplitude("share", "1", 0.6, "share of the load", 0.05), 0.02

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with a part that follows the load late."""
        return state.plus(force_N=values[0] * relaxed(state.force_N, values[1], data=data))


class _InUnloading(InstrumentError):
    """A constant error in unloading."""

    covariate = "load/unload"

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if _unloading(data).any() else "needs unloading"


class ForceWayBack(_InUnloading):
    """Zero of the force sensor that changes once it was loaded, until the punch is off."""

    key = "force_way_back"
    stage = Stage.INSTRUMENT
    words = "a force error on the way back"
    parameters = (FORCE,)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the error."""
        return state.plus(force_N=values[0] * _unloading(data))


class DepthWayBack(_InUnloading):
    """Lost motion: the depth reads differently in unloading."""

    key = "depth_way_back"
    stage = Stage.DEPTH
    words = "a depth error on the way back"
    parameters = (amplitude("size_mm", "mm", 0.2, "size", 0.01),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the error."""
        return state.plus(depth_mm=values[0] * _unloading(data))


class AlongDepth(InstrumentError):
    """Periodic error of the depth's scale."""

    key = "depth_along_depth"
    stage = Stage.DEPTH
    words, covariate = "a depth error that comes and goes along the depth", "w"
    parameters = (
        Parameter("size_mm", "mm", 0.0, (0, 0.1), "amplitude", 0.005),
        Parameter("length_mm", "mm", 0.3, (FINEST_MM, 2), "period", 0.1),
        amplitude("phase", "rad", 7, "phase", 1),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        places = np.unique(np.round(4 * data.depth_mm / FINEST_MM)).size
        return "" if places >= MIN_PLACES else f"needs {MIN_PLACES} depths or more"

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters, with periods up to 1.5 times the largest depth."""
        size, length, phase = self.parameters
        most = _longest(data)
        return (size, replace(length, default=most / 2, bounds=(FINEST_MM, most)), phase)

    def starts(self, data: Observations) -> Floats:
        """Return starts at all phases and periods."""
        lengths = np.geomspace(FINEST_MM, 0.95 * _longest(data), PERIODS)
        phases = np.pi * np.linspace(-1, 1, PHASES, endpoint=False)
        return np.array([[0.003, length, phase] for length in lengths for phase in phases])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the wave added to the depth."""
        along = values[0] * np.cos(2 * np.pi * data.depth_mm / values[1] + values[2])
        return state.plus(depth_mm=along)


class OverTime(InstrumentError):
    """Zero of the force sensor that drifts linearly with the rig's working time."""

    key = "force_drift"
    stage = Stage.INSTRUMENT
    words, covariate = "a force error that grows evenly with the rig's working time", "order"
    parameters: ClassVar[tuple[Parameter, ...]] = (FORCE,)
    start_values: ClassVar[tuple[tuple[float, ...], ...]] = tuple((sign * 0.01,) for sign in SIGNS)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return missing_times(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the drift."""
        return state.plus(force_N=values[0] * running_share(data))


class Settling(OverTime):
    """The same drift with a time constant, as of a sensor that warms up."""

    key = "force_over_time"
    words = "a force error that grows with the rig's working time and settles"
    parameters = (FORCE, Parameter("settles", "1", 1.0, (0.1, 20), "settles after a share of the time of", 1.0))
    start_values = tuple((sign * 0.01, share) for share in (0.15, 0.5) for sign in SIGNS)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the drift."""
        grown = np.expm1(-running_share(data) / values[1]) / np.expm1(-1 / values[1])
        return state.plus(force_N=values[0] * grown)


class GainOverTime(OverTime):
    """Force that drifts in proportion to itself: the sensor's gain, or a gel that warms or wears."""

    key = "force_gain_drift"
    words = "a force that drifts in proportion, evenly with the rig's working time"
    parameters = (amplitude("gain", "1", 0.5, "change of the force from first to last", 0.03),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force scaled."""
        return state.times(force_N=1 + values[0] * running_share(data))


INSTRUMENT_ERRORS: Sequence[InstrumentError] = (
    SinceTouch(),
    UnderLoad(),
    ForceWayBack(),
    DepthWayBack(),
    AlongDepth(),
    OverTime(),
    Settling(),
    GainOverTime(),
)


def _unloading(data: Observations) -> Bools:
    """Return which samples (N,) are in unloading, by branch: the deepest reading of a hold is noise."""
    return np.asarray(branches(data) == UNLOAD)


def _longest(data: Observations) -> float:
    return max(1.5 * float(np.max(data.depth_mm)), 2 * FINEST_MM)


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
