"""Gain of the reconstructed depth: it is too large by a factor.

    seen = (1 + g) w,    so w -> w/(1 + g)

g is dimensionless. Range: |g| up to .5; vanishes at g = 0. From forces alone it is exactly confused with E and
beta; a certified depth compared with the reconstructed one (a gauge or a ball in each recording) distinguishes it.
Next to forces computed with a known E its prior is 5 % (a judgement). Source: definition.
"""

from __future__ import annotations

from calibration.effects.in_picture import Pictured
from calibration.inputs.observations import Observations
from calibration.model.stages import ManualCheck, Stage, amplitude
from tactilevision.records.measured import Floats


class PhotometricGain(Pictured):
    """One factor on the depth."""

    key = "photometric_gain"
    title = "the height map is off by a factor"
    stage = Stage.DEPTH
    seen_in = ("certified against reconstructed depth",)
    confused_with = ("youngs_modulus", "beta")
    separated_by = ("a gauge or a ball in each recording",)
    source = "definition"
    order = 220
    largest = 0.05
    std_at_known_E = 0.05
    check = ManualCheck("press a gauge or a ball of known depth and compare the camera's own reading", 10, 0.01)
    depth_source = "vision"
    parameters = (amplitude("gain", "1", 0.5, "relative error of the depth", 0.03),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the gain; empty where E is known."""
        alone = "a factor on the depth is E and beta exactly; a gauge in the picture would show it"
        return super().missing(data) or (alone if data.resultants is None else "")

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        seen: Floats = depth_mm * (1 + values[0])
        return seen
