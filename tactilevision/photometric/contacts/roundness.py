"""Which contacts are round, by a first law of the light, and what that asks of a better one.

A round body (a ball, a cone, the round edge of a punch) makes slopes that point to one axis, whatever its profile:

    p (y - cy) - q (x - cx) = 0

at each place, where a contact of any shape asks no curl alone. The axis is where a first law's slopes meet. A
contact whose slopes miss it by more than MAX_MISS_DEG on the median is not taken as round. What is nearly round
is taken as round, and turns the law a little.
"""

from __future__ import annotations

import numpy as np

from tactilevision.photometric.contacts.moments import Contact
from tactilevision.records import Floats

# degrees, median: most real balls have 2 to 8 by a first law; 15 reads drawn dents of three ellipses .6 worse
MAX_MISS_DEG = 7.0
MIN_SLOPE_SHARE = 0.3  # of the median slope: gentler ones tell no direction
NEAREST = 0.1  # contact radii from the axis: nearer, directions are noise
NEAREST_JUDGED = 0.25  # contact radii from the axis where roundness is judged
MAX_ITERATIONS = 4  # of weighing places anew for the axis
OUTLYING = 2.0  # deviations at which a place counts half


def round_equations(contact: Contact, law: Floats) -> Floats | None:
    """Equations (M, 2 K) for the coefficients of p, then of q, of a round contact; None of another.

    `law` (2, K) reads a first guess of the slopes. A row is the slope across the way to the axis, over sqrt(M).
    """
    slopes = contact.samples @ law.T
    away = contact.outward - _axis(slopes, contact.outward)
    far = np.hypot(*away.T)
    unit = away / np.maximum(far, 1e-9)[:, None]
    steep = np.hypot(*slopes.T)
    judged = (far > NEAREST_JUDGED) & (steep > MIN_SLOPE_SHARE * np.median(steep))
    miss = np.angle(-(slopes[judged] @ [1, 1j]) * np.conj(unit[judged] @ [1, 1j]))
    if not judged.any() or np.degrees(np.median(np.abs(miss))) > MAX_MISS_DEG:
        return None
    told = far > NEAREST
    rows = np.concatenate([contact.samples * unit[:, 1:], -contact.samples * unit[:, :1]], axis=1)[told]
    return np.asarray(rows / np.sqrt(len(rows)), np.float64)


def _axis(slopes: Floats, place: Floats) -> Floats:
    """The place (2,) at which the lines along `slopes` (N, 2) at `place` (N, 2) meet best."""
    across = np.stack([-slopes[:, 1], slopes[:, 0]], axis=1)
    moment = np.sum(across * place, axis=1)
    weights = np.ones(len(moment))
    for _ in range(MAX_ITERATIONS):
        normal = (across * weights[:, None]).T @ across
        normal[np.diag_indices(2)] += 1e-9 * np.trace(normal) + 1e-30
        axis = np.linalg.solve(normal, (across * weights[:, None]).T @ moment)
        off = np.abs(across @ axis - moment)
        weights = 1.0 / (1.0 + (off / (OUTLYING * (1.4826 * np.median(off) + 1e-300))) ** 2)
    return np.asarray(axis, np.float64)
