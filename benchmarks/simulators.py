"""What `export-material` writes, run by the programs: their force, the fitted law's, and the elastic layer's.

Programs run in environments of their own under the temporary folder, made on first use with the versions of
PINNED; where that fails they are skipped. CalculiX is `ccx` of the path.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.export.material import ExportedMaterial, ExportSettings, export_material
from tactilevision.export.shapes import Shape, layer_force
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.discretisation import MeshSettings
from tactilevision.mechanics.punch_fem.press import press_to_depths
from tactilevision.mechanics.punch_fem.problem import PunchProblem
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Floats

PINNED = {
    "mujoco": ("mujoco", ("mujoco==4.0.0",)),
    "drake": ("pydrake", ("drake==1.51.1",)),
    "genesis": ("genesis", ("genesis-world==1.4.5",)),
}
DEPTHS_MM = (0.15, 0.2, 0.3, 0.45, 0.6)
SHAPES = {
    "mujoco": (Shape(), Shape("flat", 2.5), Shape("ridge", 4.0, 10.0)),
    "drake": (Shape(), Shape("flat", 2.5), Shape("ridge", 4.0, 10.0)),
    "genesis": (Shape(),),
}


def calibration(
    modulus_MPa: float = 0.2, poisson_ratio: float = 0.48, thickness_mm: float = 3.0
) -> dict[str, Any]:
    """The parts of calibration.json that an export reads."""
    return {
        "youngs_modulus_MPa": {"value": 0.2, "std": 0.002, "interval95": [0.196, 0.204], "unit": "MPa"},
        "poisson_ratio": {"value": 0.48, "std": 0.002, "interval95": [0.476, 0.484], "unit": "1"},
        "youngs_modulus_of_nu": [[0.45, 0.227], [0.48, 0.2], [0.49, 0.189], [0.4999, 0.177]],
        "gel": {"thickness_mm": 3.0, "shape": "disc"},
    }


def interpreter(program: str) -> Path | None:
    """The Python of an environment that has the program at its pinned version; None where it cannot be had."""
    module, pins = PINNED[program]
    folder = Path(tempfile.gettempdir()) / "tactilevision_simulators" / "_".join(pins)
    python = folder / "bin" / "python"
    if not (folder / "installed").exists():
        venv.create(folder, with_pip=True)
        got = subprocess.run([python, "-m", "pip", "install", "--quiet", *pins], capture_output=True, check=False)
        if got.returncode:
            return None
        # torch, which Genesis needs, is this environment's, after the packages of its own
        site = subprocess.run(
            [python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        Path(site, "zz_this.pth").write_text(sysconfig.get_paths()["purelib"])
        (folder / "installed").touch()
    found = subprocess.run([python, "-c", f"import {module}"], capture_output=True, check=False)
    return None if found.returncode else python


@dataclass(frozen=True)
class Pressed:
    """Forces (n,) in N by the program and the law at the program's depths, and by law and layer at DEPTHS_MM."""

    program_N: Floats
    there_N: Floats
    law_N: Floats
    layer_N: Floats

    @property
    def program_error(self) -> float:
        """Largest relative difference of program and law."""
        return float(np.abs(self.program_N / self.there_N - 1).max())

    @property
    def law_error(self) -> float:
        """Largest relative difference of law and layer."""
        return float(np.abs(self.law_N / self.layer_N - 1).max())


def ask(python: Path, task: dict[str, Any]) -> list[float]:
    """What `press_in.py` answers to a task, run by the interpreter of the program."""
    script = Path(__file__).with_name("press_in.py")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    ran = subprocess.run(
        [python, script], input=json.dumps(task), capture_output=True, text=True, check=False, env=environment
    )
    if ran.returncode:
        raise RuntimeError(ran.stderr[-2000:])
    answer: list[float] = json.loads(ran.stdout.strip().splitlines()[-1])
    return answer


def press(program: str, python: Path, exported: ExportedMaterial, shape: Shape) -> Pressed:
    """Press a shape in with the exported text."""
    law, settings = exported.fitted, exported.settings
    assert law is not None
    depth = np.array(DEPTHS_MM)
    force = law.force_N(shape, depth)
    task = {
        "program": program,
        "text": exported.text,
        "shape": shape.name,
        "radius_m": shape.radius_mm / KILO,
        "length_m": shape.length_mm / KILO,
        "mass_kg": settings.mass_kg,
        "offset_m": law.values.get("offset", 0.0),
        "pitch_m": settings.taxel_mm / KILO,
        "depths_m": (depth / KILO).tolist(),
        "forces_N": force.tolist(),
    }
    given = np.array(ask(python, task))
    there = force
    if program == "mujoco":  # depths at which it rests under the law's forces
        given, there = force, law.force_N(shape, given * KILO)
    gel: Any = {"material": exported.material, "thickness_mm": exported.thickness_mm}
    return Pressed(given, there, force, layer_force(shape, depth, **gel))


def calculix_errors(folder: Path) -> Floats:
    """Relative difference (3,) of our finite elements to CalculiX with the exported card: a punch with an edge."""
    sys.path.append(str(Path(__file__).parents[1] / "tests" / "mechanics" / "punch_fem"))
    from calculix_deck import calculix_forces

    exported, depths = export_material(calibration(), "calculix"), np.array([0.1, 0.2, 0.3])
    mesh = MeshSettings(0.1, 0.6, inside_mm=0.5, outside_mm=0.2)
    problem = PunchProblem(exported.solid, RoundedPunch(2.0, 0.4, 0.0), exported.thickness_mm, 9.0, mesh=mesh)
    found = calculix_forces(problem, depths, folder, exported.text)
    return press_to_depths(problem, depths).force_N / found - 1


def usual(shape: Shape) -> ExportSettings:
    """The settings of every comparison."""
    return ExportSettings(shape, (DEPTHS_MM[0], DEPTHS_MM[-1]))


def main(programs: tuple[str, ...] = tuple(PINNED), *, few: bool = False) -> None:
    """Print, for each program and fitted shape, its force against the law, and the law against the layer."""
    print("program   shape                          program/law   law/layer   worst of other shapes")
    for program in programs:
        python = interpreter(program)
        if python is None:
            print(f"{program:9} cannot be installed here")
            continue
        for shape in SHAPES[program][: 1 if few else None]:
            exported = export_material(calibration(), program, usual(shape))
            found = press(program, python, exported, shape)
            errors = [one.largest_error for one in exported.compared[1:] if not one.why]
            worst = max(errors, key=abs)
            print(
                f"{program:9} {shape!s:32} {100 * found.program_error:6.2f} % {100 * found.law_error:9.2f} % "
                f"{100 * worst:+9.0f} %",
                flush=True,
            )
    if shutil.which("ccx") and not few:
        with tempfile.TemporaryDirectory() as folder:
            error = float(np.abs(calculix_errors(Path(folder))).max())
        print(f"calculix  flat punch of 2 mm, edge .4 mm   {100 * error:6.2f} % (to our finite elements)")


def quick() -> None:
    """The ball in MuJoCo alone."""
    main(("mujoco",), few=True)


if __name__ == "__main__":
    main(*([tuple(sys.argv[1:])] if sys.argv[1:] else []))
