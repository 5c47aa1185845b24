"""The punch's edge is rounded more than stated, by rho: the law lets the contact grow with depth accordingly.

    edge -> edge + rho

The contact of a rounded edge (tactilevision.mechanics.filleted_punch) lies
between a gel that slides (t = 0) and one that
sticks (t = 1) to the edge. Vanishes at rho = 0.
Sources: Sneddon, Int. J. Eng. Sci. 3 (1965) 47; Hayes et al., J. Biomech. 5 (1972) 541.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EDGE, EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class EdgeFillet(EffectBase):
    """One rounding for all indenters; acts mostly at small depth."""

    key = "edge_fillet"
    title = "the edge of the punch is rounded"
    stage = Stage.GEOMETRY
    seen_in = ("w",)
    confused_with = ("tilt", "stiffening", "thickness")
    separated_by = ("a sharp punch", "other radii")
    source = "Sneddon, Int. J. Eng. Sci. 3 (1965) 47"
    threshold = True
    order = 80
    largest = 0.5
    check = ManualCheck("look at the punch's edge through a magnifier", 5.0, 0.05)
    condition = EDGE
    instead_of_beta = 2

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """rho, t."""
        sticks = "how much the gel sticks to the edge (0: it slides)"
        return (
            Parameter("edge_radius_mm", "mm", 0.0, (0.0, 0.8), "rounding beyond what is stated", 0.1),
            Parameter("sticking", "1", 0.0, (0.0, 1.0), sticks, 0.3),
        )

    def missing(self, data: Observations) -> str:
        """Only a flat punch has an edge."""
        flat = any(indenter.shape == "flat_cylinder" for indenter in data.indenters)
        return "" if flat else "only a flat punch has an edge"

    def to_be_expected(self, data: Observations) -> bool:
        """Every edge is somewhat round, and of one that is not stated nobody knows by how much."""
        return not self.missing(data) and any(one.edge_radius_mm is None for one in data.indenters)

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[rho, sticks] for rho in (0.03, 0.1, 0.3, 0.6) for sticks in (0.0, 1.0)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Round the edge further."""
        return replace(state, edge_mm=state.edge_mm + values[0], sticking=float(values[1]))
