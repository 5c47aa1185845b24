"""How large effects are on rigs and gels, as each states it, in the unit of its first parameter.

A fit may go farther (its bounds); what is expected, and what an effect that cannot be seen could do, ends here.
"""

from __future__ import annotations

from calibration.inputs.observations import Observations
from calibration.model.stages import Effect, EffectBase


def absent(effect: Effect, data: Observations) -> bool:
    """Whether these data hold nothing of it, for their depth comes from elsewhere."""
    return isinstance(effect, EffectBase) and effect.absent(data)


def largest(effect: Effect) -> float:
    """The end of its range, from where it vanishes; that of its bounds where nobody judged it."""
    first, stated = effect.parameters[0], getattr(effect, "largest", None)
    low, high = first.bounds
    return max(high - first.default, first.default - low) if stated is None else float(stated)


def typical(effect: Effect) -> float:
    """The size that it has where it is there and nothing shows how large."""
    stated = getattr(effect, "typical", None)
    return effect.parameters[0].scale if stated is None else float(stated)


def to_be_expected(effect: Effect, data: Observations) -> bool:
    """Whether some of it is on any rig like the one that these data come from."""
    return isinstance(effect, EffectBase) and effect.to_be_expected(data)
