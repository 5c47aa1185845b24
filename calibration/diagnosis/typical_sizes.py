"""How large effects are on rigs and gels: judgements, in the unit of each one's first parameter.

A fit may go farther (its bounds); what is expected, and what an effect that cannot be seen could do, ends here.
"""

from __future__ import annotations

from collections.abc import Mapping

from calibration.inputs.observations import DepthSource, Observations
from calibration.model.stages import Effect

LARGEST: Mapping[str, float] = {
    "depth_zero": 0.05, "force_bias": 0.05, "force_gain": 0.02, "force_crosstalk": 0.02, "clock_offset": 0.1,
    "tilt": 0.02, "edge_fillet": 0.5, "backing_compliance": 0.02, "lateral_boundary": 0.3, "thickness": 0.3,
    "friction": 1.0, "adhesion": 0.002, "viscoelasticity": 0.3, "recovery": 0.1, "mullins": 0.15,
    "photometric_gain": 0.05, "photometric_drift": 0.05,
}  # fmt: skip
AS_COMPUTED: Mapping[str, float] = {"bevel_rise": 1.0}  # a multiple of what theory has

OF_SOURCE: Mapping[str, DepthSource] = {
    "backing_compliance": "stage",
    "bevel_rise": "gauge",
    "photometric_gain": "vision",
    "photometric_drift": "vision",
    "slope_saturation": "vision",
}


def absent(effect: Effect, data: Observations) -> bool:
    """Whether these data hold nothing of it, for their depth comes from elsewhere."""
    if effect.key == "bevel_rise" and data.shared.rise > 0:
        return True  # a certificate took it off; what that leaves open is in the fit
    return data.depth_source != OF_SOURCE.get(effect.key, data.depth_source)


def largest(effect: Effect) -> float:
    """The end of its range, from where it vanishes; that of its bounds where nobody judged it."""
    first = effect.parameters[0]
    low, high = first.bounds
    return LARGEST.get(effect.key, max(high - first.default, first.default - low))


def typical(effect: Effect) -> float:
    """The size that it has where it is there and nothing shows how large."""
    return AS_COMPUTED.get(effect.key, effect.parameters[0].scale)
