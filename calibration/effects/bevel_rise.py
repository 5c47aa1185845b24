"""The gel beside the punch rises and meets the bevel early: a certified depth is H - rise, not H.

    w -> w [1 - q u(r_b)],    u the rise over w at the bevel's distance r_b by linear theory, q = 1 as computed

From points of one bevel distance it is E (and beta a little); indenters whose bevels stand at other distances, or
the stage, show it. Vanishes at q = 0. Source: tactilevision.mechanics.profile.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.effects.in_picture import InPicture
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Prior, Stage, State
from tactilevision.mechanics.profile import exact_profile
from tactilevision.records.measured import Floats

USUAL_DISTANCE = 2.0  # of the punch's radius, from its axis
TYPICAL_RISE = 0.1  # of the depth, beside a punch as wide as most: where the bevel stands is not known


@dataclass(frozen=True, slots=True)
class BevelRise(EffectBase):
    """One multiple of the computed rise."""

    key = "bevel_rise"
    title = "the bevel touches early"
    stage = Stage.DEPTH
    seen_in = ("certified against reconstructed depth",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("another bevel distance", "the height map", "the stage")
    source = "linear layer theory"
    order = 20
    typical = 1.0
    check = ManualCheck("use an indenter whose bevel stands at another distance", 15.0, 0.3)
    depth_source = "gauge"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """q."""
        return (Parameter("multiple", "1", 0.0, (-0.5, 3.0), "rise at the bevel over the computed one", 0.5),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if data.depth_source != "gauge":
            return "the depths are not certified by a bevel"
        if data.shared.rise > 0:
            return "the certificate took it off, and what that leaves open is in E's interval"
        known = [i for i in data.indenters if i.bevel_distance_mm is not None]
        if len(known) < len(data.indenters):
            return "needs the bevels' distances (bevel_distance_mm)"
        return "" if np.ptp(relative_rise(data)) > 0.005 else "needs bevels at several distances"

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of depths as certified: less by the rise, where nothing was taken off for it."""
        known = relative_rise(data)
        rise = np.where(known == 0, TYPICAL_RISE, known)[data.presses.indenter[data.press]]
        return np.asarray(depth_mm * (1 - values[0] * rise))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Lower the certified depth."""
        rise = relative_rise(data)[data.presses.indenter[data.press]]
        return replace(state, depth_mm=state.depth_mm * (1 - values[0] * rise))

    def absent(self, data: Observations) -> bool:
        """Also where a certificate took the rise off: what that leaves open is in the fit."""
        return data.shared.rise > 0 or data.depth_source != self.depth_source

    def supposed(self, data: Observations) -> Observations:
        """The same with bevels where most have them, for indenters whose bevel certified depths at a distance that
        is not stated; depths from elsewhere have nothing to do with a bevel.
        """
        if data.depth_source != self.depth_source:
            known = tuple(replace(i, bevel_distance_mm=None) for i in data.indenters)
        else:
            known = tuple(
                replace(i, bevel_distance_mm=USUAL_DISTANCE * i.radius_mm) if i.bevel_distance_mm is None else i
                for i in data.indenters
            )
        return replace(data, indenters=known)

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """The picture stays right, and the certified depth is too large."""
        return _RiseInPicture(self)


@dataclass(frozen=True, slots=True)
class _RiseInPicture(InPicture):
    """A rise that nobody took off is never below 0; of one that was taken off its std is left."""

    of_certificate = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The multiple, 0 or more."""
        return (replace(self.inner.parameters[0], bounds=(0.0, 1.5)),)

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same, with what is known of a rise that was taken off already."""
        if data.shared.rise == 0:
            return self.parameters
        left = Prior(0.0, data.shared.rise / TYPICAL_RISE, "the rise was taken off; its std")
        return (replace(self.inner.parameters[0], bounds=(-1.5, 1.5), prior=left),)

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.1], [1.0]])


def relative_rise(data: Observations) -> Floats:
    """Rise over depth at each indenter's bevel, (number of indenters,); 0 where its distance is unknown."""
    nu = 0.48 if data.gel.poisson_ratio is None else data.gel.poisson_ratio
    table = [_rise(nu, i.radius_mm, i.bevel_distance_mm, data.gel.thickness_mm) for i in data.indenters]
    return np.array(table)


@lru_cache(maxsize=64)
def _rise(poisson_ratio: float, radius_mm: float, distance_mm: float | None, thickness_mm: float) -> float:
    if distance_mm is None:
        return 0.0
    rise, _ = exact_profile(distance_mm / radius_mm, poisson_ratio, a_over_h=radius_mm / thickness_mm)
    return float(rise)
