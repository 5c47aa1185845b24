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
    """An effect that says what a picture makes of it."""

    @property
    def order(self) -> float:
        """The catalogue's place."""

    @property
    def check(self) -> ManualCheck | None:
        """What a person can do about it."""

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths (N,), mm."""


@dataclass(frozen=True, slots=True)
class InPicture:
    """The effect `inner` in the picture. `of_certificate`: what it says is off is the certified depth."""

    inner: Seen
    of_certificate: ClassVar[bool] = False

    @property
    def key(self) -> str:
        """The catalogue's name."""
        return self.inner.key

    @property
    def order(self) -> float:
        """The catalogue's place."""
        return self.inner.order

    @property
    def check(self) -> ManualCheck | None:
        """The catalogue's, of the same amplitude."""
        return self.inner.check

    @property
    def treatment(self) -> str:
        """The catalogue's."""
        return str(getattr(self.inner, "treatment", ""))

    @property
    def stage(self) -> Stage:
        """True depth becomes seen depth."""
        return Stage.DEPTH

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The effect's."""
        return self.inner.parameters

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same, unless said otherwise."""
        return self.parameters

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """What the picture makes of the depth."""
        return replace(state, depth_mm=self.seen(state.depth_mm, values, data))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """The same for depths (N,) alone, mm."""
        return self.inner.seen(depth_mm, values, data)

    def missing(self, data: Observations) -> str:
        """Any certified depths show it, unless said otherwise."""
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return self.inner.starts(data)


class OfPicture(EffectBase):
    """An effect of the picture alone: no force and no certified depth knows of it."""

    def missing(self, data: Observations) -> str:
        """Forces never show it."""
        return "needs frames: it shows in the gel beside faces, against certified depths"

    def absent(self, data: Observations) -> bool:
        """Where depths are certified it moves none, and where they are not it cannot be told."""
        return True

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The force's depth stays."""
        return state


@dataclass(frozen=True, slots=True)
class BesideFaces(InPicture):
    """An effect that shows in the slopes beside faces alone."""

    needs_times: bool = False

    def missing(self, data: Observations) -> str:
        """What these depths would need."""
        if data.slopes is None:
            return "needs frames of six presses of a flat cylinder, and the gel beside its face in view"
        if self.needs_times and not (np.isfinite(data.time_s).all() and np.ptp(data.time_s) > 0):
            return "needs times of several presses"
        return ""
