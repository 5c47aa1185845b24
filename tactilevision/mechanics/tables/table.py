"""The table in memory and on disk: blocks of one law, friction and edge radius, and weights between them.

    P/(E w h) = S(nu, a/h, w/h; law, mu, edge) x Hayes' for the flat part of the face

S is a spline in nu, a/h and depth, cubic in mu/(mu + 1/4) and straight in (edge radius/h)^EDGE_POWER, from two
tabulated radii on to the sharp limit. What lies in a cell of the grid that was not solved is not known.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import replacing, write_json
from tactilevision.mechanics.tables.blocks import Block
from tactilevision.mechanics.tables.grid import Axes, HoledSpline, fit_grid
from tactilevision.mechanics.tables.local import cubic_weights
from tactilevision.records import Bools, Floats

SHIPPED = Path(__file__).with_name("punch.npz")
HALF_FRICTION = 0.25  # the friction that has half of the effect
EDGE_POWER = 1.0
EDGE_TOLERANCE = 0.1  # a table of one edge radius serves others as near as this
ROUNDING = 1e-9  # a weight as small is a node that is met but for rounding, and must not lend its reach
Mixture = tuple[tuple[float, Block], ...]  # weights that add up to 1, and their blocks


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """All blocks on one grid, and the card: source, settings, errors, hash, date."""

    blocks: tuple[Block, ...]
    card: dict[str, Any] = field(default_factory=dict)

    @property
    def axes(self) -> Axes:
        """The grid."""
        return self.blocks[0].axes

    def mixture(self, law: str, friction: float, edge_over_h: float) -> Mixture:
        """The blocks that surround a friction and an edge radius, with their weights.

        Raises InputError, with what there is, for another law or a larger edge radius than the tabulated ones.
        """
        mine = {(block.friction, block.edge_over_h): block for block in self.blocks if block.law == law}
        if not mine:
            raise _absent("law", law, sorted({block.law for block in self.blocks}))
        frictions, edges = (sorted({key[k] for key in mine}) for k in range(2))
        if not frictions[0] <= friction <= frictions[-1]:
            raise _absent("friction", friction, frictions)
        alone = len(edges) == 1  # Hayes' stiffness of the flat part still follows the edge that is asked for
        near = (
            abs(edge_over_h / edges[0] - 1) <= EDGE_TOLERANCE if alone else edge_over_h <= edges[-1] * (1 + 1e-9)
        )
        if not (near and edge_over_h >= 0):
            raise _absent("edge radius over thickness", edge_over_h, edges)
        by_friction = _weights([_friction_place(mu) for mu in frictions], _friction_place(friction))
        by_edge = _weights([edge**EDGE_POWER for edge in edges], edge_over_h**EDGE_POWER)
        weights = {
            (mu, edge): float(p * q)
            for p, mu in zip(by_friction, frictions, strict=True)
            for q, edge in zip(by_edge, edges, strict=True)
            if abs(p * q) > ROUNDING
        }
        if not weights.keys() <= mine.keys():
            raise _absent("friction at this edge radius", (friction, edge_over_h), sorted(mine))
        return tuple((weight, mine[key]) for key, weight in weights.items())


def stiffness_ratio(mixture: Mixture, places: Floats) -> tuple[Floats, Bools]:
    """S (N,) at stretched places (N, 3) of the grid, and where it is known."""
    return _mixed(mixture, [_stiffness(block) for _, block in mixture], places)


def surface_excess(mixture: Mixture, places: Floats) -> tuple[Floats, Bools]:
    """Rise and u_r over w (N, 2, places beside the punch) beyond linear theory's, and where it is known (N,)."""
    return _mixed(mixture, [_surface(block) for _, block in mixture], places)


def reach(mixture: Mixture, poisson_ratio: float, a_over_h: float) -> float:
    """The greatest w/h that all blocks know here; 0 off the grid."""
    return min(_stiffness(block).reach(poisson_ratio, a_over_h) for _, block in mixture)


@lru_cache(maxsize=1)
def shipped_table() -> Table:
    """The table that comes with the library. Raises InputError where it is not what its card says."""
    return read_table(SHIPPED)


def read_table(path: Path) -> Table:
    """Read PATH and the card beside it, and check one against the other."""
    card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    if hashlib.sha256(path.read_bytes()).hexdigest() != card["sha256"]:
        raise InputError("the table is not the one that its card describes", where=path,
                         remedy="Install the package again, or tabulate anew.")  # fmt: skip
    with np.load(path, allow_pickle=False) as data:
        axes = Axes(data["poisson_ratios"], data["a_over_h"], data["depths"])
        values = [(data[f"stiffness_{k}"].astype(float), data[f"surface_{k}"].astype(float))
                  for k in range(len(card["blocks"]))]  # fmt: skip
    return Table(
        tuple(_block(about, axes, *pair) for about, pair in zip(card["blocks"], values, strict=True)), card
    )


def write_table(path: Path, blocks: Sequence[Block], notes: dict[str, Any]) -> None:
    """Write PATH (.npz) and its card (.json); `notes` go into the card."""
    axes = blocks[0].axes
    arrays: dict[str, Any] = {
        "poisson_ratios": axes.poisson_ratios, "a_over_h": axes.a_over_h, "depths": axes.depths,
    }  # fmt: skip
    for number, block in enumerate(blocks):
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


def _mixed(mixture: Mixture, splines: Sequence[HoledSpline], places: Floats) -> tuple[Floats, Bools]:
    values = sum(weight * spline(places) for (weight, _), spline in zip(mixture, splines, strict=True))
    known = np.all([spline.inside(places) for spline in splines], axis=0)
    return np.asarray(values), np.asarray(known)


def _weights(nodes: Sequence[float], at: float) -> Floats:
    return cubic_weights(np.array(nodes), np.array([at]))[0] if len(nodes) > 1 else np.ones(1)


def _friction_place(friction: float) -> float:
    """mu -> [0, 1), no slip -> 1: what friction does is smooth in this."""
    return 1.0 if math.isinf(friction) else friction / (friction + HALF_FRICTION)


def _absent(what: str, value: object, there: Sequence[object]) -> InputError:
    return InputError(f"the table holds no such {what}", where="punch table", value=value,
                      remedy=f"It holds {', '.join(map(str, there))}; solve others with punch_fem.")  # fmt: skip


def _block(about: dict[str, Any], axes: Axes, stiffness: Floats, surface: Floats) -> Block:
    friction = math.inf if about["friction"] is None else float(about["friction"])
    return Block(about["law"], friction, about["edge_over_h"], axes, stiffness, surface, about["solved_nodes"])


def _about(block: Block) -> dict[str, Any]:
    reached = np.isfinite(block.stiffness).sum(axis=-1) - 1
    return {
        "law": block.law,
        "friction": None if math.isinf(block.friction) else block.friction,
        "edge_over_h": block.edge_over_h,
        "solved_nodes": block.nodes,
        "least_reach": float(block.axes.depths[reached.min()]),
        "greatest_reach": float(block.axes.depths[reached.max()]),
    }
