"""Exports of the gel: laws against closed forms, intervals, the bound of nu, and what is refused."""

from __future__ import annotations

import ast
import json
import math
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from benchmarks.simulators import calibration
from tactilevision.cli import main, shared_options
from tactilevision.errors import InputError
from tactilevision.export.laws import Fitted, fit
from tactilevision.export.material import GOAL, ExportedMaterial, ExportSettings, export_material
from tactilevision.export.programs import PROGRAMS
from tactilevision.export.shapes import Shape, ShapeName
from tactilevision.mechanics.ridge_contact import Ridge, ridge_at
from tactilevision.mechanics.round_contact import contact_curve
from tactilevision.plots.export import draw_export


@cache
def usual(program: str) -> ExportedMaterial:
    """The usual ball: the curves of five shapes take half a second."""
    return export_material(calibration(), program)


SPRINGS = {"per_depth": 1e8, "offset": 0.0}


def test_a_wide_ridge_on_a_thin_layer_rests_on_springs() -> None:
    """F/L = (2/3) (M/h) b^3/R of a Winkler foundation, M the constrained modulus; b is 40 thicknesses here."""
    nu, h, radius, half = 0.3, 0.025, 100.0, 1.0
    depth, force = ridge_at(Ridge(radius, 1.0), half, thickness_mm=h, poisson_ratio=nu)
    constrained = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert depth == pytest.approx(half**2 / (2 * radius), rel=0.02)
    assert force == pytest.approx(2 / 3 * constrained / h * half**3 / radius, rel=0.02)


def test_a_narrow_ridge_is_hertz() -> None:
    """F/L = pi E* b^2/(4 R) on a half-space."""
    found = contact_curve(Ridge(100.0, 2.0), [0.0005], thickness_mm=30.0, poisson_ratio=0.48)
    half = found.contact_radius_mm[0]
    expected = 2.0 * math.pi * half**2 / (400.0 * (1 - 0.48**2))
    assert found.force_over_E_mm2[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("shape", [Shape("ball", 4.0), Shape("flat", 2.5), Shape("ridge", 4.0, 10.0)])
@pytest.mark.parametrize("kind", ["pressure", "taxels"])
def test_forces_on_springs_are_their_sum(kind: Any, shape: Shape) -> None:
    """Closed forms against the plain sum over a grid of springs, 10 um apart."""
    r, w, pitch = shape.radius_mm, 0.4, 0.01
    x, y = np.meshgrid(*(np.arange(-2.6, 2.6, pitch) + pitch / 2,) * 2)
    away = np.abs(y) if shape.name == "ridge" else np.hypot(x, y)
    length = shape.length_mm / 5.2 if shape.name == "ridge" else 1.0
    if shape.name == "flat":
        depth = np.where(away < r, np.minimum(w, r - away) if kind == "taxels" else w, 0)
        up = np.where(depth < w, 0.0, 1.0)
    elif kind == "taxels":
        distance = np.hypot(away, r - w)
        depth, up = np.maximum(r - distance, 0), (r - w) / distance
    else:
        sag = r - np.sqrt(np.maximum(r**2 - away**2, 0))
        depth, up = np.maximum(w - sag, 0), np.ones_like(away)
    expected = 1e8 * (depth * up).sum() * pitch**2 * length * 1e-9
    law = Fitted(kind, SPRINGS, "per_depth")
    assert law.force_N(shape, np.array([w]))[0] == pytest.approx(expected, rel=5e-3)


def test_a_law_finds_its_own_parameters() -> None:
    depth = np.geomspace(0.15, 0.6, 20)
    truth = Fitted("pressure", {"per_depth": 1.4e8, "offset": 2e-5}, "per_depth")
    found = fit("pressure", Shape(), depth, truth.force_N(Shape(), depth))
    assert found.values == pytest.approx(truth.values, rel=1e-4)


@pytest.mark.parametrize("program", [name for name, one in PROGRAMS.items() if one.law])
def test_laws_meet_the_layer_at_the_fitted_ball_and_no_other_shape(program: str) -> None:
    found = usual(program)
    assert abs(found.compared[0].largest_error) < GOAL
    assert min(abs(one.largest_error) for one in found.compared[1:]) > GOAL
    assert found.warnings == ()


def test_intervals_follow_e() -> None:
    drake = usual("drake").parameters
    modulus = drake["hydroelastic_modulus"]
    assert modulus.value is not None
    assert modulus.interval95 == pytest.approx((0.98 * modulus.value, 1.02 * modulus.value))
    assert drake["slab_thickness"].interval95 is None
    inverse = usual("abaqus").parameters["D1"]
    assert inverse.value is not None
    assert inverse.interval95 == pytest.approx((inverse.value / 1.02, inverse.value / 0.98))


def test_a_bound_of_nu_takes_e_at_that_nu() -> None:
    soft = calibration() | {"poisson_ratio": {"value": 0.4999, "std": 0.001, "unit": "1"}}
    soft["youngs_modulus_MPa"] = {"value": 0.177, "std": 0.001, "interval95": [0.175, 0.179], "unit": "MPa"}
    found = export_material(soft, "genesis")
    assert (found.solid.poisson_ratio, found.solid.youngs_modulus_MPa) == pytest.approx((0.49, 0.189))
    assert "nu 0.49" in " ".join(found.warnings)
    assert export_material(soft, "abaqus").solid.poisson_ratio == 0.4999
    with pytest.raises(InputError, match="E at that nu is not known"):
        export_material(soft | {"youngs_modulus_of_nu": []}, "genesis")


@pytest.mark.parametrize("program", PROGRAMS)
def test_texts_are_what_programs_parse(program: str, tmp_path: Path) -> None:
    settings = ExportSettings(friction=0.6, density_kg_m3=1070.0)
    found = export_material(calibration(), program, settings)
    found.write(tmp_path)
    text = (tmp_path / found.program.file).read_text()
    if found.program.file.endswith(".py"):
        ast.parse(text)
    elif found.program.file.endswith((".xml", ".feb")):
        ElementTree.fromstring(text)  # noqa: S314 (our own text)
    else:
        assert "*HYPERELASTIC" in text
    assert "1070" in text or "1.07e-09" in text
    unstated = usual(program)
    assert "1070" not in unstated.text
    assert any("not stated" in line for line in unstated.assumptions)
    content = json.loads((tmp_path / "material.json").read_text())
    assert content["checked"] in ("verified by running", "checked as text")
    assert (content["program"], content["version"]) == (found.program.title, found.program.versions[0])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--to", "drak"), "Did you mean drake?"),
        (("--to", "drake==1.2"), "the contact law of this version of Drake was not read"),
        (("--to", "drake", "--depths-mm", "0.1", "3.5"), "the depth exceeds the gel's thickness"),
        (("--to", "drake", "--depths-mm", "0.1", "0.9"), "beyond a quarter of the gel's thickness"),
        (("--to", "drake", "--depths-mm", "0.5", "0.1"), "the smaller first"),
        (("--to", "drake", "--shape", "flat", "--radius-mm", "9"), "this is beyond the table"),
        (("--to", "mujoco", "--mass", "0"), "the mass is a finite number above 0"),
        (("--to", "drake", "--friction", "nan"), "friction is a finite number"),
    ],
)
def test_bad_options_are_named(
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert refused(calibration(), arguments, tmp_path, monkeypatch) == 2
    assert said in capsys.readouterr().err
    assert not list((tmp_path / "out").glob("*.*"))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"youngs_modulus_MPa": {"value": None, "why": "one press"}}, "E is not determined: one press"),
        ({"youngs_modulus_MPa": {"value": 200, "unit": "kPa"}}, "another unit"),
        ({"verdict": "ADEQUATE", "youngs_modulus_MPa": None}, "youngs_modulus_MPa is missing"),
        ({"gel": None}, "the gel's thickness is missing"),
    ],
)
def test_other_calibrations_are_refused(
    changed: dict[str, Any],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert refused(calibration() | changed, ("--to", "drake"), tmp_path, monkeypatch) == 2
    assert said in capsys.readouterr().err


def refused(
    content: dict[str, Any], arguments: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> int:
    path = folder / "calibration.json"
    path.write_text(json.dumps(content))
    line = ["tactilevision", "export-material", str(path), *arguments, "--out", str(folder / "out")]
    monkeypatch.setattr(sys, "argv", line)
    return main()


def test_the_command_writes_a_picture_beside_the_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(calibration(), ("--to", "mujoco==4.0"), tmp_path, monkeypatch) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"gel.xml", "material.json", "material.png"}
    printed = capsys.readouterr().out
    assert "fitted: ball of 4 mm radius" in printed
    assert "not fitted: flat punch of 2 mm radius" in printed


def test_a_shape_outside_the_table_is_drawn_without_its_curve() -> None:
    narrow = export_material(calibration(), "drake", ExportSettings(Shape("ball", 1.0)))
    flat = next(one for one in narrow.compared if one.shape.name == "flat")
    assert flat.why
    assert math.isnan(flat.largest_error)
    assert len(draw_export(narrow).axes[1].lines) == 1 + len(narrow.compared) - 1


def test_the_command_line_knows_the_shapes_and_the_programs() -> None:
    assert get_args(shared_options.ShapeName) == get_args(ShapeName)
    assert shared_options.PROGRAMS.split(", ") == list(PROGRAMS)
