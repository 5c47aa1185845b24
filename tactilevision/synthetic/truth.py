"""truth.toml: what a perfect calibration of a simulated recording would find."""

from __future__ import annotations

import math
from typing import Any

from tactilevision.synthetic.plan import PlannedPress, gel_under
from tactilevision.synthetic.scenario import Story
from tactilevision.synthetic.slope_response import Sight


def truth_of(story: Story) -> dict[str, Any]:
    """Material and clocks under the names of calibration.json, and every press as it really went."""
    gel, kit = story.options.gel, story.options.indenters
    profile = gel_under(story.options, kit.radius_mm)
    line = profile.line()
    return {
        "seed": story.seed,
        "youngs_modulus_MPa": gel.youngs_modulus_MPa,
        "poisson_ratio": gel.poisson_ratio,
        "reduced_modulus_MPa": story.law.reduced_modulus_MPa,
        "c_N_per_mm": gel.youngs_modulus_MPa * line[0],
        "beta": line[1],
        "friction": gel.friction,
        "edge_radius_mm": kit.edge_radius_mm,
        "solved_to_mm": float(profile.depths_mm[-1]),
        "clock_offset_s": story.clock_offset_s,
        "presses_accepted": [p.label for p in story.presses if not p.fault],
        "presses_rejected": [{"press": p.label, "reason": p.fault} for p in story.presses if p.fault],
        "press": [_press(story, p) for p in story.presses],
        **_hidden(story.options.sight),
    }


def _hidden(sight: Sight) -> dict[str, Any]:
    """What the light suffered since the reference pictures; nothing where it did not."""
    amounts = {
        "photometric_gain": (sight.gain, "1"),
        "photometric_drift": (sight.drift, "1"),
        "slope_saturation": (0.0 if math.isinf(sight.steepest) else sight.steepest, "mm/mm"),
    }
    tables = {key: {"amount": amount, "unit": unit, "catalogued": True} for key, (amount, unit) in amounts.items()
              if amount}  # fmt: skip
    return {"hidden": tables} if tables else {}


def _press(story: Story, press: PlannedPress) -> dict[str, Any]:
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
        force = float(story.law.force_N(press.profile, press.touch_mm)) * press.gain
        content |= {"touch_time_s": press.touch_time_s, "depth_mm": press.touch_mm, "force_N": force}
    return content
