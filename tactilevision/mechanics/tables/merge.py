"""From a work folder of solved cases to the one table that is shipped, with its card."""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Iterable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import replacing, write_json
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase, case_path, load_case
from tactilevision.mechanics.tables.table import ARRAYS, Block, hayes_stiffness


def merge(cases: Iterable[Case], folder: Path | str, out: Path | str, *, notes: dict[str, Any]) -> list[str]:
    """Put every block of which all cases are solved into `out` (.npz) and its card; returns the names of the rest.

    `notes` go into the card: solver settings, mesh error and what else is to be known. Raises InputError where no
    block is whole.
    """
    blocks: dict[tuple[str, float, float, float], list[Case]] = defaultdict(list)
    for case in cases:
        blocks[case.block].append(case)
    place, whole, missing = Path(folder), [], []
    for members in blocks.values():
        unsolved = [case.name for case in members if not case_path(place, case).exists()]
        missing += unsolved
        if not unsolved:
            whole.append(_whole(members, [load_case(case_path(place, case)) for case in members]))
    if not whole:
        raise InputError("no block of the table is solved to the end", where=folder,
                         value=f"{len(missing)} cases missing", remedy="Run tabulate longer.")  # fmt: skip
    _write(Path(out), whole, notes)
    return missing


def _whole(members: list[Case], solved: list[SolvedCase]) -> Block:
    nus = sorted({case.poisson_ratio for case in members})
    alphas = sorted({case.a_over_h for case in members})
    shape = (len(nus), len(alphas), len(DEPTHS))
    stiffness = np.full(shape, np.nan)
    u_r, u_z = (np.full((*shape, len(BESIDE)), np.nan) for _ in range(2))
    for case, found in zip(members, solved, strict=True):
        at = nus.index(case.poisson_ratio), alphas.index(case.a_over_h)
        reached = len(found.depth)
        scale = hayes_stiffness(case.poisson_ratio, case.a_over_h, case.edge_over_h)
        stiffness[at][:reached] = found.force / scale
        u_r[at][:reached], u_z[at][:reached] = found.u_r, found.u_z
    law, friction, edge, pad = members[0].block
    return Block(
        law=law,
        friction=friction,
        edge_over_h=edge,
        pad_over_h=pad,
        poisson_ratios=np.array(nus),
        a_over_h=np.array(alphas),
        depths=np.array(DEPTHS),
        beside=np.array(BESIDE),
        stiffness=stiffness,
        u_r=u_r,
        u_z=u_z,
    )


def _write(out: Path, blocks: list[Block], notes: dict[str, Any]) -> None:
    arrays = {
        f"{key}_{number}": np.asarray(getattr(block, key), np.float64 if key in ARRAYS[:4] else np.float32)
        for number, block in enumerate(blocks)
        for key in ARRAYS
    }
    with replacing(out) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)
    about = [
        {
            "law": block.law,
            "friction": None if math.isinf(block.friction) else block.friction,
            "edge_over_h": block.edge_over_h,
            "pad_over_h": block.pad_over_h,
            "cases": int(block.stiffness[..., 0].size),
            "reach_all": float(block.depths[np.isfinite(block.stiffness).all(axis=(0, 1))].max()),
        }
        for block in blocks
    ]
    card = {
        "what": "P/w of a flat punch over Hayes' for its flat part; u/w beside it; friction null: no slip",
        "source": "tactilevision.mechanics.punch_fem, made by tactilevision tabulate",
        "date": date.today().isoformat(),
        "blocks": about,
        "sha256": hashlib.sha256(out.read_bytes()).hexdigest(),
    }
    write_json(out.with_suffix(".json"), card | notes)
