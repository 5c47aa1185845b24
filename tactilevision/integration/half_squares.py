"""Slopes on squares to depth on squares twice as wide, without the blur that wide squares would bring.

The difference of the depths of two neighbouring squares is the mean slope between their middles:

    (z_(i+1) - z_i)/d = mean of p over the square of side d that is centred on their common edge

which is four squares half as wide. The mean of the two squares' own slopes instead reaches over 2 d: it blurs a
surface with a deviation of .5 d, and beside a punch that takes .001 to .002 off nu at d = .25 mm.
"""

from __future__ import annotations

import numpy as np

from tactilevision.integration.poisson import FLOOR, solve_edges
from tactilevision.records import Bools, Floats, Pair


def integrate_half_squares(
    dz_dx: Floats, dz_dy: Floats, *, share: Floats, least: float, mm_per_px: Pair
) -> tuple[Floats, Bools]:
    """Depth (h, w) in mm, its mean 0, and where it is known (h, w), from mean slopes (2h, 2w) of half squares.

    `share` (2h, 2w), from 0 to 1, of each half square's pixels that are readable; squares and edges with less than
    `least` of theirs are not known, the surface is carried over them. `mm_per_px` (x, y) of half squares.
    """
    known = _along_both(share) > 4 * least
    weights, targets = [], []
    for slope, turned in ((dz_dx, False), (dz_dy, True)):
        part, total = (_between(a.T if turned else a) for a in (share, share * slope))
        ends = known.T if turned else known
        sound = (part > 4 * least) & ends[:, 1:] & ends[:, :-1]
        target = np.where(sound, total / np.where(sound, part, 1.0), 0.0)
        weight = np.where(sound, 1.0, FLOOR)
        weights.append(weight.T if turned else weight)
        targets.append(target.T if turned else target)
    scale = (2 * mm_per_px[0], 2 * mm_per_px[1])
    depth = solve_edges(*targets, w_x=weights[0], w_y=weights[1], mm_per_px=scale)
    return np.asarray(depth, np.float64), known


def _along_both(values: Floats) -> Floats:
    """Sums (h, w) over the four half squares of each square, of values (2h, 2w)."""
    rows = values[::2] + values[1::2]
    return np.asarray(rows[:, ::2] + rows[:, 1::2])


def _between(values: Floats) -> Floats:
    """Sums (h, w - 1) over the four half squares round the edge of two squares that are neighbours in a row."""
    rows = values[::2] + values[1::2]
    return np.asarray(rows[:, 1:-1:2] + rows[:, 2:-1:2])
