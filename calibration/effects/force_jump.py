"""Jump of the force sensor's zero between two presses, as of a sensor that was knocked, overloaded or tared again.

    P -> P + b    from the press of order n on

Range: |b| up to 1 N, n between the second press and the last; vanishes at b = 0. The fit begins at several
presses, and their number counts as parameters do (`searched`). A zero that is read in air before each press
removes it. Source: definition.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats

PLACES = 16  # presses at which the fits begin, at most
LEAST = 2  # presses on either side of the jump


class ForceJump(EffectBase):
    """Size, and the first press after the jump."""

    key = "force_jump"
    title = "the force sensor's zero jumps between two presses"
    stage = Stage.INSTRUMENT
    seen_in = ("order",)
    confused_with = ("force_drift", "force_bias")
    separated_by = ("readings in air before and after each press",)
    source = "definition"
    order = 35
    largest = 0.2
    searched = PLACES
    check = ManualCheck("read the force sensor in air before the first press and after the last", 3, 0.004)
    parameters = (
        amplitude("size_N", "N", 1.0, "size of the jump", 0.02),
        Parameter("since", "1", 1.0, (0, 1e6), "presses before the jump", 1.0),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        return "" if data.count >= 2 * LEAST else f"needs {2 * LEAST} presses or more"

    def starts(self, data: Observations) -> Floats:
        """Return starts of either sign at presses spread over the recording."""
        ranks = np.unique(np.linspace(LEAST, data.count - LEAST, PLACES).round())
        return np.array([[sign * 0.01, rank] for rank in ranks for sign in (1, -1)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the zero after the jump."""
        rank = np.argsort(np.argsort(data.presses.order, kind="stable"))
        return state.plus(force_N=values[0] * (rank + 0.5 > values[1])[data.press])
