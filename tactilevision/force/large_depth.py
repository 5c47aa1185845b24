"""Correction of the linear layer for large depth: thinner gel under a contact, and a stretched contact.

    factor = [a' kappa(nu, a'/h')] / [a kappa(nu, a/h)] (1 + STRAINED w^2/(a^2 + h^2)),
    a' = a (1 + e/2),    h' = h - w a^2/(a^2 + h^2)

per patch of touching cells: a = sqrt(area/pi), w the mean depth weighted by the pressure, e the patch's mean
surface stretch du_x/dx + du_y/dy. The weight joins two limits: a wide patch thins the gel by its whole depth, a
narrow one strains it only near by. The factor is 1 at w = 0. Without shear e = 0, as for a sticking gel; a
sliding gel stretches and responds as the linear layer does.

The form was chosen on nonlinear finite elements (neo-Hooke, flat punches a/h .5 to 1.33, nu .45 to .48, friction
0, .3 and no slip), and STRAINED on those of a/h .5 and .83: there the linear resultant is 10 to 20 % low at w/h =
.2. Source of kappa: Hayes et al. (1972), as in mechanics/kappa.py.
"""

from __future__ import annotations

import numpy as np

from tactilevision.mechanics.kappa import kappa_at
from tactilevision.mechanics.punch_equation import check_range
from tactilevision.records.measured import Floats

WIDEST = 3  # largest a/h: kappa's table ends there
THINNEST = 0.5  # largest w/h of a known factor
STRAINED = 1.5  # stiffening of gel about a narrow contact; benchmarks.force_depth


def patch_factor(
    radius_mm: Floats, depth_mm: Floats, *, stretch: Floats, thickness_mm: Floats | float, poisson_ratio: float
) -> Floats:
    """Return the factor of each patch (n,), a ratio, from arrays (n,)."""
    depth = np.clip(depth_mm, 0, THINNEST * thickness_mm)
    thinner = thickness_mm - depth * radius_mm**2 / (radius_mm**2 + thickness_mm**2)
    wider = radius_mm * (1 + np.clip(stretch, -0.5, 0.5) / 2)
    ratios = np.minimum(np.stack([wider / thinner, radius_mm / thickness_mm]), WIDEST)
    check_range(poisson_ratio, ratios, where="patch_factor")
    now, before = kappa_at(poisson_ratio, ratios)
    strained = 1 + STRAINED * depth**2 / (radius_mm**2 + thickness_mm**2)
    ratio = wider * now / (radius_mm * before)
    return np.asarray(strained * ratio, dtype=np.float64)
