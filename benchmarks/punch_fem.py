"""The finite elements: processor seconds for 12 steps to w/h = .2, and how far a refined mesh moves the force.

python -m benchmarks.punch_fem
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import MeshSettings
from tactilevision.mechanics.punch_fem.press import press_to_depths
from tactilevision.mechanics.punch_fem.problem import GluedFace, PunchProblem, default_mesh
from tactilevision.records.measured import Material

GEL = Material(1.0, 0.4797)
TARGETS_S = {"no slip": 4.0, "mu = .3": 6.0, "frictionless": 10.0, "glued nodes": 2.0}


def problems() -> dict[str, tuple[PunchProblem, float]]:
    """The paper's gel and punch with an edge of .05 mm, and how deep each is pressed (mm)."""
    frictions = {"no slip": math.inf, "mu = .3": 0.3, "frictionless": 0.0}
    found = {
        name: (PunchProblem(GEL, RoundedPunch(2.5, 0.05, friction), 3.0, 15.0), 0.6)
        for name, friction in frictions.items()
    }
    glued = PunchProblem(GEL, GluedFace(2.5), 3.0, 15.0, mesh=MeshSettings(0.05, 0.5))
    return found | {"glued nodes": (glued, 0.39)}


def refined(problem: PunchProblem) -> PunchProblem:
    """The same on a mesh with about half the element size everywhere."""
    coarse = problem.mesh or default_mesh(problem)
    mesh = replace(
        coarse, edge_size_mm=coarse.edge_size_mm / 1.5, largest_mm=coarse.largest_mm / 2, growth=coarse.growth**0.5
    )
    return replace(problem, mesh=mesh)


def main() -> None:
    """Print one line a contact."""
    for name in problems():
        report(name)


def report(name: str, steps: int = 12) -> None:
    """Press in `steps`, and half as deep on the refined mesh."""
    problem, deepest = problems()[name]
    depths = np.linspace(0, deepest, steps + 1)[1:]
    start = time.process_time()
    solution = press_to_depths(problem, depths)
    seconds = time.process_time() - start
    iterations = sum(0 if isinstance(step, str) else step.iterations for step in solution.steps)
    fine = press_to_depths(refined(problem), depths[: steps // 2]).force_N
    change = np.abs(solution.force_N[: steps // 2] / fine - 1).max()
    print(
        f"{name:13s} {seconds:5.1f} s (aim {TARGETS_S[name]:.0f})  {len(solution.steps)} steps, "
        f"{iterations} iterations; refined to half depth: force moves {100 * change:.2f} %"
    )


def quick() -> None:
    report("glued nodes", steps=4)


if __name__ == "__main__":
    main()
