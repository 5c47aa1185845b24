"""Effects as they appear in the reconstructed depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from calibration.model.stages import Effect, EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from calibration.inputs.observations import Observations


class Seen(Effect, Protocol):
    """An effect that also changes the reconstructed depth."""

    @property
    def order(self) -> float:
        """Place among the effects of a stage."""

    @property
    def check(self) -> ManualCheck | None:
        """Direct check by a person."""

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""


@dataclass(frozen=True, slots=True)
class InPicture:
    """The effect `inner` in the reconstructed depth; `of_certificate`: it is the certified depth that is off.

    Key, order, check, treatment and parameters are those of the inner effect.
    """

    inner: Seen
    of_certificate: ClassVar[bool] = False
    stage: ClassVar[Stage] = Stage.DEPTH

    @property
    def key(self) -> str:
        """Name in the catalogue."""
        return self.inner.key

    @property
    def order(self) -> float:
        """Place among the effects of a stage."""
        return self.inner.order

    @property
    def check(self) -> ManualCheck | None:
        """Direct check by a person."""
        return self.inner.check

    @property
    def treatment(self) -> str:
        """How frames are read again once the effect is added."""
        return str(getattr(self.inner, "treatment", ""))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fitted parameters."""
        return self.inner.parameters

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters with what is known of them on these data."""
        return self.parameters

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the reconstructed depth."""
        return replace(state, depth_mm=self.seen(state.depth_mm, values, data))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        return self.inner.seen(depth_mm, values, data)

    def missing(self, data: Observations) -> str:
        """Return why these depths cannot show the effect; empty where they can."""
        return ""

    def starts(self, data: Observations) -> Floats:
        """Return values (S, q) to begin a fit from."""
        return self.inner.starts(data)


class OfPicture(EffectBase):
    """An effect of the picture alone: it changes neither a force nor a certified depth."""

    def missing(self, data: Observations) -> str:
        """Return why forces cannot show it."""
        return "needs frames: it shows in the gel outside the contact, compared with certified depths"

    def absent(self, data: Observations) -> bool:
        """Return True: certified depths do not change, and others cannot show it."""
        return True

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state unchanged."""
        return state


@dataclass(frozen=True, slots=True)
class BesideFaces(InPicture):
    """An effect that shows only in the slopes of the gel outside the contact."""

    needs_times: bool = False

    def missing(self, data: Observations) -> str:
        """Return why these depths cannot show the effect; empty where they can."""
        if data.slopes is None:
            return "needs frames of six presses of a flat cylinder, with the gel next to its face in view"
        if self.needs_times and not (np.isfinite(data.time_s).all() and np.ptp(data.time_s) > 0):
            return "needs times of several presses"
        return ""
