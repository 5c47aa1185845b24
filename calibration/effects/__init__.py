"""Physical and instrument effects, one a file. EFFECTS is a catalogue, not a gate: any Effect works.

CATALOGUE, the order of the documentation, is also that in which effects of one stage act; private ones come after.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from calibration.effects.depth_zero import DepthZero
from calibration.effects.viscoelasticity import Viscoelasticity
from calibration.stages import Effect
from tactilevision.errors import InputError

EFFECTS: Mapping[str, Effect] = MappingProxyType({e.key: e for e in (DepthZero(), Viscoelasticity())})
CATALOGUE = (
    "depth_zero",
    "bevel_rise",
    "force_bias",
    "force_gain",
    "force_crosstalk",
    "clock_offset",
    "tilt",
    "edge_fillet",
    "backing_compliance",
    "lateral_boundary",
    "thickness",
    "thickness_wedge",
    "skin",
    "friction",
    "adhesion",
    "viscoelasticity",
    "recovery",
    "mullins",
    "stiffening",
    "ageing",
    "temperature",
    "photometric_gain",
    "photometric_drift",
    "slope_saturation",
)


def get_effect(key: str) -> Effect:
    """The effect of this key as it stands in the catalogue. Raises InputError for an unknown key."""
    if key not in EFFECTS:
        raise InputError("there is no effect of this name", where="effect", value=key,
                         remedy=f"Choose among: {', '.join(EFFECTS)}.")  # fmt: skip
    return EFFECTS[key]
