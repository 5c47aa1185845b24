"""One solved punch problem of the table, and its file."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.files.arrays import read_arrays
from tactilevision.files.writing import replacing
from tactilevision.mechanics.flat_contact import WIDE
from tactilevision.records.constants import NU_MAX
from tactilevision.records.measured import Floats

# w/h, nodes of the tables
DEPTHS = (0.002, 0.006, 0.0125, 0.025, 0.04, 0.055, 0.075, *(k / 40 for k in range(4, 11)))
REACH = 3.5  # thicknesses beyond the punch
PLACES = 25  # of the surface around the punch
# (r - a)/h, uniform in the root, in which the edge is smooth
BESIDE = tuple(REACH * (k / (PLACES - 1)) ** 2 for k in range(PLACES))


@dataclass(frozen=True, slots=True, order=True)
class Case:
    """One press in units of the gel's thickness: law by name, nu, a/h, Coulomb's mu (inf: no slip), edge radius
    over h, pad radius over h."""

    law: str
    friction: float
    edge_over_h: float
    pad_over_h: float
    poisson_ratio: float
    a_over_h: float

    @property
    def name(self) -> str:
        """Unique file name, stable over runs."""
        numbers = asdict(self)
        digest = hashlib.sha256(json.dumps({k: str(v) for k, v in numbers.items()}).encode()).hexdigest()[:8]
        return f"{self.law}_mu{self.friction:g}_nu{self.poisson_ratio:g}_a{self.a_over_h:g}_{digest}"


@dataclass(frozen=True, slots=True)
class Grid:
    """A rectangular grid of cases, one block (law, friction, edge, pad) after the other in the order given."""

    laws: tuple[str, ...] = ("neo-hooke", "hencky")
    frictions: tuple[float, ...] = (0.3, math.inf, 0.0, 0.15, 0.6, 0.22, 0.1)
    edges_over_h: tuple[float, ...] = (1 / 60, 1 / 30)
    pads_over_h: tuple[float, ...] = (WIDE,)
    poisson_ratios: tuple[float, ...] = (0.3, 0.37, 0.43, 0.465, 0.487, NU_MAX)
    a_over_h: tuple[float, ...] = (0.2, 0.3, 0.45, 0.67, 1.0, 1.5)

    def cases(self) -> Iterator[Case]:
        """Yield all cases, blocks outermost."""
        blocks = product(self.laws, self.edges_over_h, self.pads_over_h, self.frictions)
        for law, edge, pad, friction in blocks:
            for nu, alpha in product(self.poisson_ratios, self.a_over_h):
                yield Case(law, friction, edge, pad, nu, alpha)


USUAL = Grid()  # the cases of the table that comes with the library


@dataclass(frozen=True, slots=True)
class SolvedCase:
    """`depth` (T,) w/h solved; `force` (T,) P/(E w h); `u_r`, `u_z` (T, B) over w, at (r - a)/h = BESIDE, NaN
    beyond the pad. Beyond `sound` (w/h) the surface is folded at the punch's edge, and meshes agree; `ended` is
    why there is nothing deeper ("": all were solved).
    """

    depth: Floats
    force: Floats
    u_r: Floats
    u_z: Floats
    sound: float
    ended: str


def case_path(folder: Path, case: Case) -> Path:
    """Return the path of a case in a work folder."""
    return folder / f"{case.name}.npz"


def save_case(path: Path, solved: SolvedCase) -> None:
    """Write one case, whole or not at all."""
    with replacing(path) as temporary:
        np.savez(temporary, allow_pickle=False, **asdict(solved))


def load_case(path: Path) -> SolvedCase:
    """Read what save_case wrote."""
    data: dict[str, Any] = dict(read_arrays(path))
    return SolvedCase(**data | {"sound": float(data["sound"]), "ended": str(data["ended"])})
