"""Tangential forces leak into the normal channel: P + cx Fx + cy Fy.

Fx, Fy as recorded. Vanishes at cx = cy = 0. Source: definition of a linear cross-talk matrix's last row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, told_starts, with_told
from tactilevision.records.measured import Bools, Floats


@dataclass(frozen=True, slots=True)
class ForceCrosstalk(EffectBase):
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
    check = ManualCheck("turn the force sensor by 90 degrees and press again", 10.0, 0.005)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """cx and cy."""
        return (
            Parameter("cx", "1", 0.0, (-0.3, 0.3), "normal force read for a unit of Fx", 0.02),
            Parameter("cy", "1", 0.0, (-0.3, 0.3), "normal force read for a unit of Fy", 0.02),
        )

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same; of a force that was never felt the factor is 0."""
        return with_told(self.parameters, _felt(data))

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        return "" if _felt(data).any() else "needs tangential forces that were recorded and vary"

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        starts = np.array([[0.02, 0.0], [-0.02, 0.0], [0.0, 0.02], [0.0, -0.02], [0.02, 0.02], [0.02, -0.02]])
        return told_starts(starts, _felt(data))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Add the leak."""
        leak = data.force_N[:, 0] * values[0] + data.force_N[:, 1] * values[1]
        return replace(state, force_N=state.force_N + leak)


def _felt(data: Observations) -> Bools:
    """Which of the two tangential forces vary (2,)."""
    return np.asarray(np.ptp(data.force_N[:, :2], axis=0) > 0)
