"""The gel's thickness is h (1 + d) instead of h.

Changes kappa(nu, a/h) and the strain w/h. On one radius it is E and beta; several radii show it.
Vanishes at d = 0. Source: the law's own h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Thickness(EffectBase):
    """One relative error of the thickness."""

    key = "thickness"
    title = "the gel is not as thick as stated"
    stage = Stage.GEOMETRY
    seen_in = ("a", "beta")
    confused_with = ("youngs_modulus", "edge_fillet", "stiffening")
    separated_by = ("several radii", "a gauge")
    source = "the law"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """d."""
        return (Parameter("relative", "1", 0.0, (-0.5, 0.8), "thickness over the stated one, less 1", 0.1),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the thickness."""
        return replace(state, thickness_mm=state.thickness_mm * (1 + values[0]))
