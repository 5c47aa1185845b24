"""Force against depth of a flat punch, P(w), by finite elements: from the table, else solved now.

Between solved depths P/w is a spline in sqrt(w), in which the first touch of a rounded edge is smooth. Beyond the
deepest equilibrium force and depth are NaN, and `ended` gives the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files.arrays import unpack_arrays
from tactilevision.files.cache import kept
from tactilevision.files.writing import pack_arrays
from tactilevision.mechanics.flat_contact import WIDE, FlatContact
from tactilevision.mechanics.tables.cases import DEPTHS, Case
from tactilevision.mechanics.tables.punch import punch_force, punch_reach
from tactilevision.mechanics.tables.solve import solve_case
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats, Material

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

GRID = 400  # depths of the integrated curve


@dataclass(frozen=True, slots=True)
class PunchCurve:
    """`depth_mm`, `force_N` (T,) growing, their `source`, and why they `ended`, if early."""

    depth_mm: Floats
    force_N: Floats
    source: Literal["table", "solved"]
    ended: str = ""

    def force_at(self, depth_mm: npt.ArrayLike) -> Floats:
        """Return the force (N) at depths of any shape; NaN beyond the curve."""
        depth = np.asarray(depth_mm, dtype=float)
        inside = (depth >= 0) & (depth <= self.depth_mm[-1] * (1 + ROUNDING))
        bounded = np.clip(depth, self.depth_mm[0], self.depth_mm[-1])  # below the first depth P/w is constant
        return np.asarray(np.where(inside, depth * self._secant()(np.sqrt(bounded)), np.nan))

    def depth_at(self, force_N: npt.ArrayLike) -> Floats:
        """Return the depth (mm) at forces of any shape; NaN beyond the curve."""
        force = np.asarray(force_N, dtype=float)
        depths = np.linspace(0, 1, GRID) ** 2 * self.depth_mm[-1]
        forces = self.force_at(depths)
        inside = (force >= 0) & (force <= forces[-1] * (1 + ROUNDING))
        return np.asarray(np.where(inside, np.interp(force, forces, depths), np.nan))

    def _secant(self) -> BSpline:
        from scipy.interpolate import make_interp_spline

        order = min(3, self.depth_mm.size - 1)
        return make_interp_spline(np.sqrt(self.depth_mm), self.force_N / self.depth_mm, k=order)


def punch_curve(contact: FlatContact, material: Material, deepest_mm: float) -> PunchCurve:
    """Return P(w) on first loading to `deepest_mm`, or to the greatest depth that table or finite elements reach.

    Raises InputError for depths outside (0, thickness), ConvergenceError if not even the first touch is solved.
    """
    if not 0 < deepest_mm < contact.thickness_mm:
        raise InputError(
            "a depth lies in (0, thickness)",
            where="punch_curve",
            value=deepest_mm,
            remedy=f"The gel is {contact.thickness_mm:g} mm thick.",
        )
    table = tabulated_curve(contact, material, deepest_mm)
    if table is not None and not table.ended:
        return table
    solved = _solved(contact, material, deepest_mm)
    deeper = table is None or solved.depth_mm[-1] > table.depth_mm[-1]
    return solved if table is None or deeper else replace(table, ended=solved.ended)


def tabulated_curve(contact: FlatContact, material: Material, deepest_mm: float) -> PunchCurve | None:
    """Return P(w) to `deepest_mm` or as deep as the table goes.

    None where it holds no such contact or material.
    """
    try:
        reach = punch_reach(contact, material)
        depths = np.linspace(0.05, 1, 24) ** 2 * min(deepest_mm, reach)
        if reach <= 0:
            return None
        ended = "" if reach >= deepest_mm * (1 - ROUNDING) else "the table ends here"
        return PunchCurve(depths, punch_force(depths, contact, material=material), "table", ended)
    except InputError:
        return None


def _solved(contact: FlatContact, material: Material, deepest_mm: float) -> PunchCurve:
    h = contact.thickness_mm
    if not contact.edge_radius_mm > 0:
        raise InputError(
            "a sharp edge has no solution beyond small depths",
            where="punch_curve",
            remedy="State an edge radius, say a sixtieth of the gel's thickness.",
        )
    case = Case(
        law=contact.law,
        friction=contact.friction,
        edge_over_h=contact.edge_over_h,
        pad_over_h=min(contact.pad_radius_mm / h, contact.a_over_h + WIDE),
        poisson_ratio=material.poisson_ratio,
        a_over_h=contact.a_over_h,
    )
    deepest = deepest_mm / h
    depths = (*(d for d in DEPTHS if d < deepest * (1 - ROUNDING)), deepest)
    files = kept("punch", (case, depths), make=lambda: _files(case, depths))
    (depth, per_depth), ended = (
        unpack_arrays(files["curve.npz"], where=Path("punch"))["curve"],
        files["ended"].decode(),
    )
    if not depth.size:
        raise ConvergenceError(f"punch_curve: no equilibrium was found at first touch ({ended})")
    return PunchCurve(depth * h, per_depth * depth * material.youngs_modulus_MPa * h**2, "solved", ended)


def _files(case: Case, depths: tuple[float, ...]) -> dict[str, bytes]:
    found = solve_case(case, depths)
    curve = pack_arrays({"curve": np.array([found.depth, found.force])}, small=False)
    return {"curve.npz": curve, "ended": found.ended.encode()}
