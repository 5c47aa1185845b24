"""Errors that presses share: machined heights and radii, the gel's thickness, and the certificate.

    w -> (1 + r) w + t + dH_k,    a -> a + da_k,    h -> h + dh,    each ~ N(0, std^2) as stated

They do not average out over repeats, so they are fitted with their priors along with the material and widen its
interval accordingly. Absent where no std is stated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations, Shared
from calibration.model.composition import Model
from calibration.model.stages import EffectBase, Parameter, Prior, Stage, State
from tactilevision.records.measured import Floats

HEIGHTS, DIMENSIONS, CERTIFICATE = "heights", "dimensions", "certificate"
TOLERANCES = (HEIGHTS, DIMENSIONS, CERTIFICATE)


@dataclass(frozen=True, slots=True)
class Heights(EffectBase):
    """Depth error of each indenter whose machined height has a std; `stds` (name, mm) in the data's order."""

    stds: tuple[tuple[str, float], ...]

    key = HEIGHTS
    stage = Stage.DEPTH

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """dH of each indenter with a std."""
        return _small((f"{name}_mm", std, f"error of the machined height of {name}") for name, std in self.stds)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth of each indenter's presses shifted, but not of indenters added later."""
        known = np.array([k for k, (_, std) in enumerate(self.stds) if std > 0])
        number = data.presses.indenter[data.press]
        place = np.minimum(np.searchsorted(known, number), known.size - 1)
        return state.plus(depth_mm=values[place] * (known[place] == number))


@dataclass(frozen=True, slots=True)
class Certified(EffectBase):
    """Errors of the certificate that all presses share: when a touch is detected, how far the gel rises to it."""

    shared: Shared

    key = CERTIFICATE
    stage = Stage.DEPTH

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The offset and the relative error, where they have a std."""
        touch = ("touch_mm", self.shared.touch_mm, "all touches early or late")
        return _small((touch, ("rise", self.shared.rise, "all rises larger or smaller")))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth stretched and shifted."""
        offset = values[0] if self.shared.touch_mm > 0 else 0.0
        stretch = values[-1] if self.shared.rise > 0 else 0.0
        return replace(state, depth_mm=(1 + stretch) * state.depth_mm + offset)


@dataclass(frozen=True, slots=True)
class Dimensions(EffectBase):
    """Errors of the thickness and of each radius that has a std; `radii` (radius, std) in rising order."""

    thickness_std_mm: float
    radii: tuple[tuple[float, float], ...]

    key = DIMENSIONS
    stage = Stage.GEOMETRY

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """dh, then da of each radius with a std."""
        thickness = ("thickness_mm", self.thickness_std_mm, "error of the thickness")
        radii = ((f"radius[{radius:g}]_mm", std, "error of the indenter's radius") for radius, std in self.radii)
        return _small((thickness, *radii))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with thickness and radius shifted."""
        thickness = state.thickness_mm + (values[0] if self.thickness_std_mm > 0 else 0.0)
        known = [radius for radius, std in self.radii if std > 0]
        shifts = zip(values[int(self.thickness_std_mm > 0) :], known, strict=True)
        shift = sum((value * (data.radius_mm == where) for value, where in shifts), np.zeros(data.size))
        return replace(state, thickness_mm=thickness, radius_mm=state.radius_mm + shift)


def with_tolerances(model: Model, data: Observations) -> Model:
    """Return the model with the stated tolerances of these data's indenters and gel."""
    certified = data.shared.heights and (not data.is_curves or data.depth_source == "gauge")
    heights = Heights(tuple((i.name, i.height_std_mm if certified else 0.0) for i in data.indenters))
    together = Certified(Shared() if data.is_curves else data.shared)
    spread = {i.radius_mm: i.radius_std_mm for i in data.indenters}
    dimensions = Dimensions(data.gel.thickness_std_mm, tuple(sorted(spread.items())))
    stated = [one for one in (heights, together, dimensions) if one.parameters]
    return Model(model.law, (*(e for e in model.effects if e.key not in TOLERANCES), *stated))


def _small(table: Iterable[tuple[str, float, str]]) -> tuple[Parameter, ...]:
    """Return a parameter for each (name, std, meaning) with a std; one whose name has no unit is relative."""
    return tuple(
        Parameter(
            name,
            "mm" if name.endswith("_mm") else "1",
            0.0,
            (-8 * std, 8 * std),
            meaning,
            std,
            Prior(0.0, std, "stated tolerance"),
        )
        for name, std, meaning in table
        if std > 0
    )
