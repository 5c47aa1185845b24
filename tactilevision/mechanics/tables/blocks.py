"""Assemble solved cases into blocks on a grid of nu, a/h and depth, and fill their missing nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.profile import exact_profile
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase
from tactilevision.mechanics.tables.grid import Axes, cells_of, continued, inside_cells, solved_nodes
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats

# A block is one law, friction and edge on a grid of nu, a/h and depth, of quantities that vary little: P/w over
# Hayes' for the flat part of the face, and the surface around the punch minus linear theory's.

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
        """Law, friction and edge radius."""
        return self.law, self.friction, self.edge_over_h


def hayes_stiffness(poisson_ratio: float, a_over_h: float, *, edge_over_h: float) -> float:
    """Return P/(E w h) of the flat part of the face, frictionless, w -> 0: 2 alpha kappa(nu, alpha) / (1 -
    nu^2).
    """
    flat = a_over_h - edge_over_h
    return float(2 * flat * fast_kappa(poisson_ratio, flat) / (1 - poisson_ratio**2))


def own_block(key: Key, solved: Solved) -> Block:
    """Return the block at the nodes that were solved."""
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
    """Return the rise and u_r (2, places) over w, a ratio, by linear theory, where the table has places."""
    r_over_a = 1 + np.array(BESIDE) / case.a_over_h
    return np.stack(exact_profile(r_over_a, case.poisson_ratio, a_over_h=case.a_over_h))


# Continuation of a block by one of a blunter edge, which is solved deeper.
#
# The sharper the edge, the sooner the surface folds at it; the deeper the punch, the less its edge matters. With f
# the force of the sharper edge over that of the blunter,
#
#     f(d) - 1 = (f(d0) - 1) (d/d0)^p,   p <= 0,
#
# d0 the sharper one's deepest depth and p from its last two, and the surfaces' difference falls in the same way,
# to FURTHEST d0. Where both edges were solved (h/60 and h/30, neo-Hooke, five frictions, a/h .45 to 1.5, d0 = .1)
# the rms error of the force is .1 to .2 %, the largest .6 %.

SHALLOWEST = 0.055  # w/h that the sharper edge itself must reach
FURTHEST = 2.0  # ratio of edge radii that the correction spans


def deepened(block: Block, blunter: Block) -> Block:
    """Return `block` continued at the nodes of both to where `blunter` (same law and friction) is known."""
    depths = block.axes.depths
    stiffness, surface, count = block.stiffness.copy(), block.surface.copy(), 0
    for i, nu in enumerate(block.axes.poisson_ratios):
        for j, alpha in enumerate(block.axes.a_over_h):
            there = node_of(blunter, nu, a_over_h=alpha)
            last = int(np.isfinite(stiffness[i, j]).sum()) - 1
            if there is None or not SHALLOWEST <= depths[max(last, 0)] < depths[-1]:
                continue
            far = int(np.searchsorted(depths, FURTHEST * depths[last] * (1 + ROUNDING)))
            flat = [hayes_stiffness(nu, alpha, edge_over_h=one.edge_over_h) for one in (blunter, block)]
            other, its_surface = blunter.stiffness[there] * flat[0] / flat[1], blunter.surface[there]
            more = stiffness[i, j] / other - 1
            fade = fading(depths, more, last=last)
            stiffness[i, j, last + 1 : far] = (other * (1 + more[last] * fade))[last + 1 : far]
            difference = np.multiply.outer(fade, surface[i, j, last] - its_surface[last])
            surface[i, j, last + 1 : far] = (its_surface + difference)[last + 1 : far]
            count += 1
    return replace(block, stiffness=stiffness, surface=surface, deepened=count)


def fading(depths: Floats, more: Floats, *, last: int) -> Floats:
    """Return (d/d0)^p from the last two known of `more`, which is f - 1; 1 where it does not fall."""
    falls = more[last - 1] > more[last] > 0
    power = np.log(more[last] / more[last - 1]) / np.log(depths[last] / depths[last - 1]) if falls else 0.0
    return np.asarray((depths / depths[last]) ** power)


def node_of(block: Block, poisson_ratio: float, *, a_over_h: float) -> tuple[int, int] | None:
    """Return a node's place in `block`; None if it was not solved there."""
    rows = np.flatnonzero(np.isclose(block.axes.poisson_ratios, poisson_ratio))
    columns = np.flatnonzero(np.isclose(block.axes.a_over_h, a_over_h))
    return (int(rows[0]), int(columns[0])) if rows.size and columns.size else None


# All blocks of a table. A block solved at few nodes is interpolated to all of them by its deviation from a
# relative solved at more (a ratio of forces, a difference of surfaces), which is smoother.


def build_blocks(solved: Solved) -> list[Block]:
    """Return a block of each law, friction and edge of these cases, at the nodes where it was solved, as deep as
    its own cases and those of a blunter edge go. Raises InputError where a block has gaps.
    """
    keys = dict.fromkeys((case.law, case.friction, case.edge_over_h) for case in solved)
    own = {key: own_block(key, solved) for key in keys}
    for key in sorted(own, key=lambda key: -key[2]):  # the bluntest first, which continues the next sharper one
        blunter = min((other for other in own if other[:2] == key[:2] and other[2] > key[2]), default=None)
        own[key] = own[key] if blunter is None else deepened(own[key], own[blunter])
    return list(own.values())


def on_one_grid(blocks: Sequence[Block]) -> list[Block]:
    """Interpolate all blocks to the finest grid among them.

    Raises InputError for nodes that are not of that grid.
    """
    finest = max(blocks, key=lambda block: block.nodes)
    own = {block.key: block for block in blocks}
    for block in blocks:
        own[block.key] = _on(finest.axes, own[block.key], own)
    return list(own.values())


def relative_of(key: Key, there: Sequence[Key]) -> Key | None:
    """Return the block whose deviations are carried: same but for the edge, then the law, then friction.

    None: none.
    """
    law, friction, edge = key
    sharpest = min(k[2] for k in there)
    usual = "neo-hooke", 0.3
    for relative in ((law, friction, sharpest), ("neo-hooke", friction, edge), (*usual, edge), (*usual, sharpest)):
        if relative != key and relative in there:
            return relative
    return None


def _on(axes: Axes, block: Block, own: dict[Key, Block]) -> Block:
    """Return `block` on all nodes of `axes`; its relatives in `own` stay there on all of them."""
    if block.stiffness.shape[:2] == (len(axes.poisson_ratios), len(axes.a_over_h)):
        return block
    key = relative_of(block.key, list(own))
    if key is None:
        raise InputError(
            "a block was solved at few nodes, and none of its kind at more", where="tabulate", value=block.key
        )
    relative = own[key] = _on(axes, own[key], own)
    rows = _places(block.axes.poisson_ratios, axes.poisson_ratios)
    columns = _places(block.axes.a_over_h, axes.a_over_h)
    ratio = block.stiffness / relative.stiffness[np.ix_(rows, columns)]
    beyond = block.surface - relative.surface[np.ix_(rows, columns)]
    carried = relative.stiffness * _carry(block.axes, ratio, axes)
    surface = relative.surface + _carry(block.axes, beyond, axes)
    for carry, own_values in ((carried, block.stiffness), (surface, block.surface)):
        carry[np.ix_(rows, columns)] = own_values  # may go deeper than the relative
    return replace(block, axes=axes, stiffness=carried, surface=surface)


def _carry(coarse: Axes, values: Floats, fine: Axes) -> Floats:
    """Return `values` of the coarse nodes at the fine ones; NaN where a coarse neighbour is not known.

    Monotone between nodes: where sliding begins the ratio has a kink, and a spline would oscillate.
    """
    from scipy.interpolate import PchipInterpolator

    found = continued(coarse.depths, values)
    for axis in range(2):
        found = PchipInterpolator(coarse.stretched[axis], found, axis=axis)(fine.stretched[axis])
    places = np.stack(np.meshgrid(*fine.stretched, indexing="ij"), axis=-1).reshape(-1, 3)
    known = inside_cells(coarse, cells_of(solved_nodes(values)), places=places).reshape(found.shape[:3])
    found[~known] = np.nan
    return np.asarray(found)


def _places(mine: Floats, all_: Floats) -> list[int]:
    """Return the places of coarse nodes among the fine ones."""
    found = [int(np.argmin(np.abs(all_ - one))) for one in mine]
    if not np.allclose(all_[found], mine):
        raise InputError(
            "the nodes of a coarse block are not among those of the fine one",
            where="tabulate",
            value=mine.tolist(),
        )
    return found
