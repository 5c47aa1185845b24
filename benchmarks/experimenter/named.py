"""Which answers name each kind of fault rightly: edit here as the catalogue grows.

A plain word is the key of an effect that was added or stands among the candidates, or of what is said to be alike
(`otherwise`); `flag:X` is a flag of the diagnosis, `covariate:X` something that presses were found to follow,
`verdict:X` the verdict itself, for kinds that no effect of the catalogue is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

RIGHT: Mapping[str, frozenset[str]] = {
    "contact_late": frozenset({"depth_zero"}),
    "force_not_tared": frozenset({"force_bias"}),
    "wrong_thickness": frozenset({"thickness"}),
    "guide_pulls": frozenset({"force_along_travel", "force_along_depth", "guide_friction"}),
    "debonded_zone": frozenset(
        {"lateral_boundary", "thickness_wedge", "stiffness_step", "flag:place", "flag:depends_on_place"}
        | {"covariate:x", "covariate:place", "press_gain", "gain_step"}
    ),
    "poroelastic": frozenset({"poroelasticity"}),
    "warm_up": frozenset({"force_over_time", "force_warm_up", "warm_up"}),
    "backlash": frozenset({"depth_way_back", "backlash"}),
    "sensor_creep": frozenset({"force_under_load", "sensor_creep"}),
    "clock_rate": frozenset({"clock_rate"}),
    "low_pass": frozenset({"force_filter", "low_pass"}),
    "depth_steps": frozenset({"depth_quantisation", "depth_steps"}),
    "gain_drift": frozenset({"force_gain_drift", "gain_drift"}),
    "slip_stick": frozenset({"stick_slip", "slip_stick"}),
    "permanent_set": frozenset({"permanent_set", "verdict:UNKNOWN"}),
    "tilt_soft_frame": frozenset({"tilt", "backing_compliance"}),
    "gent": frozenset({"stiffening"}),
    "adhesion": frozenset({"adhesion"}),
    "noise_grows": frozenset({"noise_grows", "flag:noise_grows", "verdict:ADEQUATE"}),
    "swelling": frozenset({"swelling", "verdict:UNKNOWN"}),
}
NO_ALARM = frozenset(
    {"few_presses", "clock_uncertain", "one_depth", "curves_not_used"}
)  # flags of what was measured


def is_right(kind: str, said: Collection[str]) -> bool:
    """Return whether one of the answers names this kind."""
    return bool(RIGHT[kind] & frozenset(said))
