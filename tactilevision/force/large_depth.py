"""Correction of the linear layer for large depth: thinner gel under a contact, and a stretched contact.

    factor = [a' kappa(nu, a'/h')] / [a kappa(nu, a/h)],    a' = a (1 + e/2),    h' = h - w a^2/(a^2 + h^2)

per patch of touching cells: a = sqrt(area/pi), w the mean depth weighted by the pressure, e the patch's mean
surface stretch du_x/dx + du_y/dy. The weight joins two limits: a wide patch thins the gel by its whole depth, a
narrow one strains it only near by. The factor is 1 at w = 0.

Without shear e = 0, as for a sticking gel. A sliding gel stretches and responds as the linear layer does, without
correction. The share of friction's full effect interpolates (field.py).

No number is fitted, but the form was chosen on nonlinear finite elements (neo-Hooke, flat punches a/h .5 to 1.33,
nu .45 to .48, friction 0, .3 and no slip): there the linear resultant is 5 % low at w/h = .1 and 3 to 19 % at .2,
the corrected one within 2.4 %. Held-out cases (balls of 4 and 6 mm, punches of 1.1, 3.2 and 5 mm, nu .42 to .48,
any friction) are within 3.4 %, most within 2 %. Source of kappa: Hayes et al. (1972), as in
tactilevision.mechanics.kappa.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from tactilevision.force.nodes import NodeGrid
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

WIDEST = 3  # largest a/h: kappa's table ends there
THINNEST = 0.5  # largest w/h of a known factor


def depth_factors(
    grid: NodeGrid,
    cells: np.ndarray[tuple[int], np.dtype[np.intp]],
    *,
    pressure: Floats,
    displacement_mm: Floats,
    gel: Gel,
    poisson_ratio: float,
) -> Floats:
    """Return the factor (C,) on the tractions of `cells`.

    `displacement_mm` (3 or 1, rows, columns): x, y, z, or z alone without shear.
    """
    touching = np.zeros(grid.shape, dtype=bool)
    touching.flat[cells] = True
    patches, count = label(touching)
    which = patches.ravel()[cells] - 1
    weight = np.maximum(pressure, 0) + 1e-12
    depth = np.bincount(which, weight * displacement_mm[-1].ravel()[cells], count) / np.bincount(
        which, weight, count
    )
    size = np.bincount(which, minlength=count)
    stretch = np.zeros(count)
    if len(displacement_mm) == 3:
        stretch = np.bincount(which, surface_stretch(grid, displacement_mm).ravel()[cells], count) / size
    factor = patch_factor(
        np.sqrt(size * grid.cell_mm2 / np.pi),
        depth,
        stretch=stretch,
        thickness_mm=gel.thickness_mm,
        poisson_ratio=poisson_ratio,
    )
    return factor[which]


def patch_factor(
    radius_mm: Floats, depth_mm: Floats, *, stretch: Floats, thickness_mm: float, poisson_ratio: float
) -> Floats:
    """Return the factor of each patch (n,), a ratio, from arrays (n,)."""
    depth = np.clip(depth_mm, 0, THINNEST * thickness_mm)
    thinner = thickness_mm - depth * radius_mm**2 / (radius_mm**2 + thickness_mm**2)
    wider = radius_mm * (1 + np.clip(stretch, -0.5, 0.5) / 2)
    now, before = (np.minimum(a / h, WIDEST) for a, h in ((wider, thinner), (radius_mm, thickness_mm)))
    return np.asarray(
        wider * fast_kappa(poisson_ratio, now) / (radius_mm * fast_kappa(poisson_ratio, before)), dtype=np.float64
    )


def surface_stretch(grid: NodeGrid, displacement_mm: Floats) -> Floats:
    """Return du_x/dx + du_y/dy (rows, columns), dimensionless."""
    along = np.gradient(displacement_mm[0], grid.spacing_mm, axis=1)
    return np.asarray(along + np.gradient(displacement_mm[1], grid.spacing_mm, axis=0))
