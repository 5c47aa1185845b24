"""Command `export-material`: the gel as a material and contact law of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console
from tactilevision.export.material import ExportedMaterial, ExportSettings, export_material as exported_material
from tactilevision.export.programs import PROGRAMS
from tactilevision.export.shapes import Shape, ShapeName
from tactilevision.files.writing import staged
from tactilevision.plots.export import draw_export
from tactilevision.plots.style import save_figure
from tactilevision.records.measured import Estimate


def export_material(
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="The calibration.json of `calibrate`.")
    ],
    to: Annotated[
        str, typer.Option(metavar="PROGRAM", help=f"Name it, or PROGRAM==VERSION: {', '.join(PROGRAMS)}.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the results into this folder.")] = Path(
        "material"
    ),
    shape: Annotated[ShapeName, typer.Option(help="Fit the contact law to this shape.")] = "ball",
    radius_mm: Annotated[float, typer.Option(help="Radius of the shape in mm.")] = 4.0,
    length_mm: Annotated[float, typer.Option(help="Length of a ridge in mm.")] = 10.0,
    depths_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Fit from one depth to another, in mm; by default .05 to .2 thicknesses."),
    ] = None,
    friction: Annotated[float | None, typer.Option(help="State the coefficient of friction.")] = None,
    density: Annotated[float | None, typer.Option(help="State the gel's density in kg/m³.")] = None,
    mass: Annotated[float, typer.Option(help="Mass of the pressing body in kg, for MuJoCo.")] = 0.1,
    taxel_mm: Annotated[float, typer.Option(help="Distance of taxels in mm, for Genesis and Isaac.")] = 0.25,
    largest_nu: Annotated[
        float | None, typer.Option(help="Bound Poisson's ratio of the solid; E is then that of this ratio.")
    ] = None,
    json: console.JsonOption = None,
) -> None:
    """Write a calibrated gel's parameters for a simulator or finite-element program, with their errors."""
    contact = ExportSettings(
        Shape(shape, radius_mm, length_mm), depths_mm, friction, density, mass, taxel_mm, largest_nu
    )
    found = exported_material(calibration, to, contact)
    with staged(out) as folder:
        found.write(folder)
        if found.compared:
            save_figure(draw_export(found), folder / "material.png")
    console.say(f"{found.program.title} {found.version} ({found.program.checked}): {out / found.program.file}")
    console.say(*(_line(name, one) for name, one in found.parameters.items()))
    console.say(*_errors(found))
    console.warn(found.warnings)
    console.hand_over(found.as_json(), json)


def _line(name: str, one: Estimate) -> str:
    low_high = "" if one.interval95 is None else " [{:.4g}, {:.4g}]".format(*one.interval95)
    return f"  {name} = {one.value:.5g}{low_high} {one.unit if one.unit != '1' else ''}".rstrip()


def _errors(found: ExportedMaterial) -> list[str]:
    """Return a line for each shape: the largest error of the law's force."""
    lines = []
    for k, one in enumerate(found.compared):
        error = one.why or f"{100 * one.largest_error:+.1f} %"
        lines.append(f"  {'fitted' if k == 0 else 'not fitted'}: {one.shape}: {error}")
    return lines
