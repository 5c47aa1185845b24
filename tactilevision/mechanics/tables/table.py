"""The table in memory and on disk: blocks of one law, friction and edge radius, and weights between them.

    P/(E w h) = S(nu, a/h, w/h; law, mu, edge) x Hayes' for the flat part of the face

S is a spline in nu, a/h and depth, a monotone cubic from one friction to the next (friction.py), and straight in
the edge radius, from two tabulated radii on to the sharp limit. What lies in a cell of the grid that was not
solved is not known.
"""

from __future__ import annotations

import hashlib
import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.door.arrays import read_arrays
from tactilevision.door.documents import read_json
from tactilevision.door.opening import read_bytes
from tactilevision.errors import InputError
from tactilevision.files import replacing, write_json
from tactilevision.mechanics.tables.blocks import Block
from tactilevision.mechanics.tables.build import on_one_grid
from tactilevision.mechanics.tables.friction import ROUNDING, Neighbours, neighbours
from tactilevision.mechanics.tables.grid import Axes, HoledSpline, fit_grid
from tactilevision.records import Bools, Floats

SHIPPED = Path(__file__).with_name("punch.npz")
EDGE_TOLERANCE = 0.1  # a table of one edge radius serves others as near as this
Mixture = tuple[tuple[float, Neighbours], ...]  # weights of edges, that add up to 1, and their blocks


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """All blocks on one grid, and the card: source, settings, errors, hash, date."""

    blocks: tuple[Block, ...]
    card: dict[str, Any] = field(default_factory=dict)

    @property
    def axes(self) -> Axes:
        """The grid."""
        return self.blocks[0].axes

    def mixture(self, law: str, friction: float, *, edge_over_h: float) -> Mixture:
        """The blocks that surround a friction and an edge radius, with their weights.

        Raises InputError, with what there is, for another law or a larger edge radius than the tabulated ones.
        """
        mine = {(block.edge_over_h, block.friction): block for block in self.blocks if block.law == law}
        if not mine:
            raise _absent("law", law, sorted({block.law for block in self.blocks}))
        frictions = {edge: sorted(mu for other, mu in mine if other == edge) for edge, _ in mine}
        edges = sorted(edge for edge, there in frictions.items() if there[0] <= friction <= there[-1])
        if not edges:
            raise _absent("friction", friction, sorted({mu for _, mu in mine}))
        alone = len(edges) == 1  # Hayes' stiffness of the flat part still follows the edge that is asked for
        near = (
            abs(edge_over_h / edges[0] - 1) <= EDGE_TOLERANCE if alone else edge_over_h <= edges[-1] * (1 + 1e-9)
        )
        if not (near and edge_over_h >= 0):
            raise _absent("edge radius over thickness", edge_over_h, edges)
        rows = {edge: [block for (other, _), block in mine.items() if other == edge] for edge in edges}
        return tuple(
            (weight, neighbours(rows[edge], friction)) for edge, weight in straight(edges, edges, at=edge_over_h)
        )


def stiffness_ratio(mixture: Mixture, places: Floats) -> tuple[Floats, Bools]:
    """S (N,) at stretched places (N, 3) of the grid, and where it is known."""
    return _mixed(mixture, _stiffness, places)


def surface_excess(mixture: Mixture, places: Floats) -> tuple[Floats, Bools]:
    """Rise and u_r over w (N, 2, places beside the punch) beyond linear theory's, and where it is known (N,)."""
    return _mixed(mixture, _surface, places)


def reach(mixture: Mixture, poisson_ratio: float, *, a_over_h: float) -> float:
    """The greatest w/h that all blocks know here; 0 off the grid."""
    return min(_stiffness(block).reach(poisson_ratio, a_over_h) for _, near in mixture for block in near.about)


@lru_cache(maxsize=1)
def shipped_table() -> Table:
    """The table that comes with the library. Raises InputError where it is not what its card says."""
    return read_table(SHIPPED)


def read_table(path: Path) -> Table:
    """Read PATH and the card beside it, and check one against the other."""
    card = read_json(path.with_suffix(".json"))
    if hashlib.sha256(read_bytes(path)).hexdigest() != card.get("sha256"):
        raise InputError(
            "the table is not the one that its card describes",
            where=path,
            remedy="Install the package again, or tabulate anew.",
        )
    data = read_arrays(path)
    own = [_block(about, data, number) for number, about in enumerate(card["blocks"])]
    return Table(tuple(on_one_grid(own)), card)


def write_table(path: Path, blocks: Sequence[Block], *, notes: dict[str, Any]) -> None:
    """Write PATH (.npz), every block at its own nodes, and its card (.json); `notes` go into the card."""
    arrays: dict[str, Any] = {}
    for number, block in enumerate(blocks):
        arrays[f"poisson_ratios_{number}"] = block.axes.poisson_ratios
        arrays[f"a_over_h_{number}"] = block.axes.a_over_h
        arrays[f"depths_{number}"] = block.axes.depths
        arrays[f"stiffness_{number}"] = block.stiffness.astype(np.float32)
        arrays[f"surface_{number}"] = block.surface.astype(np.float16)
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)
    content = {
        "blocks": [_about(block) for block in blocks],
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }
    write_json(path.with_suffix(".json"), notes | content)


@lru_cache(maxsize=64)
def _stiffness(block: Block) -> HoledSpline:
    return fit_grid(block.axes, block.stiffness)


@lru_cache(maxsize=64)
def _surface(block: Block) -> HoledSpline:
    return fit_grid(block.axes, block.surface)


def _mixed(mixture: Mixture, spline: Callable[[Block], HoledSpline], places: Floats) -> tuple[Floats, Bools]:
    values = sum(weight * near.blend([spline(block)(places) for block in near.blocks]) for weight, near in mixture)
    known = np.all([spline(block).inside(places) for _, near in mixture for block in near.about], axis=0)
    return np.asarray(values), np.asarray(known)


def straight(names: Sequence[float], places: Sequence[float], *, at: float) -> list[tuple[float, float]]:
    """(name, weight) of the two of `names`, at ascending `places`, between which `at` lies, or beyond which."""
    if len(places) == 1:
        return [(names[0], 1.0)]
    low = min(max(bisect_right(places, at) - 1, 0), len(places) - 2)
    share = (at - places[low]) / (places[low + 1] - places[low])
    pair = (names[low], 1 - share), (names[low + 1], share)
    return [(name, weight) for name, weight in pair if abs(weight) > ROUNDING]


def _absent(what: str, value: object, there: Sequence[object]) -> InputError:
    return InputError(
        f"the table holds no such {what}",
        where="punch table",
        value=value,
        remedy=f"It holds {', '.join(map(str, there))}; solve others with punch_fem.",
    )


def _block(about: dict[str, Any], data: Mapping[str, Any], number: int) -> Block:
    return Block(
        law=about["law"],
        friction=math.inf if about["friction"] is None else float(about["friction"]),
        edge_over_h=about["edge_over_h"],
        axes=Axes(*(data[f"{name}_{number}"] for name in ("poisson_ratios", "a_over_h", "depths"))),
        stiffness=data[f"stiffness_{number}"].astype(float),
        surface=data[f"surface_{number}"].astype(float),
        nodes=about["solved_nodes"],
        deepened=about["deepened_nodes"],
    )


def _about(block: Block) -> dict[str, Any]:
    reached = np.isfinite(block.stiffness).sum(axis=-1) - 1
    return {
        "law": block.law,
        "friction": None if math.isinf(block.friction) else block.friction,
        "edge_over_h": block.edge_over_h,
        "solved_nodes": block.nodes,
        "deepened_nodes": block.deepened,
        "least_reach": float(block.axes.depths[reached.min()]),
        "greatest_reach": float(block.axes.depths[reached.max()]),
    }
