"""The figures of docs/evidence/five_points.md: the published points, the route, what it makes of others.

python -m benchmarks.five_points          prints every table of the page
python -m benchmarks.five_points solve    solves the elements behind docs/evidence/five_points.csv (minutes)
python -m benchmarks.five_points draw     draws docs/evidence/five_points.png

The finite element rows are P/(E w) in mm at the five published depths: truths of which everything is known, which
are then read by the published route as if they had been measured.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.laws.paper import modulus_at, poisson_from_beta
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.material import neo_hooke
from tactilevision.records.measured import Floats, Material

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).parents[1] / "docs"
ROWS = DOCS / "evidence" / "five_points.csv"
DEPTHS_MM = np.array([0.15, 0.3, 0.4, 0.5, 0.6])
RADIUS_MM, THICKNESS_MM, PAD_MM = 2.5, 3.0, 15.0
SLOPE, OFFSET = 5.2662, 3.4943  # of the published line through P/w against w/h, N/mm
NU, PRINTED_E = 0.4797, 0.1981
EDGE_MM = 0.05


@dataclass(frozen=True, slots=True)
class Case:
    """One gel and punch, as finite elements take them."""

    law: str = "neo-hooke"
    friction: float = 0.3
    edge_mm: float = EDGE_MM
    thickness_mm: float = THICKNESS_MM
    poisson_ratio: float = NU


CASES = (
    Case(),
    Case(law="yeoh"),
    Case(law="gent"),
    Case(law="hencky", edge_mm=0.1),
    Case(law="hencky", edge_mm=0.25),
    Case(friction=0.0),
    Case(friction=0.15),
    Case(friction=inf),
    Case(edge_mm=0.1),
    Case(edge_mm=0.25),
    Case(edge_mm=0.5),
    Case(thickness_mm=2.7),
    Case(thickness_mm=2.5),
    Case(thickness_mm=2.25, edge_mm=0.1),
    Case(poisson_ratio=0.45),
    Case(poisson_ratio=0.49),
)


@dataclass(frozen=True, slots=True)
class Reading:
    """What the published route makes of depths and forces."""

    c_N_per_mm: float
    beta: float
    r_squared: float
    poisson_ratio: float
    youngs_modulus_MPa: float


def read(depth_mm: Floats, force_N: Floats, *, thickness_mm: float = THICKNESS_MM) -> Reading:
    """Line through P/w against w/h, nu from the log law of beta, E from kappa at a/h = .8."""
    strain, secant = depth_mm / thickness_mm, force_N / depth_mm
    slope, c = np.polyfit(strain, secant, 1)
    left = secant - (c + slope * strain)
    r_squared = 1 - float(left @ left) / float(np.sum((secant - secant.mean()) ** 2))
    nu = poisson_from_beta(float(slope / c))
    modulus = modulus_at(float(c), nu, radius_mm=RADIUS_MM) if 0 <= nu < 0.5 else float("nan")
    return Reading(float(c), float(slope / c), r_squared, nu, modulus)


def published() -> Floats:
    """Forces (5,) of the printed line at the published depths, N."""
    return np.asarray((SLOPE * DEPTHS_MM / THICKNESS_MM + OFFSET) * DEPTHS_MM)


def solved() -> dict[Case, Floats]:
    """P/(E w) (k,) of each case at the first k depths, as far as finite elements went."""
    found = {}
    with ROWS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            numbers = (float(row[key]) for key in ("friction", "edge_mm", "thickness_mm", "poisson_ratio"))
            values = [float(row[f"w{depth:g}"]) for depth in DEPTHS_MM if row[f"w{depth:g}"]]
            found[Case(row["law"], *numbers)] = np.array(values)
    return found


def reproduced() -> list[str]:
    """The published numbers, and what exact kappa and the true a/h make of them."""
    line = read(DEPTHS_MM, published())
    exact, ratio = modulus_at(line.c_N_per_mm, NU, radius_mm=RADIUS_MM), RADIUS_MM / THICKNESS_MM
    kappas = [float(fast_kappa(NU, a)) for a in (0.8, ratio)]
    true = line.c_N_per_mm * (1 - NU**2) / (2 * RADIUS_MM * kappas[1])
    c10, d1 = neo_hooke(Material(PRINTED_E, NU))
    rows = [
        ("c (N/mm)", "3.4943", f"{line.c_N_per_mm:.4f}"),
        ("β", "1.5071", f"{line.beta:.4f}"),
        ("ν = .0813 ln β + .4464", "0.4797", f"{line.poisson_ratio:.4f}"),
        ("E (MPa), κ at a/h = .8", "0.1981", f"{exact:.4f} (κ = {kappas[0]:.5f})"),
        ("E (MPa), κ at a/h = 2.5/3", "", f"{true:.4f} (κ = {kappas[1]:.5f}), {100 * (true / exact - 1):+.1f} %"),
        ("C10 (MPa), D1 (1/MPa) of the printed E and ν", "0.0335, 1.2297", f"{c10:.4f}, {d1:.4f}"),
    ]
    return table(("", "printed", "here"), rows)


def depth_zero() -> list[str]:
    """The same forces with every depth off by as much."""
    rows = []
    for off in (-13.0, -10.0, -5.0, 0.0, 5.0, 10.0, 13.0):
        found = read(DEPTHS_MM + 1e-3 * off, published())
        rows.append((f"{off:+.0f}", *_said(found)))
    return table(("depth off by (µm)", "c (N/mm)", "β", "R²", "ν", "E (MPa)"), rows)


def other_gels() -> list[str]:
    """Gels whose ν and E are known, read by the published route; ν is .4797 unless the name says otherwise."""
    rows = []
    for case, secant in solved().items():
        depth = DEPTHS_MM[: len(secant)]
        found = read(depth, secant * depth)
        known = np.isfinite(found.youngs_modulus_MPa)
        wrong = f"{100 * (found.youngs_modulus_MPa - 1):+.1f} %" if known else "–"
        nu = f"{found.poisson_ratio:.4f}" if known else "none"
        rows.append((_name(case), f"{depth[-1]:g}", f"{found.beta:.2f}", f"{found.r_squared:.4f}", nu, wrong))
    return table(("the gel is", "to w (mm)", "β", "R²", "ν read", "E read, off by"), rows)


def equal_depth() -> list[str]:
    """Finite elements at the published depths: their force against the published one, in per cent."""
    truth, rows = solved(), []
    for case in (Case(), Case(poisson_ratio=0.45), Case(poisson_ratio=0.49), Case(law="hencky", edge_mm=0.25)):
        secant = truth[case]
        moduli = (PRINTED_E, _stiffness_matched(case)) if case == Case() else (_stiffness_matched(case),)
        for modulus in moduli:
            errors = 100 * (modulus * secant * DEPTHS_MM[: len(secant)] / published()[: len(secant)] - 1)
            cells = [*(f"{error:+.1f}" for error in errors), *["–"] * (5 - len(errors))]
            rows.append((_name(case), f"{modulus:.4f}", *cells))
    return table(("the gel is", "E (MPa)", *(f"w = {w:g}" for w in DEPTHS_MM)), rows)


def left_open() -> list[str]:
    """E(nu) at the published c, with kappa at the true a/h: what one punch fixes."""
    c = read(DEPTHS_MM, published()).c_N_per_mm
    nus = (0.45, 0.46, 0.47, 0.48, 0.49, 0.4999)
    values = [c * (1 - nu**2) / (2 * RADIUS_MM * float(fast_kappa(nu, RADIUS_MM / THICKNESS_MM))) for nu in nus]
    return table(("ν", *(f"{nu:g}" for nu in nus)), [("E (MPa)", *(f"{value:.4f}" for value in values))])


def blocks() -> dict[str, list[str]]:
    """Every table of the page, as it stands there."""
    return {made.__name__: made() for made in (reproduced, depth_zero, other_gels, equal_depth, left_open)}


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    return ["| " + " | ".join(cells) + " |" for cells in (header, ["---"] * len(header), *rows)]


def solve() -> None:
    """Solve every case as deep as it goes, and write the file."""
    from tactilevision.files.writing import replacing

    with replacing(ROWS) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["law", "friction", "edge_mm", "thickness_mm", "poisson_ratio", *(f"w{w:g}" for w in DEPTHS_MM)]
        )
        for case in CASES:
            values = [f"{value:.4f}" for value in solve_case(case)]
            lengths = (case.edge_mm, case.thickness_mm, case.poisson_ratio)
            writer.writerow([case.law, case.friction, *lengths, *values, *[""] * (5 - len(values))])
            print(case, values, flush=True)


def solve_case(case: Case) -> Floats:
    """P/(E w) (k,) by finite elements at as many of the five depths as there is an equilibrium."""
    from tactilevision.errors import ConvergenceError
    from tactilevision.mechanics.punch_fem.contact import RoundedPunch
    from tactilevision.mechanics.punch_fem.laws import Gent, Hencky, Law, NeoHooke, Yeoh
    from tactilevision.mechanics.punch_fem.press import press_to_depths
    from tactilevision.mechanics.punch_fem.problem import PunchProblem

    laws: dict[str, Law] = {"neo-hooke": NeoHooke(), "yeoh": Yeoh(c2=0.05), "gent": Gent(30.0), "hencky": Hencky()}
    punch = RoundedPunch(RADIUS_MM, case.edge_mm, case.friction)
    problem = PunchProblem(Material(1.0, case.poisson_ratio), punch, case.thickness_mm, PAD_MM, law=laws[case.law])
    for count in range(len(DEPTHS_MM), 0, -1):
        try:
            press = press_to_depths(problem, DEPTHS_MM[:count])
        except ConvergenceError:
            continue
        return np.asarray(press.force_N / DEPTHS_MM[:count])
    return np.zeros(0)


def draw() -> None:
    """The published line among finite elements, and nu as the route reads it from gels of nu = .4797."""
    from tactilevision.plots import style

    style.save_figure(_figure(), DOCS / "evidence" / "five_points.png")


def _figure() -> Figure:
    from tactilevision.plots import style

    @style.house_look
    def drawn() -> Figure:
        figure, (lines, nus) = style.new_figure(11.0, 4.4, columns=2)
        strain = DEPTHS_MM / THICKNESS_MM
        lines.plot(strain, published() / DEPTHS_MM, "o-", color=style.ORANGE, label="published")
        for (case, secant), colour in zip(_drawn(), style.CYCLE, strict=False):
            lines.plot(strain[: len(secant)], _stiffness_matched(case) * secant, color=colour, label=_name(case))
        lines.set(xlabel="w / h", ylabel="P / w (N/mm)", title="Gels of equal initial stiffness")
        lines.legend(fontsize=7)
        names, values = zip(*_read_from(), strict=True)
        nus.plot(values, range(len(values)), "o", color=style.BLUE)
        nus.axvline(NU, color=style.GREY, lw=1)
        nus.set_yticks(range(len(names)), names, fontsize=7)
        nus.invert_yaxis()
        nus.set(xlabel="ν as the route reads it", title=f"What the route reads from gels of ν = {NU:g}")
        return figure

    return drawn()


def _drawn() -> Iterator[tuple[Case, Floats]]:
    truth = solved()
    thin, hard = Case(thickness_mm=2.25, edge_mm=0.1), Case(law="hencky", edge_mm=0.25)
    for case in (Case(), hard, Case(friction=0.0), Case(edge_mm=0.5), thin):
        yield case, truth[case]


def _read_from() -> Iterator[tuple[str, float]]:
    for case, secant in solved().items():
        depth = DEPTHS_MM[: len(secant)]
        nu = read(depth, secant * depth).poisson_ratio
        if case.poisson_ratio == NU and np.isfinite(nu):
            yield _name(case), nu


def _stiffness_matched(case: Case) -> float:
    """E at which this gel has the published c: the mean of P/w over w -> 0 of a line through its first depths."""
    secant = solved()[case]
    depth = DEPTHS_MM[: len(secant)]
    return read(DEPTHS_MM, published()).c_N_per_mm / read(depth, secant * depth).c_N_per_mm


def _said(found: Reading) -> tuple[str, ...]:
    modulus = f"{found.youngs_modulus_MPa:.4f}" if np.isfinite(found.youngs_modulus_MPa) else "–"
    nu = f"{found.poisson_ratio:.4f}"
    return f"{found.c_N_per_mm:.4f}", f"{found.beta:.3f}", f"{found.r_squared:.4f}", nu, modulus


def _name(case: Case) -> str:
    """What sets a case apart from the plain one."""
    plain, parts = Case(), []
    laws = {
        "neo-hooke": "neo-Hooke",
        "yeoh": "Yeoh (C20 = .05 C10)",
        "gent": "Gent (J_m = 30)",
        "hencky": "Hencky",
    }
    if case.law != plain.law:
        parts.append(laws[case.law])
    if case.friction != plain.friction:
        parts.append("stick" if case.friction == inf else f"µ = {case.friction:g}")
    if case.edge_mm != plain.edge_mm:
        parts.append(f"edge {case.edge_mm:g} mm")
    if case.thickness_mm != plain.thickness_mm:
        parts.append(f"h = {case.thickness_mm:g} mm")
    if case.poisson_ratio != plain.poisson_ratio:
        parts.append(f"ν = {case.poisson_ratio:g}")
    return ", ".join(parts) if parts else f"{laws[plain.law]}, µ = {plain.friction:g}, edge {plain.edge_mm:g} mm"


def main(arguments: Sequence[str] = ()) -> None:
    """Print the tables; or `solve` the elements behind them, or `draw` the picture."""
    if "solve" in arguments:
        solve()
    elif "draw" in arguments:
        draw()
    else:
        for name, lines in blocks().items():
            print(f"\n{name}\n" + "\n".join(lines))


def quick() -> None:
    main()


if __name__ == "__main__":
    main(sys.argv[1:])
