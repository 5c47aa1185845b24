"""Rise of the gel at the bevel: the gel next to the punch rises, so the bevel touches early.

    w -> w [1 - q u(r_b)]

A depth certified by a bevel of height H is H less the rise. u is the rise over w at the bevel's distance r_b from
the punch's axis by linear layer theory at the stated nu (.48 where none is stated); q = 1 is the computed rise.
Range: q from -.5 to 3; vanishes at q = 0. With one bevel distance it is confused with E and slightly with beta;
indenters with other bevel distances, the height map or the stage distinguish it.
Source: tactilevision.mechanics.profile.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.effects.in_picture import InPicture, Pictured
from calibration.inputs.observations import Observations
from calibration.laws.theory import nominal_nu
from calibration.model.stages import ManualCheck, Parameter, Prior, Stage, State
from tactilevision.mechanics.profile import exact_profile
from tactilevision.records.measured import Floats

USUAL_DISTANCE = 2.0  # of the punch's radius, from its axis: bevel of an indenter that states no distance
TYPICAL_RISE = 0.1  # rise over depth at a bevel whose distance is not stated


class BevelRise(Pictured):
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
    check = ManualCheck("use an indenter whose bevel stands at another distance", 15, 0.3)
    depth_source = "gauge"
    parameters = (Parameter("multiple", "1", 0.0, (-0.5, 3), "rise at the bevel over the computed one", 0.5),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the rise; empty where they can."""
        if data.depth_source != "gauge":
            return "the depths are not certified by a bevel"
        if data.shared.rise > 0:
            return "the certificate subtracted it; its uncertainty is in E's interval"
        if any(i.bevel_distance_mm is None for i in data.indenters):
            return "needs the bevels' distances (bevel_distance_mm)"
        return "" if np.ptp(relative_rise(data)) > 0.005 else "needs bevels at several distances"

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,), mm, where certified depths (N,) are too large by the rise."""
        known = relative_rise(data)
        rise = np.where(known == 0, TYPICAL_RISE, known)[data.presses.indenter[data.press]]
        seen: Floats = depth_mm * (1 - values[0] * rise)
        return seen

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the certified depth less the rise."""
        rise = relative_rise(data)[data.presses.indenter[data.press]]
        return state.times(depth_mm=1 - values[0] * rise)

    def absent(self, data: Observations) -> bool:
        """Return whether the depths have no rise in them, or the certificate subtracted it already."""
        return data.shared.rise > 0 or data.depth_source != self.depth_source

    def supposed(self, data: Observations) -> Observations:
        """Return the data with a usual bevel distance for bevels that state none; none for other depths."""
        certified = data.depth_source == self.depth_source
        distances = (
            (i.bevel_distance_mm or USUAL_DISTANCE * i.radius_mm) if certified else None for i in data.indenters
        )
        indenters = zip(data.indenters, distances, strict=True)
        return replace(data, indenters=tuple(replace(i, bevel_distance_mm=distance) for i, distance in indenters))

    def in_picture(self, data: Observations | None = None) -> InPicture:
        """Return the effect in the picture: the reconstructed depth is right, the certified one too large."""
        return _RiseInPicture(self)


@dataclass(frozen=True)
class _RiseInPicture(InPicture):
    """The rise in the picture: at least 0, or of the stated std where the certificate subtracted it."""

    of_certificate = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The multiple, 0 or more."""
        return (replace(self.inner.parameters[0], bounds=(0, 1.5)),)

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the multiple, with the std of a rise that was subtracted as its prior."""
        (free,) = self.parameters
        if data.shared.rise == 0:
            return (free,)
        prior = Prior(0.0, data.shared.rise / TYPICAL_RISE, "std of the rise that the certificate subtracted")
        return (replace(free, bounds=(-free.bounds[1], free.bounds[1]), prior=prior),)

    def starts(self, data: Observations) -> Floats:
        """Return two starts."""
        return np.array([[0.1], [1.0]])


def relative_rise(data: Observations) -> Floats:
    """Return rise over depth at each indenter's bevel, (indenters,); 0 where its distance is unknown."""
    nu, h = nominal_nu(data.gel), data.gel.thickness_mm
    return np.array([_rise(nu, i.radius_mm, i.bevel_distance_mm, h) for i in data.indenters])


@lru_cache(maxsize=64)
def _rise(poisson_ratio: float, radius_mm: float, distance_mm: float | None, thickness_mm: float) -> float:
    if distance_mm is None:
        return 0.0
    rise, _ = exact_profile(distance_mm / radius_mm, poisson_ratio, a_over_h=radius_mm / thickness_mm)
    return float(rise)
