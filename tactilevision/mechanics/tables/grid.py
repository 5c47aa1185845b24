"""Cubic splines of nu, a/h and w/h on a grid with unknown nodes.

The splines run over nu, ln(a/h) and sqrt(w/h), in which the tables are smooth. Beyond the solved depths the values
are continued along depth by a straight line; cells with such a corner are marked as unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline


@dataclass(frozen=True, slots=True)
class Axes:
    """The nodes: `poisson_ratios`, `a_over_h`, `depths` (w/h), ascending."""

    poisson_ratios: Floats
    a_over_h: Floats
    depths: Floats

    @property
    def stretched(self) -> tuple[Floats, Floats, Floats]:
        """Coordinates of the splines."""
        return self.poisson_ratios, np.log(self.a_over_h), np.sqrt(self.depths)

    def places(self, poisson_ratio: Floats, a_over_h: Floats, depths: Floats) -> Floats:
        """Return (N, 3) stretched coordinates; depths below the first node count as that."""
        deep = np.sqrt(np.maximum(depths, self.depths[0]))
        return np.stack(np.broadcast_arrays(poisson_ratio, np.log(a_over_h), deep), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class HoledSpline:
    """Spline on a grid; `known` (cells) is True where all corners were solved."""

    axes: Axes
    known: Bools
    spline: NdBSpline

    def __call__(self, places: Floats) -> Floats:
        """Return values (N, ...) at stretched places (N, 3), continued where they are not known."""
        return np.asarray(self.spline(places), dtype=float)

    def inside(self, places: Floats) -> Bools:
        """Return True (N,) where a place lies on the grid and in a cell that was solved."""
        return inside_cells(self.axes, self.known, places=places)

    def reach(self, poisson_ratio: float, a_over_h: float) -> float:
        """Return the greatest w/h that is known at this nu and a/h; 0 off the grid."""
        depths = self.axes.depths
        inside = self.inside(self.axes.places(np.array(poisson_ratio), np.array(a_over_h), depths))
        return float(depths[np.argmin(inside) - 1 if not inside.all() else -1]) if inside[:2].all() else 0.0


def fit_grid(axes: Axes, values: Floats) -> HoledSpline:
    """Return the spline through `values` (nu, a/h, depth, ...), in their unit.

    NaN from some depth on means not solved. At least two depths must be known everywhere.
    """
    from scipy.interpolate import NdBSpline, make_interp_spline

    known, whole = solved_nodes(values), continued(axes.depths, values)
    knots, orders = [], []
    for k, nodes in enumerate(axes.stretched):
        order = min(3, len(nodes) - 1)
        line = make_interp_spline(nodes, np.moveaxis(whole, k, 0), k=order)
        whole = np.moveaxis(line.c, 0, k)
        knots.append(line.t)
        orders.append(order)
    return HoledSpline(axes, cells_of(known), NdBSpline(tuple(knots), whole, tuple(orders)))


def inside_cells(axes: Axes, known: Bools, *, places: Floats) -> Bools:
    """Return the mask (N,) of stretched places in a `known` cell; one on a node belongs to both its cells."""
    sides, on_grid = [], np.ones(len(places), dtype=bool)
    for k, nodes in enumerate(axes.stretched):
        slack = ROUNDING * (nodes[-1] - nodes[0])
        on_grid &= (places[:, k] >= nodes[0] - slack) & (places[:, k] <= nodes[-1] + slack)
        below, above = (np.searchsorted(nodes + move, places[:, k]) - 1 for move in (slack, -slack))
        sides.append([np.clip(cell, 0, len(nodes) - 2) for cell in (below, above)])
    found = np.any([known[cell] for cell in product(*sides)], axis=0)
    return np.asarray(on_grid & found)


def solved_nodes(values: Floats) -> Bools:
    """Return the mask (nu, a/h, depth) of nodes at which nothing is NaN."""
    return np.asarray(np.isfinite(values.reshape(*values.shape[:3], -1)).all(axis=-1))


def continued(depths: Floats, values: Floats) -> Floats:
    """Return `values` (nu, a/h, depth, ...), in their unit, continued in depth along the line of the last two
    known.
    """
    whole = values.copy()
    known = solved_nodes(values)
    for at in zip(*np.nonzero(~known.all(axis=-1)), strict=True):
        last = int(known[at].sum()) - 1
        slope = (whole[at][last] - whole[at][last - 1]) / (depths[last] - depths[last - 1])
        further = (depths[last + 1 :] - depths[last]).reshape(-1, *[1] * slope.ndim)
        whole[at][last + 1 :] = whole[at][last] + further * slope
    return whole


def cells_of(known: Bools) -> Bools:
    """Return the mask of the cells of which all eight corners are among the `known` nodes (nu, a/h, depth)."""
    corners = np.lib.stride_tricks.sliding_window_view(known, (2, 2, 2))
    return np.asarray(corners.all(axis=(-3, -2, -1)))
