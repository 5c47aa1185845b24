"""Stiffness of a punch on a bonded layer, for every sample of a fit.

P = 2 a E kappa(nu, a/h) / (1 - nu^2) * w
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records import Floats, Pair

NU_RANGE: Pair = (0.0, 0.4999)  # of kappa's table; beyond it as at its ends
RATIO_RANGE: Pair = (0.05, 10.0)  # a/h of kappa's table; beyond it as at its ends


def punch_stiffness(modulus_MPa: float, poisson_ratio: float, radius_mm: Floats, thickness_mm: Floats) -> Floats:
    """Force over depth of a frictionless flat punch, N/mm; radius and thickness of one shape (N,).

    nu and a/h are held inside their ranges, so that an optimiser that strays meets a wall and not an error.
    """
    nu = float(np.clip(poisson_ratio, *NU_RANGE))
    ratio = np.clip(radius_mm / thickness_mm, *RATIO_RANGE)
    kappa = _kappa(nu, ratio.tobytes())
    return np.asarray(2 * radius_mm * modulus_MPa * kappa / (1 - nu**2))


@lru_cache(maxsize=128)
def _kappa(poisson_ratio: float, ratios: bytes) -> Floats:
    """kappa of packed a/h: a derivative with respect to anything but nu, a and h asks for the same again."""
    few, where = np.unique(np.frombuffer(ratios), return_inverse=True)
    kappa = fast_kappa(poisson_ratio, few)[where]
    kappa.setflags(write=False)
    return kappa
