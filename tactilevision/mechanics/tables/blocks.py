"""From solved cases to a block: one law, friction and edge on a grid of nu, a/h and depth.

What is kept varies little: P/w over Hayes' for the flat part of the face, and the surface beside the punch minus
linear theory's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.profile import exact_profile
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase
from tactilevision.mechanics.tables.grid import Axes
from tactilevision.records import Floats

Key = tuple[str, float, float]  # law, friction, edge radius over h
Solved = Mapping[Case, SolvedCase]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """`stiffness` (nu, a/h, depth) is P/(E w h) over Hayes'; `surface` (nu, a/h, depth, 2, place) rise and u_r
    over w, beyond linear theory's; NaN where the solver did not get. `nodes`: how many (nu, a/h) were solved;
    `deepened`: how many of them a blunter edge continues."""

    law: str
    friction: float
    edge_over_h: float
    axes: Axes
    stiffness: Floats
    surface: Floats
    nodes: int
    deepened: int = 0

    @property
    def key(self) -> Key:
        """What tells it from others."""
        return self.law, self.friction, self.edge_over_h


def hayes_stiffness(poisson_ratio: float, a_over_h: float, *, edge_over_h: float) -> float:
    """P/(E w h) of the flat part of the face, frictionless, w -> 0: 2 alpha kappa(nu, alpha) / (1 - nu^2)."""
    flat = a_over_h - edge_over_h
    return float(2 * flat * fast_kappa(poisson_ratio, flat) / (1 - poisson_ratio**2))


def own_block(key: Key, solved: Solved) -> Block:
    """The block at the nodes that were solved."""
    mine = {c: s for c, s in solved.items() if (c.law, c.friction, c.edge_over_h) == key}
    nus, alphas = (sorted({getattr(c, name) for c in mine}) for name in ("poisson_ratio", "a_over_h"))
    if len(mine) != len(nus) * len(alphas):
        raise InputError("a block of the table has gaps", where="tabulate", value=key, remedy="Tabulate longer.")
    shape = (len(nus), len(alphas), len(DEPTHS))
    stiffness, surface = np.full(shape, np.nan), np.full((*shape, 2, len(BESIDE)), np.nan)
    for case, found in mine.items():
        at = nus.index(case.poisson_ratio), alphas.index(case.a_over_h)
        reached = len(found.depth)
        scale = hayes_stiffness(case.poisson_ratio, case.a_over_h, edge_over_h=case.edge_over_h)
        stiffness[at][:reached] = found.force / scale
        surface[at][:reached] = np.stack([found.u_z, found.u_r], axis=1) - linear_surface(case)
    axes = Axes(np.array(nus), np.array(alphas), np.array(DEPTHS))
    return Block(*key, axes, stiffness, surface, len(mine))


def linear_surface(case: Case) -> Floats:
    """Rise and u_r (2, places) over w, a ratio, by linear theory, where the table has places."""
    r_over_a = 1 + np.array(BESIDE) / case.a_over_h
    return np.stack(exact_profile(r_over_a, case.poisson_ratio, a_over_h=case.a_over_h))
