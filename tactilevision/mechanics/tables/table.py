"""Read, interpolate and write the finite-element table of the flat punch."""

from __future__ import annotations

import csv
import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.arrays import load_table, save_table
from tactilevision.files.writing import replacing
from tactilevision.mechanics.flat_contact import friction_place
from tactilevision.mechanics.tables.blocks import Block, Key, Solved, build_blocks, on_one_grid
from tactilevision.mechanics.tables.cases import Case, SolvedCase, case_path, load_case
from tactilevision.mechanics.tables.grid import Axes, HoledSpline, fit_grid
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Bools, Floats

# Interpolation in friction: a monotone cubic in mu/(mu + 3). The effect of friction is proportional to mu up to a
# mu of .1 to .3, where the whole face sticks. The monotone cubic does not overshoot there, as another does by .9 %
# of the force. Source: Fritsch, Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300.


@dataclass(frozen=True, slots=True)
class Neighbours:
    """Blocks around a friction: the one of a tabulated friction, else at most two on either side, at ascending
    `places`; the friction is at `at`, between the two of `about`."""

    blocks: tuple[Block, ...]
    places: tuple[float, ...] = (0.0,)
    at: float = 0.0

    @property
    def about(self) -> tuple[Block, ...]:
        """The block itself, or the next on either side, which must be known."""
        low = _interval(self.places, self.at)
        return self.blocks[low : low + 2]

    def blend(self, values: Sequence[Floats]) -> Floats:
        """Interpolate between the blocks' `values`."""
        from scipy.interpolate import PchipInterpolator

        return values[0] if len(values) == 1 else np.asarray(PchipInterpolator(self.places, values)(self.at))


def neighbours(blocks: Sequence[Block], friction: float) -> Neighbours:
    """Return those of `blocks`, alike but for their frictions, that enclose `friction`, which is among theirs."""
    ordered = sorted(blocks, key=lambda block: block.friction)
    places = [friction_place(block.friction) for block in ordered]
    at = friction_place(friction)
    for block, place in zip(ordered, places, strict=True):
        if abs(at - place) < ROUNDING:
            return Neighbours((block,))
    low = _interval(places, at)
    near = slice(max(low - 1, 0), low + 3)
    return Neighbours(tuple(ordered[near]), tuple(places[near]), at)


def _interval(places: Sequence[float], at: float) -> int:
    return min(max(bisect_right(places, at) - 1, 0), max(len(places) - 2, 0))


# The table: blocks of one law, friction and edge radius, and weights between them.
#
#     P/(E w h) = S(nu, a/h, w/h; law, mu, edge) x Hayes' for the flat part of the face
#
# S is a spline in nu, a/h and depth, a monotone cubic in friction, and linear in the edge radius, also on to the
# sharp limit. Cells of the grid that were not solved are unknown.

AXES = "poisson_ratios", "a_over_h", "depths"  # nodes of a block
SHIPPED = Path(__file__).with_name("punch.npz")
EDGE_TOLERANCE = 0.1  # relative difference of edge radii that a table of one radius allows
Quantity = Literal["stiffness", "surface"]
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
        """Return the blocks that surround a friction and an edge radius, with their weights.

        Raises InputError, naming those available, for another law or a larger edge radius than the tabulated ones.
        """
        mine = {(block.edge_over_h, block.friction): block for block in self.blocks if block.law == law}
        if not mine:
            raise _absent("law", law, sorted({block.law for block in self.blocks}))
        frictions = {edge: sorted(mu for other, mu in mine if other == edge) for edge, _ in mine}
        edges = sorted(edge for edge, there in frictions.items() if there[0] <= friction <= there[-1])
        if not edges:
            raise _absent("friction", friction, sorted({mu for _, mu in mine}))
        if len(edges) == 1:  # Hayes' stiffness of the flat part still depends on the edge asked for
            near = abs(edge_over_h / edges[0] - 1) <= EDGE_TOLERANCE
        else:
            near = edge_over_h <= edges[-1] * (1 + ROUNDING)
        if not (near and edge_over_h >= 0):
            raise _absent("edge radius over thickness", edge_over_h, edges)
        rows = {edge: [block for (other, _), block in mine.items() if other == edge] for edge in edges}
        return tuple(
            (weight, neighbours(rows[edge], friction)) for edge, weight in straight(edges, at=edge_over_h)
        )


def mixed(mixture: Mixture, what: Quantity, places: Floats) -> tuple[Floats, Bools]:
    """Return a quantity (N, ...) at stretched places (N, 3) of the grid, and where it is known (N,).

    "stiffness" is S; "surface" rise and u_r over w (2, places outside the punch) beyond linear theory's.
    """
    known = np.all([_spline(block, what).inside(places) for _, near in mixture for block in near.about], axis=0)
    return blended(mixture, what, places), np.asarray(known)


def blended(mixture: Mixture, what: Quantity, places: Floats) -> Floats:
    """Return a quantity (N, ...) as `mixed`, continued where it is not known."""
    values = [
        weight * near.blend([_spline(block, what)(places) for block in near.blocks]) for weight, near in mixture
    ]
    return np.asarray(np.sum(values, axis=0))


def reach(mixture: Mixture, poisson_ratio: float, *, a_over_h: float) -> float:
    """Return the greatest w/h that all blocks know here; 0 off the grid."""
    return min(
        _spline(block, "stiffness").reach(poisson_ratio, a_over_h) for _, near in mixture for block in near.about
    )


@lru_cache(maxsize=1)
def shipped_table() -> Table:
    """Return the table that comes with the library. Raises InputError if it differs from its card."""
    return read_table(SHIPPED)


def read_table(path: Path) -> Table:
    """Read PATH and check it by the card next to it."""
    data, card = load_table(path)
    own = [_block(about, data, number) for number, about in enumerate(card["blocks"])]
    return Table(tuple(on_one_grid(own)), card)


def write_blocks(path: Path, blocks: Sequence[Block], *, notes: dict[str, Any]) -> None:
    """Write PATH (.npz), every block at its own nodes, and its card (.json); `notes` go into the card."""
    arrays: dict[str, Any] = {}
    for number, block in enumerate(blocks):
        arrays |= {f"{name}_{number}": getattr(block.axes, name) for name in AXES}
        arrays[f"stiffness_{number}"] = block.stiffness.astype(np.float32)
        arrays[f"surface_{number}"] = block.surface.astype(np.float16)
    save_table(path, {**notes, "blocks": [_about(block) for block in blocks]}, **arrays)


@lru_cache(maxsize=128)
def _spline(block: Block, what: Quantity) -> HoledSpline:
    return fit_grid(block.axes, getattr(block, what))


def straight(places: Sequence[float], *, at: float) -> list[tuple[float, float]]:
    """Return (place, weight) of the two of ascending `places` between or beyond which `at` lies."""
    if len(places) == 1:
        return [(places[0], 1.0)]
    low = _interval(places, at)
    share = (at - places[low]) / (places[low + 1] - places[low])
    pair = (places[low], 1 - share), (places[low + 1], share)
    return [(place, weight) for place, weight in pair if abs(weight) > ROUNDING]


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
        axes=Axes(*(data[f"{name}_{number}"] for name in AXES)),
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


COLUMNS = "law", "friction", "edge_over_h", "poisson_ratio", "a_over_h", "to_w_over_h", "no_fold_to", "ended"


def merge(cases: Iterable[Case], folder: Path | str, *, out: Path | str, notes: dict[str, Any]) -> list[str]:
    """Write complete blocks into `out` (.npz), with card (.json) and cases (.csv: how deep each got, and why no
    deeper).

    Returns the names of the missing cases. `notes` go into the card: solver settings, errors and more. Raises
    InputError if no block is complete.
    """
    blocks: dict[Key, list[Case]] = defaultdict(list)
    for case in cases:
        blocks[case.law, case.friction, case.edge_over_h].append(case)
    place, missing = Path(folder), []
    solved: dict[Case, SolvedCase] = {}
    for members in blocks.values():
        unsolved = [case.name for case in members if not case_path(place, case).exists()]
        missing += unsolved
        if not unsolved:
            solved |= {case: load_case(case_path(place, case)) for case in members}
    if not solved:
        raise InputError(
            "no block of the table is complete",
            where=folder,
            value=f"{len(missing)} cases missing",
            remedy="Run tabulate longer.",
        )
    card = {
        "what": "P/(E w h) of a flat punch over Hayes' for its flat part, and the surface around it over w beyond "
        "linear theory's; friction null: no slip",
        "source": "tactilevision.mechanics.punch_fem, made by tactilevision tabulate",
        "date": date.today().isoformat(),
    }
    write_blocks(Path(out), build_blocks(solved), notes=card | notes)
    _write_cases(Path(out).with_suffix(".csv"), solved)
    return missing


def _write_cases(path: Path, solved: Solved) -> None:
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(COLUMNS)
        for case, found in solved.items():
            friction = "no slip" if math.isinf(case.friction) else f"{case.friction:g}"
            about = [case.law, friction, f"{case.edge_over_h:.6g}", case.poisson_ratio, case.a_over_h]
            rows.writerow([*about, f"{found.depth.max(initial=0.0):g}", f"{found.sound:g}", found.ended])
