"""Permanent set: the surface stays lower by a share of the largest depth that the place has seen.

    w -> w - s w_max,    w_max the largest depth so far at that place, the present one included

While a fresh place is loaded, E takes up the set. Range: s up to .3; vanishes at s = 0. Source: ISO 815
(compression set), taken in proportion to the depth.
"""

from __future__ import annotations

from calibration.effects.mullins import largest_past_depth
from calibration.inputs.denoised_depth import nominal_depth
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats


class PermanentSet(EffectBase):
    """One share of the largest past depth."""

    key = "permanent_set"
    title = "the gel keeps a dent where it was pressed"
    stage = Stage.DEPTH
    seen_in = ("w", "load/unload", "order")
    confused_with = ("depth_zero", "mullins", "backlash")
    separated_by = ("a fresh place", "a height map of the free gel after the presses")
    source = "ISO 815"
    order = 12
    largest = 0.1
    check = ManualCheck("look at the free gel after the presses: does a dent remain?", 3, 0.01)
    parameters = (Parameter("share", "1", 0.0, (0, 0.3), "share of the largest depth that remains", 0.03),)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        deeper = (data.depth_mm < largest_past_depth(data) - TINY).any()
        return "" if deeper else "no place was pressed deeper before"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth below the lowered surface."""
        level = data.shifted(nominal_depth(data) - data.depth_mm)
        return state.plus(depth_mm=-values[0] * largest_past_depth(level))
