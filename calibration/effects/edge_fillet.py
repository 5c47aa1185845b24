"""The punch's edge is rounded with radius rho, so that the contact grows with depth from b = a - rho up to a.

    w = (r/rho) [sqrt(r^2 - b^2) - b arccos(b/r)],    P/(2 E*) = r w - Int_b^r g dx,    g(x) = w(x) of the first

r the contact's radius. Exact on a half-space for a parabolic rounding; on a layer the same share of the flat
punch of radius r is taken. Vanishes at rho = 0. Sources: Sneddon, Int. J. Eng. Sci. 3 (1965) 47; Ciavarella,
Hills, Monno, Proc. IMechE C 212 (1998) 319.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


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

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """rho."""
        return (Parameter("edge_radius_mm", "mm", 0.0, (0.0, 0.8), "radius of the rounded edge", 0.1),)

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.03], [0.1], [0.3], [0.6]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Let the contact grow."""
        rho = values[0]
        if rho <= 0:
            return state
        radius, share = state.radius_mm.copy(), np.ones(data.size)
        for outer in np.unique(data.presses.radius_mm):
            mine = data.radius_mm == outer
            radius[mine], share[mine] = _contact(np.maximum(state.depth_mm[mine], 0), float(outer), rho)
        return replace(state, radius_mm=radius, factor=state.factor * share)


def _contact(depth_mm: Floats, outer_mm: float, rho_mm: float) -> tuple[Floats, Floats]:
    """Radius of the contact, and the share of a flat punch's force of that radius, at each depth."""
    b = outer_mm - min(rho_mm, 0.95 * outer_mm)
    grid = b + (outer_mm - b) * np.linspace(0, 1, 81) ** 2
    r = np.interp(depth_mm, _need(grid, b, rho_mm)[0], grid)
    for _ in range(3):  # Newton, so that a fit sees a smooth curve
        need, slope = _need(r, b, rho_mm)
        r = np.clip(r - (need - depth_mm) / np.maximum(slope, 1e-9), b, outer_mm)
    root = np.sqrt(np.maximum(r**2 - b**2, 0))
    lost = (root**3 / 3 - b * r**2 / 2 * np.arccos(b / r) + b**2 / 2 * root) / rho_mm
    return r, np.where(depth_mm > 0, 1 - lost / (r * np.maximum(depth_mm, 1e-9)), 1.0)


def _need(r: Floats, b: float, rho_mm: float) -> tuple[Floats, Floats]:
    """The depth at which the contact reaches r, and its derivative."""
    root = np.sqrt(np.maximum(r**2 - b**2, 0))
    gap = root - b * np.arccos(np.minimum(b / r, 1))
    return np.asarray(r * gap / rho_mm), np.asarray((gap + root) / rho_mm)
