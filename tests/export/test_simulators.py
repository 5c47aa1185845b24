"""What is exported, run by the programs themselves, in environments of their own."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.simulators import PINNED, SHAPES, calculix_errors, calibration, interpreter, press, usual
from tactilevision.export.material import GOAL, export_material
from tactilevision.export.shapes import Shape

RUNS = [(program, shape) for program in PINNED for shape in SHAPES[program]]


@pytest.mark.slow
@pytest.mark.parametrize(("program", "shape"), RUNS, ids=[f"{program} {shape.name}" for program, shape in RUNS])
def test_programs_compute_the_exported_law(program: str, shape: Shape) -> None:
    python = interpreter(program)
    if python is None:
        pytest.skip(f"{program} cannot be installed here: pip install {' '.join(PINNED[program][1])}")
    exported = export_material(calibration(), program, usual(shape))
    found = press(program, python, exported, shape)
    assert found.program_error < 0.02
    assert found.law_error < GOAL


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_calculix_with_the_exported_card_agrees_with_our_elements(tmp_path: Path) -> None:
    assert np.abs(calculix_errors(tmp_path)).max() < 0.02
