"""Rounding of the punch's edge beyond what is stated.

    edge -> edge + rho

rho in mm adds to the stated edge radius. The contact of a rounded edge (tactilevision.mechanics.filleted_punch)
starts smaller than the punch and grows with depth; t interpolates between a gel that slides over the edge (0) and
one that sticks to it (1). Range: rho up to .8 mm; vanishes at rho = 0. It acts mostly at small depth and is
confused with a tilt, stiffening and the thickness; a sharp punch or other radii distinguish it. Sources: Sneddon,
Int. J. Eng. Sci. 3 (1965) 47; Hayes et al., J. Biomech. 5 (1972) 541.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from calibration.inputs.observations import Observations
from calibration.model.stages import EDGE, EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


class EdgeFillet(EffectBase):
    """One additional edge radius for all indenters."""

    key = "edge_fillet"
    title = "the edge of the punch is rounded"
    acts_on = "punch"
    stage = Stage.GEOMETRY
    seen_in = ("w",)
    confused_with = ("tilt", "stiffening", "thickness")
    separated_by = ("a sharp punch", "other radii")
    source = "Sneddon, Int. J. Eng. Sci. 3 (1965) 47"
    threshold = True
    order = 80
    largest = 0.5
    check = ManualCheck("look at the punch's edge through a magnifier", 5, 0.05)
    condition = EDGE
    instead_of_beta = 2
    parameters = (
        Parameter("edge_radius_mm", "mm", 0.0, (0, 0.8), "rounding beyond what is stated", 0.1),
        Parameter("sticking", "1", 0.0, (0, 1), "how much the gel sticks to the edge (0: it slides)", 0.3),
    )
    start_values = tuple(product((0.03, 0.1, 0.3, 0.6), (0.0, 1.0)))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it: only a flat punch has an edge."""
        flat = any(indenter.shape == "flat_cylinder" for indenter in data.indenters)
        return "" if flat else "only a flat punch has an edge"

    def to_be_expected(self, data: Observations) -> bool:
        """Return whether an edge radius is not stated: every edge is somewhat rounded."""
        return not self.missing(data) and any(indenter.edge_radius_mm is None for indenter in data.indenters)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with a rounder edge."""
        return replace(state, edge_mm=state.edge_mm + values[0], sticking=values[1])
