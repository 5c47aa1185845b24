"""A contact at the border of what is known: whether it is cut there, and the force that may lie beyond."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_fill_holes

from tactilevision.force.contact import at_border
from tactilevision.force.inverse import Solution
from tactilevision.force.nodes import NodeGrid
from tactilevision.force.observe import Observation
from tactilevision.records import Floats
from tactilevision.records.contact_thresholds import CONTACT


def is_cut(grid: NodeGrid, found: Solution, seen: Observation) -> bool:
    """Whether pressure reaches the border: that of its cells, summed, stands out of its own deviation.

    That holds errors that the whole contact shares, and those of each cell alone.
    """
    edge = at_border(found.cells, binary_fill_holes(seen.known))
    if not edge.any():
        return False
    weights = np.zeros((1, found.traction.size))
    weights[0, -len(found.cells) :] = edge
    shared = float(found.shift(weights, seen.depth_std_mm.ravel()[found.cells])[0])
    own = float(found.propagate(weights, np.repeat(seen.std_mm, len(found.cells)))[0, 0])
    return float(found.traction[-1][edge].sum()) > CONTACT.cell_sigma * float(np.hypot(shared, np.sqrt(own)))


def force_beyond(grid: NodeGrid, found: Solution, seen: Observation, *, scale: Floats, cut: bool) -> Floats:
    """Squared force (3,), N², that may lie where nothing is known.

    Beyond the border that cuts a contact, its cells' traction carried on for half the contact's width; in a hole
    of the map, the mean traction round it, over no more than it.
    """
    whole = np.asarray(binary_fill_holes(seen.known))
    outer = at_border(found.cells, whole)
    inner = at_border(found.cells, seen.known) & ~outer
    half_width = np.sqrt(len(found.cells) / np.pi)
    traction, square = found.traction * scale, np.zeros(len(found.traction))
    if cut:
        square += (grid.cell_mm2 * traction[:, outer].sum(axis=1) * half_width) ** 2
    if inner.any():
        missing = min(np.count_nonzero(whole & ~seen.known), half_width * np.count_nonzero(inner))
        square += (grid.cell_mm2 * traction[:, inner].mean(axis=1) * missing) ** 2
    return np.concatenate([np.zeros(3 - len(square)), square])
