"""All blocks of a table: gone on with by a blunter edge, and carried to the nodes that they were not solved at.

A block that was solved at few nodes only is carried to all of them by what it differs in from a relative that was
solved at more (a ratio of forces, a difference of surfaces), which is smoother still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.tables.blocks import Block, Key, Solved, own_block
from tactilevision.mechanics.tables.edges import deepened
from tactilevision.mechanics.tables.grid import Axes, continued, inside_cells, solved_nodes
from tactilevision.records import Floats


def build_blocks(solved: Solved) -> list[Block]:
    """A block of each law, friction and edge of these cases, at the nodes where it was solved, as deep as its own
    cases and those of a blunter edge go. Raises InputError where a block has gaps."""
    keys = dict.fromkeys((case.law, case.friction, case.edge_over_h) for case in solved)
    own = {key: own_block(key, solved) for key in keys}
    for key in sorted(own, key=lambda key: -key[2]):  # the bluntest first: the next sharper one goes by it
        blunter = min((other for other in own if other[:2] == key[:2] and other[2] > key[2]), default=None)
        own[key] = own[key] if blunter is None else deepened(own[key], own[blunter])
    return list(own.values())


def on_one_grid(blocks: Sequence[Block]) -> list[Block]:
    """All on the finest grid among them. Raises InputError for nodes that are not of that grid."""
    finest = max(blocks, key=lambda block: block.nodes)
    own = {block.key: block for block in blocks}
    return [_on(finest.axes, block, own) for block in blocks]


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
        raise InputError(
            "a block was solved at few nodes, and none of its kind at more", where="tabulate", value=block.key
        )
    relative = _on(axes, own[key], own)
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
    """`values` of the coarse nodes at the fine ones; NaN where a coarse neighbour is not known.

    Monotone between nodes: where sliding sets in the ratio bends sharply, and a spline would swing.
    """
    from scipy.interpolate import PchipInterpolator

    found = continued(coarse.depths, values)
    for axis in range(2):
        found = PchipInterpolator(coarse.stretched[axis], found, axis=axis)(fine.stretched[axis])
    places = np.stack(np.meshgrid(*fine.stretched, indexing="ij"), axis=-1).reshape(-1, 3)
    known = inside_cells(coarse, solved_nodes(values), places=places).reshape(found.shape[:3])
    found[~known] = np.nan
    return np.asarray(found)


def _places(mine: Floats, all_: Floats) -> list[int]:
    """Where coarse nodes stand among the fine ones."""
    found = [int(np.argmin(np.abs(all_ - one))) for one in mine]
    if not np.allclose(all_[found], mine):
        raise InputError(
            "the nodes of a coarse block are not among those of the fine one",
            where="tabulate",
            value=mine.tolist(),
        )
    return found
