"""Physical and instrument effects, one a file. EFFECTS is a catalogue in the order in which effects act.

Private effects, of other classes derived from EffectBase, act last.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from types import MappingProxyType

from calibration.effects.adhesion import Adhesion
from calibration.effects.ageing import Ageing
from calibration.effects.backing_compliance import BackingCompliance
from calibration.effects.bevel_rise import BevelRise
from calibration.effects.cast_shadow import CastShadow
from calibration.effects.clock_offset import ClockOffset
from calibration.effects.depth_zero import DepthZero
from calibration.effects.edge_fillet import EdgeFillet
from calibration.effects.force_bias import ForceBias
from calibration.effects.force_crosstalk import ForceCrosstalk
from calibration.effects.force_gain import ForceGain
from calibration.effects.friction import Friction
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS
from calibration.effects.lamp_fading import LampFading
from calibration.effects.lateral_boundary import LateralBoundary
from calibration.effects.mullins import Mullins
from calibration.effects.photometric_drift import PhotometricDrift
from calibration.effects.photometric_gain import PhotometricGain
from calibration.effects.recovery import Recovery
from calibration.effects.skin import Skin
from calibration.effects.slope_saturation import SlopeSaturation
from calibration.effects.stiffening import Stiffening
from calibration.effects.temperature import Temperature
from calibration.effects.thickness import Thickness
from calibration.effects.thickness_wedge import ThicknessWedge
from calibration.effects.tilt import Tilt
from calibration.effects.viscoelasticity import MAX_TERMS, Viscoelasticity
from calibration.model.stages import Effect
from tactilevision.errors import InputError

_BUILT: tuple[Effect, ...] = (
    DepthZero(),
    BevelRise(),
    ForceBias(),
    ForceGain(),
    ForceCrosstalk(),
    ClockOffset(),
    Tilt(),
    EdgeFillet(),
    BackingCompliance(),
    LateralBoundary(),
    Thickness(),
    ThicknessWedge(),
    Skin(),
    Friction(),
    Adhesion(),
    Viscoelasticity(),
    Recovery(),
    Mullins(),
    Stiffening(),
    Ageing(),
    Temperature(),
    PhotometricGain(),
    PhotometricDrift(),
    SlopeSaturation(),
    CastShadow(),
    LampFading(),
)
EFFECTS: Mapping[str, Effect] = MappingProxyType(
    {effect.key: effect for effect in sorted(_BUILT, key=attrgetter("order"))}
)
CATALOGUE = tuple(EFFECTS)
PLAIN: Mapping[str, Effect] = MappingProxyType({effect.key: effect for effect in INSTRUMENT_ERRORS})


def get_effect(key: str) -> Effect:
    """Return the effect of the catalogue, or the instrument error, of this key.

    "viscoelasticity:2" has two terms. Raises InputError for an unknown key.
    """
    name, _, terms = key.partition(":")
    if name == Viscoelasticity.key and terms in {str(k + 1) for k in range(MAX_TERMS)}:
        return Viscoelasticity(terms=int(terms))
    if key in PLAIN:
        return PLAIN[key]
    if key not in EFFECTS:
        raise InputError(
            "there is no effect of this name",
            where="effect",
            value=key,
            remedy=f"Choose among: {', '.join(EFFECTS)}; of instrument errors: {', '.join(PLAIN)}.",
        )
    return EFFECTS[key]


def written(effect: Effect) -> str:
    """Return the text from which `get_effect` makes this effect."""
    terms = effect.terms if isinstance(effect, Viscoelasticity) else 1
    return effect.key if terms == 1 else f"{effect.key}:{terms}"
