"""Finite elements for the table of boundary.py: the effect of a near rim, at small strain and at depth."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

from tactilevision.files.arrays import save_table
from tactilevision.mechanics import boundary as b
from tactilevision.mechanics.flat_contact import WIDE
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.newton import march, reached
from tactilevision.mechanics.punch_fem.problem import GluedFace, PunchProblem, build
from tactilevision.records.measured import Floats, Material

EDGE_OVER_H = 1 / 30  # at h/60 the share is 3 % of itself larger at first touch, the same from w/h = .05 on
FAR = 12  # d/h in place of infinity


def make_table(path: Path = b.TABLE) -> None:
    """Solve the 250 linear problems and 384 presses behind the table and write it with its card; 20 minutes."""
    linear = np.log(linear_shares(b.A_OVER_H_NODES, b.POISSON_NODES, distances=b.DISTANCES))
    deep = depth_ratios()
    card = {
        "what": "ln s, s the loss of a punch's stiffness to a free side at d/h from its edge, by a/h, nu, d/h; "
        "the share at depth over s by a/h, nu, d/h, friction, w/h",
        "axes": {"a_over_h": b.A_OVER_H_NODES, "poisson_ratio": b.POISSON_NODES, "d_over_h": b.DISTANCES,
                 "ratio_a_over_h": b.RATIO_A_OVER_H, "ratio_poisson_ratio": b.RATIO_POISSON,
                 "ratio_d_over_h": b.RATIO_DISTANCES, "ratio_friction": ("0", "0.15", "0.3", "no slip"),
                 "ratio_w_over_h": b.RATIO_DEPTHS},
        "source": "mechanics/punch_fem. s: linear, glued sliding face, depth 1e-4 mm; ratio: neo-Hooke, edge "
        "radius h/30, over the same press on a pad of five thicknesses; default mesh",
        "made_by": "tactilevision.mechanics.boundary_solve.make_table",
        "licence": "MIT",
    }  # fmt: skip
    save_table(path, card, log_softening=linear, ratio=deep)


def linear_shares(
    a_over_h: tuple[float, ...], poisson_ratios: tuple[float, ...], *, distances: tuple[float, ...]
) -> Floats:
    """Return s (a/h, nu, d/h) at small strain, the punch frictionless and sharp."""
    shape = len(a_over_h), len(poisson_ratios), len(distances) + 1
    grid = product(a_over_h, poisson_ratios, (*distances, FAR))
    stiffness = np.array([stiffness_at_touch(nu, a, d_over_h=d) for a, nu, d in grid]).reshape(shape)
    return np.asarray(1 - stiffness[..., :-1] / stiffness[..., -1:])


def stiffness_at_touch(poisson_ratio: float, a_over_h: float, *, d_over_h: float) -> float:
    """Return P/(E w) in mm of a sharp sliding punch on a gel of 3 mm whose rim is `d_over_h` from the punch's
    edge.
    """
    face = GluedFace(3 * a_over_h, slides=True)
    model = build(PunchProblem(Material(1.0, poisson_ratio), face, 3, 3 * (a_over_h + d_over_h)))
    (state,) = march(model, [1e-4], log=[])
    return state.force_N / state.depth_mm


def depth_ratios() -> Floats:
    """Return the ratios (a/h, nu, d/h, friction, w/h) of the share the rim takes off at depth to that at small
    strain.
    """
    grid = list(product(b.RATIO_A_OVER_H, b.RATIO_POISSON, b.RATIO_DISTANCES, b.RATIO_FRICTIONS))
    shape = *map(len, (b.RATIO_A_OVER_H, b.RATIO_POISSON, b.RATIO_DISTANCES, b.RATIO_FRICTIONS)), -1
    return np.array([depth_ratio(*place) for place in grid]).reshape(shape)


def depth_ratio(a_over_h: float, poisson_ratio: float, d_over_h: float, friction: float) -> Floats:
    """Return the ratio at one place (w/h,); where one of the two presses ends, its last value is kept."""
    near, wide = (_forces(poisson_ratio, a_over_h, pad, friction) for pad in (a_over_h + d_over_h, WIDE))
    many = min(len(near), len(wide))
    (small,) = np.diff(linear_shares((a_over_h,), (poisson_ratio,), distances=(WIDE - a_over_h, d_over_h)).ravel())
    ratio = (1 - near[:many] / wide[:many]) / small
    return np.append(ratio, np.full(len(b.RATIO_DEPTHS) - many, ratio[-1]))


def _forces(poisson_ratio: float, a_over_h: float, pad_over_h: float, friction: float) -> Floats:
    punch = RoundedPunch(a_over_h, EDGE_OVER_H, friction)
    problem = PunchProblem(Material(1.0, poisson_ratio), punch, 1.0, pad_over_h, may_fold=True)
    return np.array([state.force_N for state in reached(build(problem), b.RATIO_DEPTHS, log=[])])
