"""One solved punch problem of the table: its name, its numbers, and how it is solved and kept."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np

from tactilevision.errors import ConvergenceError
from tactilevision.files import replacing
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.hencky import Hencky
from tactilevision.mechanics.punch_fem.laws import Law, NeoHooke
from tactilevision.mechanics.punch_fem.march import StepRecord, march
from tactilevision.mechanics.punch_fem.newton import State, equations
from tactilevision.mechanics.punch_fem.problem import Model, PunchProblem, build
from tactilevision.mechanics.punch_fem.results import surface_profile
from tactilevision.records import Floats, Material

LAWS: tuple[Law, ...] = (NeoHooke(), Hencky())
DEPTHS = (0.002, 0.006, 0.0125, 0.025, 0.04, 0.055, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25)
REACH = 3.5  # thicknesses beside the punch
PLACES = 25
BESIDE = tuple(
    REACH * (k / (PLACES - 1)) ** 2 for k in range(PLACES)
)  # even in the root, which the edge is smooth in


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
    def block(self) -> tuple[str, float, float, float]:
        """What is never interpolated: law, friction, edge radius, pad radius."""
        return self.law, self.friction, self.edge_over_h, self.pad_over_h

    @property
    def name(self) -> str:
        """A file name of its own, stable over runs."""
        numbers = asdict(self)
        digest = hashlib.sha256(json.dumps({k: str(v) for k, v in numbers.items()}).encode()).hexdigest()[:8]
        return f"{self.law}_mu{self.friction:g}_nu{self.poisson_ratio:g}_a{self.a_over_h:g}_{digest}"


@dataclass(frozen=True, slots=True)
class Grid:
    """A rectangular grid of cases, one block (law, friction, edge, pad) after the other in the order given."""

    laws: tuple[str, ...] = ("neo-hooke", "hencky")
    frictions: tuple[float, ...] = (0.3, math.inf, 0.0, 0.15, 0.6)
    edges_over_h: tuple[float, ...] = (1 / 60, 1 / 30)
    pads_over_h: tuple[float, ...] = (5.0,)
    poisson_ratios: tuple[float, ...] = (0.3, 0.37, 0.43, 0.465, 0.487, 0.4999)
    a_over_h: tuple[float, ...] = (0.2, 0.3, 0.45, 0.67, 1.0, 1.5)

    def cases(self) -> Iterator[Case]:
        """All cases, blocks outermost."""
        blocks = product(self.laws, self.edges_over_h, self.pads_over_h, self.frictions)
        for law, edge, pad, friction in blocks:
            for nu, alpha in product(self.poisson_ratios, self.a_over_h):
                yield Case(law, friction, edge, pad, nu, alpha)


@dataclass(frozen=True, slots=True)
class SolvedCase:
    """`depth` (T,) w/h solved; `force` (T,) P/(E w h); `u_r`, `u_z` (T, B) over w, at (r - a)/h = BESIDE, NaN
    beyond the pad. `reached` is the deepest equilibrium, and `ended` says why there was none beyond it ("": all
    asked for were solved)."""

    depth: Floats
    force: Floats
    u_r: Floats
    u_z: Floats
    reached: float
    ended: str


def problem_of(case: Case) -> PunchProblem:
    """The case with a gel of thickness 1 and modulus 1."""
    law = next(law for law in LAWS if law.name == case.law)
    punch = RoundedPunch(case.a_over_h, case.edge_over_h, case.friction)
    return PunchProblem(Material(1.0, case.poisson_ratio), punch, 1.0, case.pad_over_h, law=law)


def solve_case(case: Case, depths: tuple[float, ...] = DEPTHS) -> SolvedCase:
    """Press as deep as the solver gets; what it cannot reach is left out, never filled in."""
    model = build(problem_of(case))
    steps: list[StepRecord] = []
    states: list[State] = []
    ended = ""
    try:
        for state in march(equations(model, by_force=False), depths, steps):
            states.append(state)  # noqa: PERF402 - what was reached before an error is kept
    except ConvergenceError:
        ended = steps[-1].failure
    reached = max((step.target for step in steps if not step.failure), default=0.0)
    return _gather(model, states, case, reached=reached, ended=ended)


def case_path(folder: Path, case: Case) -> Path:
    """Where a work folder keeps a case."""
    return folder / f"{case.name}.npz"


def save_case(path: Path, solved: SolvedCase) -> None:
    """Write one case, whole or not at all."""
    with replacing(path) as temporary:
        np.savez(temporary, depth=solved.depth, force=solved.force, u_r=solved.u_r, u_z=solved.u_z,
                 reached=solved.reached, ended=solved.ended)  # fmt: skip


def load_case(path: Path) -> SolvedCase:
    """Read what save_case wrote."""
    with np.load(path, allow_pickle=False) as data:
        return SolvedCase(data["depth"], data["force"], data["u_r"], data["u_z"],
                          float(data["reached"]), str(data["ended"]))  # fmt: skip


def _gather(model: Model, states: list[State], case: Case, *, reached: float, ended: str) -> SolvedCase:
    from scipy.interpolate import CubicSpline

    depth = np.array([state.depth_mm for state in states])
    wanted = case.a_over_h + np.array(BESIDE)
    rows = np.full((len(states), 2, len(wanted)), np.nan)
    on_pad = wanted <= case.pad_over_h * (1 + 1e-9)
    for row, state in zip(rows, states, strict=True):
        r, profile = surface_profile(model, state)
        beside = r >= case.a_over_h * (1 - 1e-9)
        row[:, on_pad] = CubicSpline(r[beside], profile[:, beside], axis=1)(wanted[on_pad]) / state.depth_mm
    force = np.array([state.force_N for state in states]) / depth
    return SolvedCase(depth, force, rows[:, 0], rows[:, 1], reached, ended)
