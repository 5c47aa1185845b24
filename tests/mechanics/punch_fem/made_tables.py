"""Small smooth tables, so that reading, merging and tabulating are tested without finite elements."""

from __future__ import annotations

import numpy as np

from tactilevision.mechanics.tables.blocks import hayes_stiffness, linear_surface
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase


def made_up(case: Case, reach: int = len(DEPTHS)) -> SolvedCase:
    """A smooth stand-in for a solved case: a stiffening that grows with nu, friction and the edge."""
    depth = np.array(DEPTHS)[:reach]
    scale = hayes_stiffness(case.poisson_ratio, case.a_over_h, edge_over_h=case.edge_over_h)
    grip = 1 - 1 / (1 + 4 * case.friction)
    ratio = (1 + 0.02 * grip + case.edge_over_h) * (1 + depth * (case.a_over_h + case.poisson_ratio))
    excess = np.multiply.outer(0.05 * (1 + depth) * (1 + grip), np.exp(-np.array(BESIDE)))
    rise, outward = linear_surface(case)
    ended = "" if reach == len(DEPTHS) else "the surface folds"
    return SolvedCase(depth, scale * ratio, outward - excess, rise + excess, float(depth[-1]), ended)
