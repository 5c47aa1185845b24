"""Which cells may carry force: an outer guess from the depth, narrowed by the force itself.

Outer guess: cells deeper than three standard deviations and than a share of the deepest. The edge of a contact is
at least a third as deep as its middle (Hertz: a half; flat punch: all). So this loses no contact down to a tenth
of the depth of the deepest one. Limits: records/contact_thresholds.py.
Of the patches they form, those count whose deepest cell stands out by five deviations. Counted in the deviations
of each place, it must also sink more than the gel rises anywhere. Beside a punch the gel rises by an eighth of the
punch's depth at most, so a map that rises more than it sinks shows its own error there. Cells of a slow error are
alike, so that a view holds a few hundred places at most that may err apart from each other. Of such, five
deviations are exceeded by chance once in thousands of frames.
Narrowed: no cell pulls, so cells of negative pressure are left out until none is. A cell that carries less than
FAINTEST of the greatest pressure is left out as well: it is the ringing of the contact's edge, which a square cell
cannot follow.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label, maximum, uniform_filter

from tactilevision.records import Bools, Floats
from tactilevision.records.contact_thresholds import CONTACT, cell_limit_mm

FAINTEST = 0.02  # of the greatest pressure: the ringing of a contact's edge lies below
TINY = 1e-12  # mm: keeps a cell without deviation from a division by 0
DOUBT = 0.3  # of a contact's displacement of the gel beside it: linear theory against large depth


def candidate_cells(depth_mm: Floats, std_mm: Floats, *, known: Bools) -> npt.NDArray[np.intp]:
    """Flat indices of the cells that may touch, by depth and its standard deviation (rows, columns) in mm.

    Empty where nothing does.
    """
    seen = depth_mm[known]
    if seen.size == 0:
        return np.zeros(0, dtype=np.intp)
    deep = known & (depth_mm > cell_limit_mm(std_mm, float(seen.max())))
    neighbours = uniform_filter(deep.astype(np.float32), 3, mode="constant") * 9
    deep &= neighbours > CONTACT.cell_neighbours - 0.5
    patches, count = label(deep)
    if count == 0:
        return np.zeros(0, dtype=np.intp)
    pull = depth_mm / (std_mm + TINY)
    sure = maximum(pull, patches, np.arange(count + 1)) > max(CONTACT.patch_sigma, -float(pull[known].min()))
    sure[0] = False
    return np.flatnonzero(sure[patches])


def overlooked_cells(left_mm: Floats, moved_mm: Floats, *, std_mm: Floats, usable: Bools) -> npt.NDArray[np.intp]:
    """Flat indices of the cells (rows, columns) of a weak contact beside a deep one.

    There the depth `left_mm` over that one's own (`moved_mm`) stands out.

    `usable` leaves out what is near the deep contact. A patch must stand out of its deviation and of what the deep
    contact's displacement may be wrong by, and by more of the two than any place rises: the map's own slow error
    is as often a rise.
    """
    if not usable.any():
        return np.zeros(0, dtype=np.intp)
    doubt = DOUBT * float(np.abs(moved_mm[usable]).max())
    deep = usable & (left_mm > CONTACT.cell_sigma * std_mm + doubt)
    if np.count_nonzero(deep) < CONTACT.cell_neighbours:
        return np.zeros(0, dtype=np.intp)
    deep &= uniform_filter(deep.astype(np.float32), 3, mode="constant") * 9 > CONTACT.cell_neighbours - 0.5
    patches, count = label(deep)
    if count == 0:
        return np.zeros(0, dtype=np.intp)
    share = left_mm / (CONTACT.patch_sigma * std_mm + doubt + TINY)
    sure = maximum(share, patches, np.arange(count + 1)) > max(1.0, -float(share[usable].min()))
    sure[0] = False
    return np.flatnonzero(sure[patches])


def pulling(pressure: Floats, std: float = 0.0) -> Bools:
    """Mask (C,) of the pressures (MPa) of an active set that are to be left out; `std` of one, alike."""
    return np.asarray(pressure < max(FAINTEST * float(np.max(pressure, initial=0.0)), std))


def roughness(cells: npt.NDArray[np.intp], shape: tuple[int, int]) -> Floats:
    """A quarter of the graph Laplacian of the cells (C,): R, dimensionless (C, C).

    x R x is the squared step to the neighbours.

    The edge of the set is free, so a constant traction is not rough and its sum is not pulled down.
    """
    rows, columns = shape
    order = np.full((rows + 1) * (columns + 1), -1, dtype=np.intp)
    row, column = np.divmod(cells, columns)
    place = row * (columns + 1) + column
    order[place] = np.arange(len(cells))
    matrix = np.zeros((len(cells), len(cells)))
    for step in (1, columns + 1):
        other = order[place + step]
        first, second = np.flatnonzero(other >= 0), other[other >= 0]
        matrix[first, second] = matrix[second, first] = -0.25
        matrix[first, first] += 0.25
        matrix[second, second] += 0.25
    return matrix


def at_border(cells: npt.NDArray[np.intp], usable: Bools) -> Bools:
    """Mask (C,) of the cells beside one of which nothing is known: at the border of the view, gel or map."""
    inside = np.pad(usable, 1)
    row, column = np.divmod(cells, usable.shape[1])
    beyond = [inside[row + 1 + dy, column + 1 + dx] for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0))]
    return np.asarray(~np.logical_and.reduce(beyond))
