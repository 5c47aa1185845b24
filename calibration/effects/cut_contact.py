"""Contact cut by the border of the picture or of the gel: a part of the force acts where nothing is seen.

    P -> P (1 + b q)

q is the share of the contact's outline that lies on the border, b the force beyond the border over the force
seen, for an outline that lies on it wholly. Range: b up to 5; vanishes at b = 0. Confused with a lateral boundary;
presses in the middle of the picture distinguish it. Source: form by judgement.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

LEAST_SHARE = 0.02  # largest share of an outline that counts as whole: one cell of fifty


class CutContact(EffectBase):
    """One share."""

    key = "cut_contact"
    title = "the picture shows only a part of the contact"
    acts_on = "resultant"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("lateral_boundary",)
    separated_by = ("presses in the middle of the picture",)
    source = "form by judgement"
    order = 106
    largest = 3.0
    check = ManualCheck("press in the middle of the picture", 3)
    parameters = (Parameter("beyond", "1", 0.0, (0, 5), "force beyond the border over the force seen", 0.5),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        found = data.resultants
        seen = found is not None and float(np.max(found.cut)) > LEAST_SHARE
        return "" if seen else "no contact is cut by the border of the picture"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the force beyond the border."""
        return state if data.resultants is None else state.times(factor=1 + values[0] * data.resultants.cut)
