"""What the curvature beta of P/w against w/h can be, by finite elements, for a sharp punch on a gel of known h.

From independent finite elements at a/h = .833, h = 3 mm, depths .15 to .6 mm: the largest is a Hencky solid that
sticks, the smallest a neo-Hookean one without friction. A free beta outside of this is fitting something else:
a depth zero, another thickness, a rounded edge, a gel that stiffens.
"""

from __future__ import annotations

import numpy as np

from tactilevision.records import Estimate, Pair

NU = (0.30, 0.40, 0.45, 0.48, 0.495)
HIGHEST = (1.34, 1.23, 1.20, 1.13, 1.08)  # Hencky, sticking
LOWEST = 0.10  # neo-Hooke, frictionless
A_OVER_H: Pair = (0.5, 1.2)  # where these figures are taken to hold


def beta_range(poisson_ratio: Pair, a_over_h: float) -> Pair | None:
    """The smallest and the largest beta for any nu in this range; None where a/h is too far from the figures'."""
    if not A_OVER_H[0] <= a_over_h <= A_OVER_H[1]:
        return None
    low, high = np.clip(poisson_ratio, NU[0], NU[-1])
    inside = [nu for nu in NU if low < nu < high]  # the largest may lie between the ends
    return LOWEST, float(np.max(np.interp([low, *inside, high], NU, HIGHEST)))


def beta_outside_theory(beta: Estimate, poisson_ratio: Estimate, a_over_h: float) -> str:
    """A sentence where all of beta's interval lies outside of what the laws allow; else empty."""
    allowed = beta_range(poisson_ratio.interval95 or (NU[0], NU[-1]), a_over_h)
    if allowed is None or beta.interval95 is None or beta.value is None:
        return ""
    low, high = beta.interval95
    if low <= allowed[1] and high >= allowed[0]:
        return ""
    return (
        f"beta = {beta.value:.2f} lies outside of what contact laws allow here "
        f"({allowed[0]:.1f} to {allowed[1]:.2f}): thickness, a rounded edge, the depth's zero "
        "or a stiffening gel are candidates"
    )
