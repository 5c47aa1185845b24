"""Effects as they appear in the reconstructed depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.model.stages import EffectBase, Parameter, Stage, State
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from calibration.inputs.observations import Observations


class Pictured(EffectBase):
    """An effect that also changes the reconstructed depth."""

    def missing(self, data: Observations) -> str:
        """Return why forces over these depths cannot show the effect; empty where they can."""
        return "" if data.depth_source == "vision" else "the depth does not come from the picture"

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        raise NotImplementedError(f"{type(self).__name__} does not change the reconstructed depth")

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the true depth of one that is read in proportion, or the force of a whole map."""
        share = self.seen(np.ones(data.size), values, data)
        if data.resultants is not None:  # the inverse step is linear in the map
            return state.times(factor=1 / share)
        return replace(state, depth_mm=state.depth_mm / share)

    def unseen(self, data: Observations) -> str:
        """Return why the picture of certified depths cannot show the effect; empty where it can."""
        return ""

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Return the effect as it shows in the reconstructed depth."""
        return InPicture(self)


@dataclass(frozen=True)
class InPicture(EffectBase):
    """The effect `inner` in the reconstructed depth; `of_certificate`: it is the certified depth that is off.

    Key, order, check, treatment and parameters are those of the inner effect.
    """

    inner: Pictured
    of_certificate: ClassVar[bool] = False
    stage: ClassVar[Stage] = Stage.DEPTH

    def __post_init__(self) -> None:
        for name in ("key", "order", "check", "treatment"):
            object.__setattr__(self, name, getattr(self.inner, name))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fitted parameters."""
        return self.inner.parameters

    def missing(self, data: Observations) -> str:
        """Return why these depths cannot show the effect; empty where they can."""
        return self.inner.unseen(data)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the reconstructed depth."""
        return replace(state, depth_mm=self.inner.seen(state.depth_mm, values, data))

    def starts(self, data: Observations) -> Floats:
        """Return values (S, q) to begin a fit from."""
        return self.inner.starts(data)


class OfPicture(Pictured):
    """An effect of the picture alone: only slopes of the gel outside the contact show it, no force or depth."""

    def missing(self, data: Observations) -> str:
        """Return why forces cannot show it."""
        return "needs frames: it shows in the gel outside the contact, compared with certified depths"

    def unseen(self, data: Observations) -> str:
        """Return why these depths cannot show the effect; empty where they can."""
        if data.slopes is None:
            return "needs frames of six presses of a flat cylinder, with the gel next to its face in view"
        return ""

    def absent(self, data: Observations) -> bool:
        """Return True: certified depths do not change, and others cannot show it."""
        return True

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state unchanged."""
        return state
