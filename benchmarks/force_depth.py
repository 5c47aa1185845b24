"""Force at large depth: nonlinear elements press a punch in, the camera looks, the force comes back.

The form of the correction was chosen on flat punches like those of SEEN. HELD_OUT are solves it has never met:
balls (a punch that is all edge), narrower and wider punches, other Poisson's ratios and friction, another law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.force_cases import View, seen
from tactilevision.errors import ConvergenceError
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import MeshSettings
from tactilevision.mechanics.punch_fem.laws import Hencky, Law, NeoHooke
from tactilevision.mechanics.punch_fem.press import press_to_depths
from tactilevision.mechanics.punch_fem.problem import PunchProblem
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEW = View((240, 320), 0.0855, 1)
GEL = Gel(3.0, shape="disc", radius_mm=15.0)
EDGE_MM = 0.15
LIMIT = 0.04


@dataclass(frozen=True)
class Case:
    """One press: a flat punch with an edge of EDGE_MM, or a ball; `a_mm` is the punch's, or the ball's, radius."""

    a_mm: float
    friction: float
    nu: float
    ball: bool = False
    law: Law = field(default_factory=NeoHooke)
    depths_mm: tuple[float, ...] = (0.15, 0.3, 0.45, 0.6)

    @property
    def name(self) -> str:
        """For the table."""
        shape = "ball R" if self.ball else "punch a"
        return f"{shape} {self.a_mm} mm, friction {self.friction}, nu {self.nu}, {type(self.law).__name__}"


SEEN = (
    Case(1.5, 0.3, 0.48),
    Case(2.5, 0.0, 0.48),
    Case(2.5, 0.3, 0.45),
    Case(2.5, 0.3, 0.48),
    Case(2.5, np.inf, 0.48),
    Case(4.0, 0.3, 0.48),
)
HELD_OUT = (
    Case(4.0, 0.3, 0.48, ball=True),
    Case(6.0, 0.0, 0.48, ball=True),
    Case(6.0, np.inf, 0.46, ball=True),
    Case(1.1, 0.3, 0.47),
    Case(3.2, 0.6, 0.46),
    Case(3.2, 0.15, 0.42),
    Case(5.0, 0.3, 0.475),
    Case(2.5, 0.3, 0.48, law=Hencky(), depths_mm=(0.15, 0.3, 0.45)),
)


def press_and_look(case: Case, *, depths_mm: Sequence[float], std_mm: float = 0.002) -> Floats:
    """Rows: depth, true force; force found, and the same by linear elasticity alone; the first without shear, and
    its own standard deviation."""
    material = Material(0.2, case.nu)
    edge = 0.98 * case.a_mm if case.ball else EDGE_MM
    mesh = MeshSettings(0.12, 0.5, inside_mm=0.999 * case.a_mm, outside_mm=0.1) if case.ball else None
    problem = PunchProblem(
        material, RoundedPunch(case.a_mm, edge, case.friction), GEL.thickness_mm, 15.0, law=case.law, mesh=mesh
    )
    press = press_to_depths(problem, list(depths_mm))
    scale = (VIEW.mm_per_px, VIEW.mm_per_px)
    settings = [ForceSettings(large_depth=large) for large in (True, False)]
    fields = [ForceField(GEL, material, scale, view_px=VIEW.shape, settings=one) for one in settings]
    x, y = VIEW.mesh()
    r, rows = np.hypot(x, y), []
    for step in range(len(press.depth_mm)):
        out = np.interp(r, press.r_mm, press.u_r_mm[step]) / r
        u = np.stack([out * x, out * y, -np.interp(r, press.r_mm, press.u_z_mm[step])])
        maps = seen(u, VIEW, std_mm=std_mm, rng=np.random.default_rng(step))
        found = [field(*maps).resultant_N[2] for field in fields]
        blind = fields[0](maps[0])
        rows.append(
            [press.depth_mm[step], press.force_N[step], *found, blind.resultant_N[2], blind.resultant_std_N[2]]
        )
    return np.array(rows)


def report(title: str, cases: Sequence[Case]) -> None:
    """One block of the table: found over true less 1; (linear elasticity); [without shear, its pull]."""
    worst = 0.0
    print(f"{title}: found/true - 1 in % (linear elasticity alone) [without shear, over its deviation]")
    for case in cases:
        try:
            rows = press_and_look(case, depths_mm=case.depths_mm)
        except ConvergenceError as fault:
            print(f"    {case.name}: no solution to compare with: {fault}")
            continue
        off = [
            f"w/h {w / 3:.2f}: {100 * (a / p - 1):+.1f} ({100 * (b / p - 1):+.1f}) [{100 * (c / p - 1):+.1f}, "
            f"{(c - p) / s:+.1f}]"
            for w, p, a, b, c, s in rows
        ]
        worst = max(worst, float(np.abs(rows[:, 2] / rows[:, 1] - 1).max()))
        print(f"    {case.name}: " + "   ".join(off), flush=True)
    print(f"    largest with shear: {100 * worst:.1f} %")


def main() -> None:
    """Print the tables."""
    report("seen", SEEN)
    report("held out", HELD_OUT)


def quick() -> None:
    report("one press", [replace(SEEN[1], depths_mm=(0.06,))])


if __name__ == "__main__":
    main()
