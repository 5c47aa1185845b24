"""From a work folder of solved cases to the one table that is shipped, with its card and the list of its cases."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable
from datetime import date
from pathlib import Path
from typing import Any

from tactilevision.errors import InputError
from tactilevision.files import replacing
from tactilevision.mechanics.tables.blocks import Key, Solved
from tactilevision.mechanics.tables.build import build_blocks
from tactilevision.mechanics.tables.cases import Case, SolvedCase, case_path, load_case
from tactilevision.mechanics.tables.table import write_table

COLUMNS = "law", "friction", "edge_over_h", "poisson_ratio", "a_over_h", "to_w_over_h", "no_fold_to", "ended"


def merge(cases: Iterable[Case], folder: Path | str, *, out: Path | str, notes: dict[str, Any]) -> list[str]:
    """Put every block of which all cases are solved into `out` (.npz), with its card (.json) and its cases (.csv:
    how deep each got, and why no deeper); returns the names of the cases that are missing.

    `notes` go into the card: solver settings, errors and what else is to be known. Raises InputError where no
    block is whole.
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
            "no block of the table is solved to the end",
            where=folder,
            value=f"{len(missing)} cases missing",
            remedy="Run tabulate longer.",
        )
    card = {
        "what": "P/(E w h) of a flat punch over Hayes' for its flat part, and the surface beside it over w beyond "
        "linear theory's; friction null: no slip",
        "source": "tactilevision.mechanics.punch_fem, made by tactilevision tabulate",
        "date": date.today().isoformat(),
    }
    write_table(Path(out), build_blocks(solved), notes=card | notes)
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
