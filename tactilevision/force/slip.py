"""Friction and load share of a patch: its shear against that of contacts that slip more and more.

Slip starts where the traction that sticking needs is largest against the pressure, at the edge, and moves inwards.
With A the compliance along the motion and p the pressure, both as solved from the frame, a contact whose cells N
slip and whose cells S stick on an indenter that has moved by d has the tractions, in units of friction mu,

    tau_N = p_N,    tau_S = A_SS^-1 (r - A_SN p_N),    r = d/mu,

and r is what makes the last cells of S reach p: one unknown, how many cells slip. Each such contact predicts
friction d/r, load share sum(tau)/sum(p), and by how much each cell moves, f = A tau/r. To the shear of the frame

    u(x) = f (d + w z x x) + e x

is fitted (motion d, turn w, what pressing has spread e) with the noise of neighbours and an error of the model.
The posterior over the share of cells that slip, each equally likely before, gives friction and load share, their
deviations, and whether the frame can tell at all.

The outermost ring is no evidence: cells that a face covers in part lag without slip. The largest |t|/p is of no
use: without slip it is 2 to 4 at a ball's edge. Only places within a frame are compared, and no modulus counts, so
creep that softens the gel alike moves nothing.
Source: Cattaneo (1938), Mindlin (1949) and Jaeger (1998), in Johnson, Contact Mechanics (1985), section 7.2.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.linalg import lapack, solve_triangular

from tactilevision.force.compliance import SUBCELL_STEP
from tactilevision.force.nodes import Cells
from tactilevision.force.noise import likeness
from tactilevision.force.patches import PRESSED, Patches
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.wrench import Slip

IMMINENT = 0.7  # of the limiting force; benchmarks.slip
HALF = 0.6  # of the limiting force: a contact may be below it unless that is unlikely
DOUBT = 0.05  # probability that is no longer unlikely
LEVELS = np.linspace(0.0, 1.0, 21)  # share of the cells that slip; at the first one the first cell is about to
FIRST = 0.05  # of the sticking cells may be beyond friction: those are noise of the pressure
MODEL = 0.05  # of the motion: error of a cell's prediction; chosen on 100 contacts of seed 7
MIN_CELLS = 12  # of a patch: fewer have no inside
MIN_INNER = 5  # of them inside the outermost ring
LEAST_MOTION = 0.05  # of the depth: less has no direction

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
    cells, pressure = patches.found.cells[mine], patches.traction[2, mine]
    if len(cells) < MIN_CELLS:
        return Slip(why=TOO_SMALL)
    row, column = np.divmod(cells, patches.grid.shape[1])
    inner = _rings(row, column) > 1
    if np.count_nonzero(inner) < MIN_INNER:
        return Slip(why=TOO_SMALL)
    grid, noise = patches.grid, patches.seen.noise[0]
    *_, depth_mm = moved = patches.seen.displacement_mm.reshape(3, -1)[:, cells]
    place = np.stack([grid.x_mm[column], grid.y_mm[row]])
    place -= (place @ pressure / pressure.sum())[:, None]
    mean = moved[:2, inner] @ pressure[inner] / pressure[inner].sum()
    motion = float(np.hypot(*mean))
    if motion < LEAST_MOTION * depth_mm.max():
        return Slip(why=STILL)
    shares, reach_mm, follow = _family(_along(patches, cells, mean / motion), pressure)
    alike = likeness(noise.length_mm / grid.spacing_mm, max(grid.shape))
    down, across = (alike[np.abs(np.subtract.outer(k, k))] for k in (row[inner], column[inner]))
    spread = float(noise.slow.flat[cells[0]]) ** 2 * down * across
    spread.flat[:: len(spread) + 1] += float(noise.white.flat[cells[0]]) ** 2 + (MODEL * motion) ** 2
    misfit, moves_mm = _fits(moved[:2, inner], place[:, inner], follow[:, inner], spread)
    likely = np.exp(-(misfit - misfit.min()) / 2 / max(1.0, misfit.min() / (2 * len(spread))))
    likely /= likely.sum()
    frictions = moves_mm / reach_mm
    low, high = likely[shares < HALF].sum(), likely[shares >= IMMINENT].sum()
    if low > DOUBT:
        return Slip(why=TOO_NOISY if high > DOUBT else "")
    (friction, of_friction), (share, of_share) = (_mean_std(values, likely) for values in (frictions, shares))
    margin_N = scale * grid.cell_mm2 * friction * float(pressure.sum()) * (1 - share)
    lagging = int(np.rint(likely @ LEVELS * len(cells)))
    return Slip(friction, of_friction, share, of_share, margin_N, lagging, imminent=share > IMMINENT)


def _mean_std(values: Floats, likely: Floats) -> tuple[float, float]:
    """Return the mean and deviation of `values` (K,), in their unit, by probabilities `likely` (K,), and MODEL."""
    mean = float(likely @ values)
    return mean, float(np.hypot(np.sqrt(likely @ (values - mean) ** 2), MODEL * mean))


def _along(patches: Patches, cells: Cells, direction: Floats) -> Floats:
    """Return the displacement of cells by tractions (C, C), both along `direction` (2,), mm by modulus 1 MPa."""
    count, (x, y) = len(cells), direction
    block = patches.compliance.block(cells, 3)
    both = block[:count, count : 2 * count]
    found = x**2 * block[:count, :count] + y**2 * block[count : 2 * count, count : 2 * count]
    found += x * y * (both + both.T)
    found.flat[:: count + 1] += SUBCELL_STEP * patches.compliance.cell_unit
    return np.asarray(found)


def _family(along: Floats, pressure: Floats) -> tuple[Floats, Floats, Floats]:
    """Return load share (K,), motion over friction (K,) mm, and what each cell moves of it (K, C), at LEVELS.

    `along` (C, C) is the compliance along the motion. Cells slip in the order of what sticking needs of pressure.
    """
    count = len(pressure)
    order = np.argsort(np.linalg.solve(along, np.ones(count)) / pressure)  # those that stick longest first
    matrix, limit = along[np.ix_(order, order)], pressure[order]
    factor = np.linalg.cholesky(matrix)  # its leading blocks are the factors of the cells that stick
    inverse = lapack.dtrtri(factor, lower=1)[0]
    held = np.rint((1 - LEVELS) * count).astype(np.intp)
    sticks = np.arange(count) < held[:, None]
    by_motion = (sticks * inverse.sum(axis=1)) @ inverse
    by_slip = (sticks * ((~sticks * limit) @ factor)) @ inverse
    known = sticks & (by_motion > 0)
    reaches = np.divide(limit + by_slip, by_motion, out=np.full(sticks.shape, np.inf), where=known)
    reach = np.sort(reaches, axis=1)[np.arange(len(LEVELS)), (FIRST * held).astype(np.intp)]
    reach[-1] = 0.0  # all slip: no cell follows the indenter, and the one that moves most stands for it
    tau = np.where(sticks, reach[:, None] * by_motion - by_slip, limit)
    moved = tau @ matrix
    reach[-1] = moved[-1].max()
    shares, follow = np.minimum(tau.sum(axis=1) / limit.sum(), 1.0), np.empty_like(moved)
    follow[:, order] = moved / reach[:, None]
    return shares, reach, follow


def _fits(moved: Floats, place: Floats, follow: Floats, spread: Floats) -> tuple[Floats, Floats]:
    """Return the misfit (K,) of each contact of which cells `follow` (K, C) the motion, and the motion (K,), mm.

    `moved` (2, C) at `place` (2, C), mm, each component with the covariance `spread` (C, C), mm².
    """
    count = len(follow)
    columns = np.concatenate([moved, place, follow, follow * place[0], follow * place[1]])
    white = solve_triangular(np.linalg.cholesky(spread), columns.T, lower=True).T
    ahead, by_x, by_y = white[4:].reshape(3, count, -1)
    seen, forms = white[:2].ravel(), np.zeros((count, 4, 2, len(spread)))  # along x, along y, turn, spread
    forms[:, 0, 0] = forms[:, 1, 1] = ahead
    forms[:, 2, 0], forms[:, 2, 1], forms[:, 3] = -by_y, by_x, white[2:4]
    design = forms.reshape(count, 4, -1)
    right = design @ seen
    fit = np.linalg.solve(design @ design.transpose(0, 2, 1), right[..., None])[..., 0]
    return np.asarray(seen @ seen - (right * fit).sum(axis=1)), np.hypot(fit[:, 0], fit[:, 1])


def _rings(row: Cells, column: Cells) -> Cells:
    """Return the distance (C,) of each cell from the patch's edge, in steps to a neighbour: 1 at the edge."""
    row, column = row - row.min() + 1, column - column.min() + 1
    patch = np.zeros((row.max() + 2, column.max() + 2), dtype=np.uint8)
    patch[row, column] = 1
    return np.asarray(cv2.distanceTransform(patch, cv2.DIST_L1, 3)[row, column], dtype=np.intp)
