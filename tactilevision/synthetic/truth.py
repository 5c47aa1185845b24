"""truth.toml: what a perfect calibration of a simulated recording would find."""

from __future__ import annotations

import math
from typing import Any

from tactilevision.synthetic.plan import PlannedPress, gel_under
from tactilevision.synthetic.scenario import Scenario
from tactilevision.synthetic.slope_response import SlopeResponse


def truth_of(scenario: Scenario) -> dict[str, Any]:
    """Material and clocks under the names of calibration.json, and every press as it really went."""
    gel, kit = scenario.options.gel, scenario.options.indenters
    profile = gel_under(scenario.options, kit.radius_mm)
    line = profile.line()
    return {
        "seed": scenario.seed,
        "youngs_modulus_MPa": gel.youngs_modulus_MPa,
        "poisson_ratio": gel.poisson_ratio,
        "reduced_modulus_MPa": scenario.law.reduced_modulus_MPa,
        "c_N_per_mm": gel.youngs_modulus_MPa * line[0],
        "beta": line[1],
        "friction": gel.friction,
        "edge_radius_mm": kit.edge_radius_mm,
        "solved_to_mm": float(profile.depths_mm[-1]),
        "clock_offset_s": scenario.clock_offset_s,
        "presses_accepted": [p.label for p in scenario.presses if not p.fault],
        "presses_rejected": [{"press": p.label, "reason": p.fault} for p in scenario.presses if p.fault],
        "press": [_press(scenario, p) for p in scenario.presses],
        **_hidden(scenario.options.slope_response),
    }


def _hidden(slope_response: SlopeResponse) -> dict[str, Any]:
    """What the light suffered since the reference pictures; nothing where it did not."""
    amounts = {
        "photometric_gain": (slope_response.gain, "1"),
        "photometric_drift": (slope_response.drift, "1"),
        "slope_saturation": (0.0 if math.isinf(slope_response.steepest) else slope_response.steepest, "mm/mm"),
    }
    tables = {
        key: {"amount": amount, "unit": unit, "catalogued": True}
        for key, (amount, unit) in amounts.items()
        if amount
    }
    return {"hidden": tables} if tables else {}


def _press(scenario: Scenario, press: PlannedPress) -> dict[str, Any]:
    content = {
        "press": press.label,
        "indenter": press.indenter,
        "good": not press.fault,
        "reason": press.fault,
        "height_mm": press.bevel.height_mm,
        "centre_mm": list(press.centre_mm),
        "tilt": list(press.tilt),
        "gain": press.gain,
    }
    if not math.isnan(press.touch_time_s):
        force = float(scenario.law.force_N(press.profile, press.touch_mm)) * press.gain
        content |= {"touch_time_s": press.touch_time_s, "depth_mm": press.touch_mm, "force_N": force}
    return content
