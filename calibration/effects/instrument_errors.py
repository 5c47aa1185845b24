"""Plain errors of an instrument that no effect of the catalogue has: each one function of one covariate.

    force   b (1 - exp(-s/tau)), s since the touch                     a zero that creeps
            b s/S or b (1 - exp(-s/tau)), s the rig's working time     a zero that drifts
            b P s/S                                     a gain that drifts, or a gel that softens or hardens
            b while the punch is drawn off                             a sensor that lags behind the load
            s q(P; tau), q what a Prony term lets go of (hereditary.py)     a sensor that creeps under load
    depth   d while the punch is drawn off                             lost motion
            d cos(2 pi w/L + u)                                        a screw or a scale that is not even

They are held against what a search has named, and are never named themselves: a rig has them or not, and only
another measurement says which. Source: definitions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibration.effects.viscoelasticity import relaxed
from calibration.inputs.conditions import running_share
from calibration.inputs.denoised_depth import UNLOAD, branches
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Bools, Floats

TAU_S = (0.05, 100.0)  # s, from a few samples to a long hold: what a press can show
TAUS = (0.2, 1.0, 5.0, 25.0)  # s, where the fits begin, one to each factor of five
FINEST_MM = 0.05  # shortest period of a wave in depth, mm
LENGTHS = 24  # periods that the fits begin from, a factor 1.1 to 1.2 apart
PHASES = 4  # of each period, a quarter of a turn apart
MIN_PLACES = 12  # distinct depths: four for each number of the wave
FORCE = Parameter("size_N", "N", 0.0, (-1.0, 1.0), "size", 0.02)


class InstrumentError(EffectBase):
    """`words` what it is, `covariate` what it is a function of."""

    words: ClassVar[str]
    covariate: ClassVar[str]

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The state with the error."""
        raise NotImplementedError(f"{type(self).__name__} does nothing")


class _InPress(InstrumentError):
    """A force error of time within a press, with a time constant; `begin`: size to start from, either sign."""

    stage = Stage.INSTRUMENT
    covariate = "t"
    size: ClassVar[Parameter]
    begin: ClassVar[float]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The size and tau."""
        return (self.size, Parameter("tau_s", "s", 3.0, TAU_S, "time constant", 3.0))

    def missing(self, data: Observations) -> str:
        """Needs times."""
        return "" if data.is_curves and np.isfinite(data.time_s).all() else "needs times within a press"

    def starts(self, data: Observations) -> Floats:
        """Either sign, time constants over the decades."""
        return np.array([[side * self.begin, tau] for tau in TAUS for side in (1, -1)])


class SinceTouch(_InPress):
    """The force sensor's zero runs away from the moment of touch, whatever the load, and is back for the next."""

    key = "force_since_touch"
    words = "a force error that grows from the moment of touch"
    size, begin = FORCE, 0.01

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        grown = -np.expm1(-since_touch(data) / values[1])
        return replace(state, force_N=state.force_N + values[0] * grown)


class UnderLoad(_InPress):
    """The force sensor creeps under a load: up, as no gel does, or down, and then below nothing once it is off."""

    key = "force_under_load"
    words = "a force sensor that creeps in proportion to its load"
    size, begin = Parameter("share", "1", 0.0, (-0.6, 0.6), "share of the load", 0.05), 0.02

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add what follows the load late."""
        return replace(state, force_N=state.force_N + values[0] * relaxed(state.force_N, values[1], data=data))


class _WayBack(InstrumentError):
    """An error of one size while the punch is drawn off."""

    covariate = "load/unload"
    size: ClassVar[Parameter]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The size."""
        return (self.size,)

    def missing(self, data: Observations) -> str:
        """Needs a way back."""
        return "" if _way_back(data).any() else "needs unloading"


class ForceWayBack(_WayBack):
    """The force sensor reads another zero once it has been loaded, until the punch is off."""

    key = "force_way_back"
    stage = Stage.INSTRUMENT
    words = "a force error on the way back"
    size = FORCE

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        return replace(state, force_N=state.force_N + values[0] * _way_back(data))


class DepthWayBack(_WayBack):
    """Lost motion: the depth reads otherwise on the way back."""

    key = "depth_way_back"
    stage = Stage.DEPTH
    words = "a depth error on the way back"
    size = Parameter("size_mm", "mm", 0.0, (-0.2, 0.2), "size", 0.01)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        return replace(state, depth_mm=state.depth_mm + values[0] * _way_back(data))


class AlongDepth(InstrumentError):
    """The scale of the depth is not even."""

    key = "depth_along_depth"
    stage = Stage.DEPTH
    words, covariate = "a depth error that comes and goes along the depth", "w"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """d, L and u."""
        return (
            Parameter("size_mm", "mm", 0.0, (0.0, 0.1), "amplitude", 0.005),
            Parameter("length_mm", "mm", 0.3, (FINEST_MM, 2.0), "period", 0.1),
            Parameter("phase", "rad", 0.0, (-7.0, 7.0), "phase", 1.0),
        )

    def missing(self, data: Observations) -> str:
        """Needs more depths than a wave can be laid through."""
        places = np.unique(np.round(4 * data.depth_mm / FINEST_MM)).size
        return "" if places >= MIN_PLACES else f"needs {MIN_PLACES} depths or more"

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same, with periods no longer than the deepest press and a half."""
        size, length, phase = self.parameters
        most = _longest(data)
        return (size, replace(length, default=most / 2, bounds=(FINEST_MM, most)), phase)

    def starts(self, data: Observations) -> Floats:
        """Phases all around, periods from the finest to the deepest press."""
        lengths = np.geomspace(FINEST_MM, 0.95 * _longest(data), LENGTHS)
        phases = np.pi * np.linspace(-1, 1, PHASES, endpoint=False)
        return np.array([[0.003, length, phase] for length in lengths for phase in phases])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        along = values[0] * np.cos(2 * np.pi * data.depth_mm / values[1] + values[2])
        return replace(state, depth_mm=state.depth_mm + along)


class OverTime(InstrumentError):
    """The force sensor's zero drifts while the rig works, by as much in each hour."""

    key = "force_drift"
    stage = Stage.INSTRUMENT
    words, covariate = "a force error that grows evenly with the rig's working time", "order"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """b."""
        return (FORCE,)

    def missing(self, data: Observations) -> str:
        """Needs times of several presses."""
        return "" if np.isfinite(data.time_s).all() and data.count > 2 else "needs times of several presses"

    def starts(self, data: Observations) -> Floats:
        """Either sign."""
        return np.array([[0.01], [-0.01]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        return replace(state, force_N=state.force_N + values[0] * running_share(data))


class Settling(OverTime):
    """The same, slower and slower: a sensor that warms up."""

    key = "force_over_time"
    words = "a force error that grows with the rig's working time and settles"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """b and the share of the time after which it settles."""
        return (FORCE, Parameter("settles", "1", 1.0, (0.1, 20.0), "settles after a share of the time of", 1.0))

    def starts(self, data: Observations) -> Floats:
        """Either sign, soon and late."""
        return np.array([[side * 0.01, share] for share in (0.15, 0.5) for side in (1, -1)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add it."""
        grown = np.expm1(-running_share(data) / values[1]) / np.expm1(-1 / values[1])
        return replace(state, force_N=state.force_N + values[0] * grown)


class GainOverTime(OverTime):
    """The force drifts in proportion while the rig works: the sensor's gain, or a gel that warms or wears."""

    key = "force_gain_drift"
    words = "a force that drifts in proportion, evenly with the rig's working time"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """b."""
        return (Parameter("gain", "1", 0.0, (-0.5, 0.5), "change of the force from first to last", 0.03),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale by it."""
        return replace(state, force_N=state.force_N * (1 + values[0] * running_share(data)))


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


def _way_back(data: Observations) -> Bools:
    """Samples while the punch is drawn off: a plateau's deepest reading is noise's."""
    return np.asarray(branches(data) == UNLOAD)


def _longest(data: Observations) -> float:
    return max(1.5 * float(np.max(data.depth_mm)), 2 * FINEST_MM)


def since_touch(data: Observations) -> Floats:
    """Time since the depth passed 0 (N,), s, 0 before; a press that began in the gel came as it went on."""
    parts = []
    for start, end in zip(data.first, [*data.first[1:], data.size], strict=True):
        time, depth = data.time_s[start:end], data.depth_mm[start:end]
        before = max(int(np.argmax(depth > 0)) - 1, 0)
        (t0, *t1), (w0, *w1) = time[before : before + 2], depth[before : before + 2]
        touch = t0 - w0 * (t1[0] - t0) / (w1[0] - w0) if w1 and w1[0] > w0 else t0
        parts.append(np.maximum(time - touch, 0.0))
    return np.concatenate(parts)
