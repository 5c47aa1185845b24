"""Drift of the reconstructed depth's scale with time, as of a lamp that warms or an exposure that creeps.

    seen = (1 + d t/T) w,    so w -> w/(1 + d t/T)

t is the rig's running time, T its total; a pause of more than an hour counts as an hour. d is dimensionless.
Range: |d| up to .3; vanishes at d = 0. Confused with ageing and the Mullins effect; a gauge or a ball pressed at
the beginning and the end distinguishes it. Source: definition.
"""

from __future__ import annotations

from calibration.effects.in_picture import Pictured
from calibration.inputs.conditions import missing_times, running_share
from calibration.inputs.observations import Observations
from calibration.model.stages import ManualCheck, Stage, amplitude
from tactilevision.records.measured import Floats


class PhotometricDrift(Pictured):
    """One drift over all of the data."""

    key = "photometric_drift"
    title = "the height map drifts with time"
    stage = Stage.DEPTH
    seen_in = ("time", "order")
    confused_with = ("ageing", "mullins")
    separated_by = ("a gauge or a ball at the beginning and the end",)
    source = "definition"
    order = 230
    largest = 0.05
    check = ManualCheck("press the same gauge first and last, and on each day", 10, 0.01)
    depth_source = "vision"
    parameters = (amplitude("drift", "1", 0.3, "relative change of the depth from first to last", 0.03),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show the drift; empty where they can."""
        return super().missing(data) or self.unseen(data)

    def unseen(self, data: Observations) -> str:
        """Return why certified depths cannot show the drift; empty where they can."""
        return missing_times(data)

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """Return the reconstructed depth (N,) of true depths (N,), mm."""
        seen: Floats = depth_mm * (1 + values[0] * running_share(data))
        return seen
