"""Periodic error of the depth's scale, as of a lead screw.

    w -> w + d cos(2 pi w/L + u)

Range: d up to .1 mm, L from .05 mm to half the largest depth, any phase u; vanishes at d = 0. The fit begins at
many periods and phases, and the number of these counts as parameters do (`searched`). Source: definition.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats

FINEST_MM = 0.05  # shortest period of a wave in depth, mm
PERIODS = 16  # periods at which the fits begin, a factor 1.1 to 1.2 apart
PHASES = 4  # starts of each period, a quarter of a turn apart
MIN_PLACES = 12  # distinct depths: four for each number of the wave


class ScrewError(EffectBase):
    """Amplitude, period and phase."""

    key = "screw_error"
    title = "the depth's scale has a periodic error, as of a lead screw"
    stage = Stage.DEPTH
    seen_in = ("w",)
    confused_with = ("edge_fillet", "tilt")
    separated_by = ("a dial gauge along the travel", "presses that begin at another height of the screw")
    source = "definition"
    order = 62
    acts_on = "punch"
    largest = 0.03
    searched = PERIODS * PHASES
    check = ManualCheck("compare the stage with a dial gauge along its travel", 10, 0.002)
    parameters = (
        Parameter("size_mm", "mm", 0.0, (0, 0.1), "amplitude", 0.005),
        Parameter("length_mm", "mm", 0.3, (FINEST_MM, 2), "period", 0.1),
        amplitude("phase_rad", "rad", 7, "phase", 1),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        places = np.unique(np.round(4 * data.depth_mm / FINEST_MM)).size
        return "" if places >= MIN_PLACES else f"needs {MIN_PLACES} depths or more"

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters, with periods up to half the largest depth: two must be seen."""
        size, length, phase = self.parameters
        most = _longest(data)
        return (size, replace(length, default=most / 2, bounds=(FINEST_MM, most)), phase)

    def starts(self, data: Observations) -> Floats:
        """Return starts at all phases and periods."""
        lengths = np.geomspace(FINEST_MM, _longest(data), PERIODS)
        phases = np.pi * np.linspace(-1, 1, PHASES, endpoint=False)
        return np.array([[0.003, length, phase] for length in lengths for phase in phases])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the wave added to the depth."""
        along = values[0] * np.cos(2 * np.pi * data.depth_mm / values[1] + values[2])
        return state.plus(depth_mm=along)


def _longest(data: Observations) -> float:
    return max(0.5 * float(np.max(data.depth_mm)), 2 * FINEST_MM)
