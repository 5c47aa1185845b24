"""Reading the table: the punch's force and the surface beside it, interpolated between solved cases.

What is interpolated is P/w over Hayes' P/w for the flat part of the face (radius a - edge), a number near 1, and
u/w; so the steep dependence on nu and a/h is exact. Cubic through the four nearest nodes in nu, a/h, depth and
place. Law, friction, edge and pad radius are those of a solved block: another is refused, never guessed.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.tables.local import cubic_weights
from tactilevision.records import Floats

SHIPPED = Path(__file__).with_name("punch.npz")
EDGE_TOLERANCE = 0.1
PAD_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True)
class Block:
    """One friction, law, edge and pad: axes and values over (nu, a/h, depth), and (..., place) for the profile.

    `stiffness` is P/(E w h) over Hayes'; NaN where the solver did not reach.
    """

    law: str
    friction: float
    edge_over_h: float
    pad_over_h: float
    poisson_ratios: Floats
    a_over_h: Floats
    depths: Floats
    beside: Floats
    stiffness: Floats
    u_r: Floats
    u_z: Floats


@dataclass(frozen=True, slots=True)
class Table:
    """All blocks, and the card: source, settings, errors, hash, date."""

    blocks: tuple[Block, ...]
    card: dict[str, Any]


def hayes_stiffness(poisson_ratio: float, a_over_h: float, edge_over_h: float) -> float:
    """P/(E w h) of the flat part of the face, frictionless, w -> 0: 2 alpha kappa(nu, alpha) / (1 - nu^2)."""
    flat = a_over_h - edge_over_h
    return float(2 * flat * fast_kappa(poisson_ratio, flat) / (1 - poisson_ratio**2))


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
        blocks = tuple(_block(number, about, data) for number, about in enumerate(card["blocks"]))
    return Table(blocks, card)


def find_block(table: Table, *, law: str, friction: float, edge_over_h: float, pad_over_h: float) -> Block:
    """The block solved for these. Pads beyond the solved one count as it; edges within a tenth of it.

    Raises InputError that lists what there is.
    """
    for block in sorted(table.blocks, key=lambda b: -b.pad_over_h):
        same = block.law == law and (block.friction == friction or math.isclose(block.friction, friction))
        near = abs(edge_over_h / block.edge_over_h - 1) <= EDGE_TOLERANCE
        if same and near and pad_over_h >= block.pad_over_h * (1 - PAD_TOLERANCE):
            return block
    there = sorted({(b.law, b.friction, round(b.edge_over_h, 4), b.pad_over_h) for b in table.blocks})
    raise InputError(
        "the table holds no such law, friction, edge radius/h and pad radius/h",
        where="punch table",
        value=(law, friction, round(edge_over_h, 4), round(pad_over_h, 3)),
        remedy=f"It holds {there}; solve others with punch_fem, or tabulate them.",
    )


def stiffness_ratio(block: Block, poisson_ratio: float, a_over_h: float, depths: Floats) -> Floats:
    """P/w over Hayes' (T,) at w/h `depths`; constant below the first depth solved."""
    grid = _between(block, block.stiffness, poisson_ratio, a_over_h)
    return _along(block, grid, np.maximum(depths, block.depths[0]))


def profile_ratio(
    block: Block, poisson_ratio: float, a_over_h: float, depth: float, beside: Floats
) -> tuple[Floats, Floats]:
    """(u_r/w, u_z/w) (B,) at depth w/h and (r - a)/h `beside`."""
    check_inside(beside, block.beside, "(r - a)/h")
    weights = cubic_weights(block.beside, beside)
    deep = np.maximum(np.array([depth]), block.depths[0])
    values = [_between(block, u, poisson_ratio, a_over_h) @ weights.T for u in (block.u_r, block.u_z)]
    return _along(block, values[0], deep)[0], _along(block, values[1], deep)[0]


def check_inside(values: Floats, axis: Floats, name: str) -> None:
    """Raise InputError unless all `values` lie on the axis; nothing is extrapolated."""
    slack = 1e-9 * axis[-1]
    if not (np.isfinite(values).all() and values.min() >= axis[0] - slack and values.max() <= axis[-1] + slack):
        raise InputError(
            f"{name} lies beyond the table, {axis[0]:g} to {axis[-1]:g}",
            where="punch table",
            value=[float(np.min(values)), float(np.max(values))],
            remedy="Solve it with punch_fem.",
        )


def _between(block: Block, values: Floats, poisson_ratio: float, a_over_h: float) -> Floats:
    """`values` (nu, a/h, ...) at one material and punch, by nu and ln(a/h); NaN of far nodes left out."""
    check_inside(np.array([poisson_ratio]), block.poisson_ratios, "Poisson's ratio")
    check_inside(np.array([a_over_h]), block.a_over_h, "a/h")
    along_nu = cubic_weights(block.poisson_ratios, np.array([poisson_ratio]))[0]
    along_a = cubic_weights(np.log(block.a_over_h), np.log([a_over_h]))[0]
    near_nu, near_a = np.flatnonzero(along_nu), np.flatnonzero(along_a)
    weights = np.outer(along_nu[near_nu], along_a[near_a])
    found: Floats = np.tensordot(weights, values[np.ix_(near_nu, near_a)], axes=2)
    return found


def _along(block: Block, values: Floats, depths: Floats) -> Floats:
    """`values` (D, ...) of all depths, at `depths` (T,); refuses depths that a neighbour was not solved at."""
    reached = int(np.isfinite(values.reshape(len(values), -1)).all(axis=1).sum())
    axis = block.depths[:reached]
    check_inside(depths, axis, "for this nu and a/h, depth/thickness")
    found: Floats = np.tensordot(cubic_weights(np.sqrt(axis), np.sqrt(depths)), values[:reached], axes=1)
    return found


def _block(number: int, about: dict[str, Any], data: Any) -> Block:
    arrays = {key: data[f"{key}_{number}"].astype(float) for key in ARRAYS}
    friction = math.inf if about["friction"] is None else float(about["friction"])
    return Block(about["law"], friction, about["edge_over_h"], about["pad_over_h"], **arrays)


ARRAYS = ("poisson_ratios", "a_over_h", "depths", "beside", "stiffness", "u_r", "u_z")
