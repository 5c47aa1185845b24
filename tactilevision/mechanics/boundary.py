"""Reduction of a punch's stiffness near the pad's free side, compared with a wide layer.

    c(d) = c(infinity) (1 - s),    s = s(d/h; nu, a/h),    d = distance from the punch's edge to the pad's rim.

Tabulated from linear finite elements (mechanics/punch_fem: frictionless sharp punch, pad bonded to its base, side
free) on concentric discs; ln s is interpolated. s falls by a factor of 3 to 6 with each thickness: at nu = .48,
a/h = .83 it is 9 % at d = h, 2 % at 2 h, .1 % at 4 h. Range: d/h from .25 (beyond 5, where s < 5e-4, the last
decay is continued), nu in [.30, .499], a/h in [.4, 1.5]; InputError outside. Relative error between nodes: 3 % of
s.

A sticking face and a deep one displace less gel: `rim_share` is s times a tabulated ratio, mostly .4 to 1, from
finite elements of a neo-Hookean gel at four frictions and w/h to .25.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactilevision.files.arrays import load_table
from tactilevision.mechanics.flat_contact import WIDE, FlatContact, friction_place
from tactilevision.mechanics.punch_equation import check_within, positive
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats

TABLE = Path(__file__).with_name("boundary_table.npz")
DISTANCES = (0.25, 0.5, 0.75, 1.0, 1.5, 2, 3, 4, 5)  # d/h, nodes of the table
POISSON_NODES = (0.3, 0.4, 0.45, 0.48, 0.499)  # Poisson's ratio, nodes of the table
A_OVER_H_NODES = (0.4, 0.6, 2.5 / 3, 1.2, 1.5)  # a/h, nodes of the table
RATIO_DISTANCES = tuple(2.0**k for k in range(-2, 2))  # d/h; beyond, where s is small, the last value is kept
RATIO_POISSON = (POISSON_NODES[0], *POISSON_NODES[2:])  # Poisson's ratio, nodes of the ratios
RATIO_A_OVER_H = A_OVER_H_NODES[::2]  # a/h, nodes of the ratios
RATIO_FRICTIONS = (0.0, 0.15, 0.3, np.inf)  # Coulomb's coefficient, nodes of the ratios
RATIO_DEPTHS = (0.01, *(k / 20 for k in range(1, 6)))  # w/h, nodes of the ratios


def softening(
    distance_mm: npt.ArrayLike, *, radius_mm: float, thickness_mm: float, poisson_ratio: float
) -> Floats:
    """Return s (any shape) for a punch in the middle of a disc whose rim is `distance_mm` from the punch's
    edge.
    """
    d = positive("distance_mm", distance_mm) / float(positive("thickness_mm", thickness_mm))
    alpha = float(positive("radius_mm", radius_mm)) / thickness_mm
    for what, ends, value in (
        ("d/h", (DISTANCES[0], np.inf), d),
        ("Poisson's ratio", (POISSON_NODES[0], POISSON_NODES[-1]), poisson_ratio),
        ("a/h", (A_OVER_H_NODES[0], A_OVER_H_NODES[-1]), alpha),
    ):
        check_within(f"the table of softening is for {what} in", value, ends, where="softening")
    line = _between((A_OVER_H_NODES, POISSON_NODES), _table()[0], (alpha, poisson_ratio))
    nodes = np.array(DISTANCES)
    decay = (line[-1] - line[-2]) / (nodes[-1] - nodes[-2])
    beyond = line[-1] + decay * (d - nodes[-1])
    return np.asarray(np.exp(np.where(d > nodes[-1], beyond, np.interp(d, nodes, line))))


def rim_share(depth_mm: npt.ArrayLike, contact: FlatContact, *, poisson_ratio: float) -> Floats:
    """Return what the pad's rim takes off P at a depth (any shape), over P on a pad of five thicknesses.

    s at this distance, less s on such a pad, times the tabulated ratio; 0 from five thicknesses on. Relative error
    10 %. Raises InputError as `softening` does.
    """
    h, a = contact.thickness_mm, contact.radius_mm
    if contact.pad_radius_mm >= WIDE * h * (1 - ROUNDING):
        return np.zeros_like(np.asarray(depth_mm, dtype=float))
    nu = min(poisson_ratio, POISSON_NODES[-1])
    distances = np.array([contact.pad_radius_mm, WIDE * h]) - a
    near, wide = softening(distances, radius_mm=a, thickness_mm=h, poisson_ratio=nu)
    axes = RATIO_A_OVER_H, RATIO_POISSON, RATIO_DISTANCES, tuple(map(friction_place, RATIO_FRICTIONS))
    ratio = _between(axes, _table()[1], (a / h, nu, distances[0] / h, friction_place(contact.friction)))
    return np.asarray((near - wide) * np.interp(np.asarray(depth_mm, dtype=float) / h, RATIO_DEPTHS, ratio))


@lru_cache(maxsize=1)
def _table() -> tuple[Floats, Floats]:
    """Return ln s (a/h, nu, d/h) at small strain, and the ratio (a/h, nu, d/h, friction, w/h)."""
    arrays, _ = load_table(TABLE)
    return arrays["log_softening"], arrays["ratio"]


def _between(axes: tuple[tuple[float, ...], ...], values: Floats, at: tuple[float, ...]) -> Floats:
    """Return the `values` at a place, the nearest of the table outside.

    Linear along each of the first axes: the tables are nearly straight between nodes, and must not overshoot.
    """
    from scipy.interpolate import interpn

    inside = [np.clip(one, nodes[0], nodes[-1]) for nodes, one in zip(axes, at, strict=True)]
    return np.asarray(interpn(axes, values, inside)[0])
