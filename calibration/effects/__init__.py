"""Physical and instrument effects, one a file. EFFECTS is a catalogue in the order in which effects act.

Private effects, of other classes derived from EffectBase, act last.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from calibration.effects.stiffening import Stiffening
from calibration.effects.viscoelasticity import Viscoelasticity
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect
from tactilevision.errors import InputError, did_you_mean

# key and file of each effect; its class has the same name in capitals
CATALOGUE = (
    *("depth_quantisation", "depth_zero", "depth_drift", "permanent_set", "bevel_rise", "force_bias"),
    *("force_drift", "zero_creep", "force_hysteresis", "force_travel", "force_jump", "force_gain", "gain_drift"),
    *("sensor_creep", "force_crosstalk", "clock_offset", "backlash", "screw_error", "slip_stick", "clock_rate"),
    *("force_filter", "tilt", "edge_fillet", "backing_compliance", "lateral_boundary", "soft_zone"),
    *("cut_contact", "thickness", "thickness_wedge", "skin", "friction", "adhesion", "viscoelasticity"),
    *("poroelasticity", "recovery", "mullins", "stiffening", "ageing", "modulus_change", "temperature"),
    *("photometric_gain", "photometric_drift", "slope_saturation", "cast_shadow", "lamp_fading"),
)


def _effect(key: str) -> Effect:
    """Return the effect that the file of this name defines."""
    effect: Effect = getattr(import_module(f"{__name__}.{key}"), key.title().replace("_", ""))()
    return effect


EFFECTS: Mapping[str, Effect] = MappingProxyType({key: _effect(key) for key in CATALOGUE})


def effects_for(data: Observations) -> tuple[Effect, ...]:
    """Return the catalogue for these data; effects on resultants of pictures only where there are any."""
    return tuple(e for e in EFFECTS.values() if e.acts_on != "resultant" or data.resultants is not None)


def get_effect(key: str) -> Effect:
    """Return the effect of the catalogue of this key.

    "viscoelasticity:2" has two terms. Raises InputError for an unknown key.
    """
    found, whole = EFFECTS.get(key.partition(":")[0]), key.removesuffix(":1")
    while found is not None and written(found) != whole:
        found = found.richer()
    if found is None:
        raise InputError(
            "there is no effect of this name",
            where="effect",
            value=key,
            remedy=f"{did_you_mean(key, EFFECTS)}Choose among: {', '.join(EFFECTS)}.",
        )
    return found


def written(effect: Effect) -> str:
    """Return the text from which `get_effect` makes this effect."""
    terms = effect.terms if isinstance(effect, (Stiffening, Viscoelasticity)) else 1
    return effect.key if terms == 1 else f"{effect.key}:{terms}"
