"""Friction and load share of a patch, from gel that lags behind the part of the contact that sticks.

Gel that sticks to a rigid indenter moves with it: as a rigid body, plus what pressing has spread. In one frame

    u(x) = d + w z x (x - c) + e (x - c),      lag = (rigid motion - u) along the rigid motion,

is fitted to the patch's shear, weighted by the pressure and by how little a cell lags. Slip starts at the edge, so
the lag is averaged over rings of equal distance to it; noise falls with a ring's area. A ring slips where its lag
exceeds its noise and a share of the motion. There Coulomb's law holds, and friction and load share are

    mu = sum(t) / sum(p) over the rings that slip,      (Q/P)/mu = sum(t) / (mu sum(p)) over the patch,

t the traction along the motion.

The outermost ring alone proves nothing: cells that a face covers in part lag without slip, which made flats below
half the limit look as if they slipped. It takes LAGGING cells further in. Flats slip nearly at once everywhere, so
of most nothing is known until they do. The largest |t|/p is of no use: without slip it is 2 to 4 at a ball's edge.

Only places within a frame are compared. Creep moves the whole contact, or strains it alike, and does not lag.
Source: Cattaneo (1938) and Mindlin (1949), in Johnson, Contact Mechanics (1985), section 7.2.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.force.nodes import Cells
from tactilevision.force.patches import PRESSED, Patches
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.wrench import Slip

IMMINENT = 0.75  # of the limiting force; benchmarks.slip
LAGGING = 8  # cells inside the outermost ring that must lag
SIGMA = 2.5  # deviations of a ring's mean lag that are no noise
LAG_SHARE = 0.05  # of the motion: less is elastic; chosen on 100 contacts of seed 7
LEAST_MOTION = 0.2  # of the depth: pressing alone spreads the gel by a tenth, unevenly
NOISY = 0.5  # of the motion: where noise could hide a lag of this size nothing is said
MIN_CELLS = 12  # of a patch: fewer have no inside
SOFT = 0.03  # of the motion: a lag that halves a cell's weight, with that of noise
ROUNDS = 10  # rounds of reweighting at most
SETTLED = 0.01  # of the motion: a round that moves it by less is the last

TOO_SMALL = "too few cells to see slip"
STILL = "moved too little to see slip"
TOO_NOISY = "shear too noisy to see slip: average frames"


def find_slip(patches: Patches, scale: Floats) -> tuple[Slip | None, ...]:
    """Return the slip of each patch whose tractions are in units of `scale` (P,) MPa; None without shear."""
    if len(patches.traction) == 1:
        return (None,) * patches.count
    pressed = patches.traction[-1] > PRESSED * patches.mean(patches.traction[-1])[patches.of_cells]
    return tuple(
        _of_patch(patches, pressed & (patches.of_cells == k), float(scale[k])) for k in range(patches.count)
    )


def _of_patch(patches: Patches, mine: Bools, scale: float) -> Slip:
    if np.count_nonzero(mine) < MIN_CELLS:
        return Slip(why=TOO_SMALL)
    grid, cells, noise = patches.grid, patches.found.cells[mine], patches.seen.noise[0]
    row, column = np.divmod(cells, grid.shape[1])
    moved = patches.seen.displacement_mm.reshape(3, -1)[:, cells]
    traction, pressure = patches.traction[:2, mine], patches.traction[2, mine]
    place = np.stack([grid.x_mm[column], grid.y_mm[row]])
    place -= (place @ pressure / pressure.sum())[:, None]
    std = float(noise.total.flat[cells[0]])
    along, lag, motion = _lag(place, moved[:2], pressure, std)
    if motion < LEAST_MOTION * moved[2].max():
        return Slip(why=STILL)
    if SIGMA * std > NOISY * motion:
        return Slip(why=TOO_NOISY)
    ring = _rings(row, column)
    count = np.bincount(ring)
    mean = np.bincount(ring, lag) / np.maximum(count, 1)
    alike = np.minimum(noise.length_mm / np.sqrt(np.maximum(count, 1) * grid.cell_mm2), 1.0)
    slips = (mean > np.maximum(SIGMA * std * alike, LAG_SHARE * motion))[ring]
    lagging = int(np.count_nonzero(slips & (ring > 1)))
    if lagging < LAGGING:
        return Slip(lagging=lagging)
    limit, held = float(pressure[slips].sum()), (traction * along).sum(axis=0)
    friction, force = float(held[slips].sum()) / limit, float(held.sum())
    if not friction > 0:
        return Slip(why=TOO_NOISY)
    weights = np.zeros((2, 3, len(patches.found.cells)))
    weights[:, :2, mine] = along
    weights[0, :2, np.flatnonzero(mine)[~slips]] = 0.0
    slopes = patches.found.response(weights.reshape(2, -1)).reshape(2, 3, -1)
    x, y = (patches.seen.noise[k].propagate(slopes[:, k], patches.found.cells) for k in (0, 1))
    square = x + y
    whole = friction * float(pressure.sum())
    by_friction = np.array([-force / friction / limit, 1.0]) / whole
    variances = np.array([square[0, 0] / limit**2, by_friction @ square @ by_friction])
    spread = np.sqrt(np.maximum(variances, 0.0))  # where all cells slip the share is 1, but for rounding
    share = force / whole
    margin_N, (of_friction, of_share) = scale * grid.cell_mm2 * (whole - force), spread.tolist()
    return Slip(friction, of_friction, share, of_share, margin_N, lagging, imminent=share > IMMINENT)


def _lag(place: Floats, moved: Floats, pressure: Floats, std: float) -> tuple[Floats, Floats, float]:
    """Return direction (2, C) of the rigid motion of gel at `place` (2, C) mm, the lag (C,) mm behind it, and the
    mean motion, mm.
    """
    count = len(pressure)
    forms = np.zeros((4, 2, count))
    forms[0, 0] = forms[1, 1] = 1.0
    forms[2, 0], forms[2, 1], forms[3] = -place[1], place[0], place
    flat, both = forms.reshape(4, -1), moved.ravel()
    weight: Floats = pressure
    fit: Floats = np.zeros(4)
    for _ in range(ROUNDS):
        weighted = (forms * weight).reshape(4, -1)
        before, fit = fit, np.asarray(np.linalg.solve(weighted @ flat.T, weighted @ both), dtype=np.float64)
        rigid = (fit[:3] @ flat[:3]).reshape(2, count)
        size = np.sqrt(rigid[0] ** 2 + rigid[1] ** 2) + TINY
        motion = float(size.mean())
        lag = ((rigid + fit[3] * place - moved) * rigid).sum(axis=0) / size
        if abs(fit - before)[:2].max() < SETTLED * motion:
            break
        weight = pressure / (1 + (np.maximum(lag, 0.0) / (std + SOFT * motion + TINY)) ** 2)
    return rigid / size, lag, motion


def _rings(row: Cells, column: Cells) -> Cells:
    """Return the distance (C,) of each cell from the patch's edge, in steps to a neighbour: 1 at the edge."""
    row, column = row - row.min() + 1, column - column.min() + 1
    patch = np.zeros((row.max() + 2, column.max() + 2), dtype=np.uint8)
    patch[row, column] = 1
    return np.asarray(cv2.distanceTransform(patch, cv2.DIST_L1, 3)[row, column], dtype=np.intp)
