"""Cross-talk of the force sensor: tangential forces appear in the normal channel.

    P -> P + cx Fx + cy Fy

Fx and Fy are the tangential forces as recorded, cx and cy dimensionless. Range: |cx|, |cy| up to .3; vanishes at
cx = cy = 0. Confused with a tilt and a wedge-shaped gel; a press with shear applied by hand distinguishes it.
Source: definition, the last row of a linear cross-talk matrix.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import AxesEffect, ManualCheck, Stage, State, amplitude
from tactilevision.records.measured import Bools, Floats


class ForceCrosstalk(AxesEffect):
    """Two factors, one for each tangential force."""

    key = "force_crosstalk"
    title = "tangential force leaks into the normal one"
    stage = Stage.INSTRUMENT
    seen_in = ("Fx", "Fy")
    confused_with = ("tilt", "thickness_wedge")
    separated_by = ("a press with shear put on by hand",)
    source = "definition"
    order = 50
    largest = 0.02
    check = ManualCheck("turn the force sensor by 90 degrees and press again", 10, 0.005)
    parameters = tuple(
        amplitude(f"c{axis}", "1", 0.3, f"normal force read for a unit of F{axis}", 0.02) for axis in "xy"
    )
    signs = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show cross-talk; empty where they can."""
        return "" if self.varies(data).any() else "needs tangential forces that were recorded and vary"

    def varies(self, data: Observations) -> Bools:
        """Return which of the two tangential forces vary (2,)."""
        return np.asarray(np.ptp(data.force_N[:, :2], axis=0) > 0)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the tangential forces' share."""
        leak = data.force_N[:, 0] * values[0] + data.force_N[:, 1] * values[1]
        return state.plus(force_N=leak)
