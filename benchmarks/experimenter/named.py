"""Which answers name each kind of fault rightly: edit here as the catalogue grows.

A plain word is the key of an effect that was added or stands among the candidates; `flag:X` is a flag of the
diagnosis, `covariate:X` something that the residual depends on, `verdict:X` the verdict itself, for kinds that no
effect of the catalogue is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

RIGHT: Mapping[str, frozenset[str]] = {
    "contact_late": frozenset({"depth_zero"}),
    "force_not_tared": frozenset({"force_bias"}),
    "wrong_thickness": frozenset({"thickness"}),
    "guide_pulls": frozenset({"force_travel"}),
    "debonded_zone": frozenset({"soft_zone", "lateral_boundary", "thickness_wedge", "covariate:x"}),
    "poroelastic": frozenset({"poroelasticity", "flag:parameter_varies"}),
    "warm_up": frozenset({"force_drift"}),
    "backlash": frozenset({"backlash"}),
    "sensor_creep": frozenset({"sensor_creep"}),
    "clock_rate": frozenset({"clock_rate"}),
    "low_pass": frozenset({"force_filter"}),
    "depth_steps": frozenset({"depth_quantisation"}),
    "gain_drift": frozenset({"gain_drift"}),
    "slip_stick": frozenset({"slip_stick", "covariate:scatter while loading"}),
    "permanent_set": frozenset({"permanent_set", "verdict:UNKNOWN"}),
    "tilt_soft_frame": frozenset({"tilt", "backing_compliance"}),
    "gent": frozenset({"stiffening"}),
    "adhesion": frozenset({"adhesion"}),
    "noise_grows": frozenset({"noise_grows", "flag:noise_grows", "verdict:ADEQUATE"}),
    "swelling": frozenset({"depth_drift", "verdict:UNKNOWN"}),
}
NO_ALARM = frozenset(
    {"few_presses", "clock_uncertain", "one_depth", "curves_not_used"}
)  # flags of what was measured


def is_right(kind: str, said: Collection[str], sizes: Mapping[str, float]) -> bool:
    """Return whether an answer names this kind; a sensor that creeps down has the form of a relaxation."""
    also = {"viscoelasticity"} if sizes.get("creep", 0.0) < 0 else frozenset[str]()
    return bool((RIGHT[kind] | also) & frozenset(said))
