"""From solved cases to blocks: one law, friction and edge each, on one grid of nu, a/h and depth.

What is kept varies little: P/w over Hayes' for the flat part of the face, and the surface beside the punch minus
linear theory's. A block that was solved at few nodes only is carried to all of them by what it differs in from a
relative that was solved at more (a ratio of forces, a difference of surfaces), which is smoother still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.profile import exact_profile
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase
from tactilevision.mechanics.tables.grid import Axes, continued, inside_cells, solved_nodes
from tactilevision.records import Floats

Key = tuple[str, float, float]  # law, friction, edge radius over h
Solved = Mapping[Case, SolvedCase]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """`stiffness` (nu, a/h, depth) is P/(E w h) over Hayes'; `surface` (nu, a/h, depth, 2, place) rise and u_r
    over w, beyond linear theory's; NaN where the solver did not get. `nodes`: how many (nu, a/h) were solved."""

    law: str
    friction: float
    edge_over_h: float
    axes: Axes
    stiffness: Floats
    surface: Floats
    nodes: int

    @property
    def key(self) -> Key:
        """What tells it from others."""
        return self.law, self.friction, self.edge_over_h


def hayes_stiffness(poisson_ratio: float, a_over_h: float, edge_over_h: float) -> float:
    """P/(E w h) of the flat part of the face, frictionless, w -> 0: 2 alpha kappa(nu, alpha) / (1 - nu^2)."""
    flat = a_over_h - edge_over_h
    return float(2 * flat * fast_kappa(poisson_ratio, flat) / (1 - poisson_ratio**2))


def build_blocks(solved: Solved) -> list[Block]:
    """All blocks of these cases on the finest grid among them. Raises InputError where a block has gaps."""
    keys = list(dict.fromkeys((c.law, c.friction, c.edge_over_h) for c in solved))
    own = {key: _own_block(key, solved) for key in keys}
    finest = max(own.values(), key=lambda block: block.nodes)
    return [_on(finest.axes, block, own) for block in own.values()]


def _own_block(key: Key, solved: Solved) -> Block:
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
        scale = hayes_stiffness(case.poisson_ratio, case.a_over_h, case.edge_over_h)
        stiffness[at][:reached] = found.force / scale
        surface[at][:reached] = np.stack([found.u_z, found.u_r], axis=1) - linear_surface(case)
    axes = Axes(np.array(nus), np.array(alphas), np.array(DEPTHS))
    return Block(*key, axes, stiffness, surface, len(mine))


def linear_surface(case: Case) -> Floats:
    """Rise and u_r (2, places) over w by linear theory, where the table has places."""
    r_over_a = 1 + np.array(BESIDE) / case.a_over_h
    return np.stack(exact_profile(r_over_a, case.poisson_ratio, case.a_over_h))


def relative_of(key: Key, there: Sequence[Key]) -> Key | None:
    """Whose deviations are carried: same but for the edge, then the law, then friction; None: it stands alone."""
    law, friction, edge = key
    sharpest = min(k[2] for k in there)
    usual = "neo-hooke", 0.3
    for relative in ((law, friction, sharpest), ("neo-hooke", friction, edge), (*usual, edge), (*usual, sharpest)):
        if relative != key and relative in there:
            return relative
    return None


def _on(axes: Axes, block: Block, own: Mapping[Key, Block]) -> Block:
    """`block` on all nodes of `axes`."""
    if block.stiffness.shape[:2] == (len(axes.poisson_ratios), len(axes.a_over_h)):
        return block
    key = relative_of(block.key, list(own))
    if key is None:
        raise InputError("a block was solved at few nodes, and none of its kind at more", where="tabulate",
                         value=block.key)  # fmt: skip
    relative = _on(axes, own[key], own)
    rows = _places(block.axes.poisson_ratios, axes.poisson_ratios)
    columns = _places(block.axes.a_over_h, axes.a_over_h)
    ratio = block.stiffness / relative.stiffness[np.ix_(rows, columns)]
    beyond = block.surface - relative.surface[np.ix_(rows, columns)]
    carried = relative.stiffness * _carry(block.axes, ratio, axes)
    return Block(*block.key, axes, carried, relative.surface + _carry(block.axes, beyond, axes), block.nodes)


def _carry(coarse: Axes, values: Floats, fine: Axes) -> Floats:
    """`values` of the coarse nodes at the fine ones; NaN where a coarse neighbour is not known.

    Monotone between nodes: where sliding sets in the ratio bends sharply, and a spline would swing.
    """
    from scipy.interpolate import PchipInterpolator

    found = continued(coarse.depths, values)
    for axis in range(2):
        found = PchipInterpolator(coarse.stretched[axis], found, axis=axis)(fine.stretched[axis])
    places = np.stack(np.meshgrid(*fine.stretched, indexing="ij"), axis=-1).reshape(-1, 3)
    known = inside_cells(coarse, solved_nodes(values), places).reshape(found.shape[:3])
    found[~known] = np.nan
    return np.asarray(found)


def _places(mine: Floats, all_: Floats) -> list[int]:
    """Where coarse nodes stand among the fine ones."""
    found = [int(np.argmin(np.abs(all_ - one))) for one in mine]
    if not np.allclose(all_[found], mine):
        raise InputError("the nodes of a coarse block are not among those of the fine one", where="tabulate",
                         value=mine.tolist())  # fmt: skip
    return found
