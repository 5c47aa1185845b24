"""The same press as a CalculiX input deck: CAX8R gel, a strip of held elements for the punch, penalty contact."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import skfem

from tactilevision.mechanics.material import neo_hooke
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import Ints, graded_mesh
from tactilevision.mechanics.punch_fem.problem import PunchProblem, default_mesh
from tactilevision.records.measured import Floats

WEDGES = 180.0  # CalculiX turns an axisymmetric mesh into a wedge of two degrees


def calculix_forces(problem: PunchProblem, depths_mm: Floats, folder: Path, card: str = "") -> Floats:
    """Force (N) at each of evenly spaced `depths_mm`, solved by the ccx on the path (neo-Hooke only).

    `card` is the gel's material, by default that of the problem.
    """
    (folder / "punch.inp").write_text(deck(problem, depths_mm, card))
    subprocess.run(["ccx", "-i", "punch"], cwd=folder, check=True, capture_output=True, timeout=500)
    text = (folder / "punch.dat").read_text()
    found = re.findall(r"total force .*?\n\s*\n\s+\S+\s+(\S+)", text)
    forces: Floats = WEDGES * np.abs(np.array([float(value) for value in found]))
    return forces


def deck(problem: PunchProblem, depths_mm: Floats, card: str = "") -> str:
    """The input file."""
    return "".join((_geometry(problem), _material(card or _card(problem)), _contact(problem), _steps(depths_mm)))


def _geometry(problem: PunchProblem) -> str:
    """Nodes, elements of the gel and the punch, and the sets and surfaces that the rest speaks of."""
    punch = problem.punch
    assert isinstance(punch, RoundedPunch)
    nodes, quads, top, base, axis = gel(problem)
    shell, strips = strip(punch, problem.thickness_mm)
    every, start = np.concatenate([nodes, shell]), len(quads) + 1
    numbers = "\n".join(f"{i + 1}, {r:.9g}, {z:.9g}, 0" for i, (r, z) in enumerate(every))
    return f"""*NODE, NSET=ALL
{numbers}
*ELEMENT, TYPE=CAX8R, ELSET=GEL
{_elements(quads, first=1, offset=1)}
*ELEMENT, TYPE=CAX8R, ELSET=PUNCH
{_elements(strips, first=start, offset=len(nodes) + 1)}
*NSET, NSET=PUNCHNODES, GENERATE
{len(nodes) + 1}, {len(every)}
*NSET, NSET=BASE
{_lines(base + 1)}
*NSET, NSET=AXIS
{_lines(axis + 1)}
*SURFACE, NAME=TOP, TYPE=ELEMENT
{chr(10).join(f"{e + 1}, S3" for e in top)}
*SURFACE, NAME=FACE, TYPE=ELEMENT
{chr(10).join(f"{start + i}, S1" for i in range(len(strips)))}
"""


def _elements(quads: Ints, *, first: int, offset: int) -> str:
    return "\n".join(f"{first + i}, " + ", ".join(str(n + offset) for n in quad) for i, quad in enumerate(quads))


def _card(problem: PunchProblem) -> str:
    c10, d1 = neo_hooke(problem.material)
    return f"*MATERIAL, NAME=GEL\n*HYPERELASTIC, NEO HOOKE\n{c10}, {d1}\n"


def _material(card: str) -> str:
    return f"""{card}*MATERIAL, NAME=STEEL
*ELASTIC
1000, 0.3
*SOLID SECTION, ELSET=GEL, MATERIAL=GEL
*SOLID SECTION, ELSET=PUNCH, MATERIAL=STEEL
"""


def _contact(problem: PunchProblem) -> str:
    """Penalty contact, and what is held."""
    punch = problem.punch
    assert isinstance(punch, RoundedPunch)
    stiff = problem.penalty * problem.material.youngs_modulus_MPa / default_mesh(problem).edge_size_mm
    friction = f"*FRICTION\n{punch.friction}, {stiff / 10}\n" if punch.friction > 0 else ""
    return f"""*SURFACE INTERACTION, NAME=TOUCH
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{stiff}
{friction}*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE
TOP, FACE
*BOUNDARY
BASE, 1, 2
AXIS, 1, 1
PUNCHNODES, 1, 1
"""


def _steps(depths_mm: Floats) -> str:
    """One step down to the last depth, the force at the base printed at each."""
    steps = len(depths_mm)
    return f"""*TIME POINTS, NAME=ASKED, GENERATE
{1 / steps}, 1, {1 / steps}
*STEP, NLGEOM, INC=2000
*STATIC
{0.25 / steps}, 1, 1e-6, {0.5 / steps}
*BOUNDARY
PUNCHNODES, 2, 2, {-depths_mm[-1]}
*NODE PRINT, NSET=BASE, TOTALS=ONLY, TIME POINTS=ASKED
RF
*END STEP
"""


def gel(problem: PunchProblem) -> tuple[Floats, Ints, Ints, Ints, Ints]:
    """Nodes (M, 2), eight-node quadrilaterals, elements under the surface, nodes of base and axis."""
    grid = graded_mesh(
        problem.punch.radius_mm,
        problem.thickness_mm,
        pad_radius_mm=problem.pad_radius_mm,
        settings=problem.mesh or default_mesh(problem),
    )
    basis = skfem.Basis(grid, skfem.ElementQuad2(), intorder=2)
    used = np.asarray(basis.element_dofs)[:8]
    kept, flat = np.unique(used, return_inverse=True)
    nodes = np.asarray(basis.doflocs).T[kept]
    quads = flat.reshape(used.shape).T
    quads = np.array([_counterclockwise(nodes, quad) for quad in quads])
    top = np.flatnonzero(np.isclose(nodes[quads[:, 6], 1], problem.thickness_mm))
    base = np.flatnonzero(nodes[:, 1] < 1e-9)
    axis = np.flatnonzero(nodes[:, 0] < 1e-9)
    return nodes, quads, top, base, axis


def strip(punch: RoundedPunch, height_mm: float) -> tuple[Floats, Ints]:
    """The punch's outline as a strip of eight-node elements: nodes (M, 2) and elements, face first."""
    rho, a = punch.edge_radius_mm, punch.radius_mm
    flat = np.linspace(0, a - rho, 41)
    turn = np.linspace(0, np.pi / 2, 33)[1:]
    side = rho + np.linspace(0, 0.5 * height_mm, 21)[1:]
    face = np.concatenate(
        [
            np.stack([flat, 0 * flat], -1),
            np.stack([a - rho + rho * np.sin(turn), rho - rho * np.cos(turn)], -1),
            np.stack([a + 0 * side, side], -1),
        ]
    )
    inward = np.concatenate(
        [
            np.stack([0 * flat, 1 + 0 * flat], -1),
            np.stack([-np.sin(turn), np.cos(turn)], -1),
            np.stack([-1 + 0 * side, 0 * side], -1),
        ]
    )
    if len(face) % 2 == 0:
        raise AssertionError("an outline of whole quadratic elements has an odd number of nodes")
    count = len(face)
    back, middle = face + 0.5 * rho * inward, face[::2] + 0.25 * rho * inward[::2]
    nodes = np.concatenate([face, back, middle]) + np.array([0.0, height_mm])
    i = np.arange(0, count - 1, 2)
    quads = np.stack(
        [i, i + 2, count + i + 2, count + i, i + 1, 2 * count + i // 2 + 1, count + i + 1, 2 * count + i // 2], -1
    )
    return nodes, quads


def _counterclockwise(nodes: Floats, quad: Ints) -> Ints:
    """Corners from the lower left, then the middles of bottom, right, top, left."""
    r, z = nodes[quad].T
    left, right, low, high = r.min(), r.max(), z.min(), z.max()
    mid_r, mid_z = (left + right) / 2, (low + high) / 2
    order = [(left, low), (right, low), (right, high), (left, high)]
    order += [(mid_r, low), (right, mid_z), (mid_r, high), (left, mid_z)]
    return np.array([quad[np.argmin(np.hypot(r - x, z - y))] for x, y in order])


def _lines(numbers: Ints) -> str:
    return "\n".join(", ".join(map(str, numbers[i : i + 8])) for i in range(0, len(numbers), 8))
