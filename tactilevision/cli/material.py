"""Command `export-material`: the gel as a material and contact law of another program."""

from __future__ import annotations

from tactilevision.cli import console, options
from tactilevision.export.material import ExportedMaterial, ExportSettings, export_material as exported_material
from tactilevision.export.shapes import Shape
from tactilevision.files.writing import staged
from tactilevision.plots.export import draw_export
from tactilevision.plots.style import save_figure
from tactilevision.records.measured import Estimate


def export_material(given: options.ExportMaterial) -> None:
    """Write a calibrated gel's parameters for a simulator or finite-element program, with their errors."""
    shape = Shape(given.shape, given.radius_mm, given.length_mm)
    stated = (given.depths_mm, given.friction, given.density, given.mass, given.taxel_mm, given.largest_nu)
    found = exported_material(given.calibration, given.to, ExportSettings(shape, *stated))
    with staged(given.out) as folder:
        found.write(folder)
        if found.compared:
            save_figure(draw_export(found), folder / "material.png")
    program = found.program
    console.say(f"{program.title} {found.version} ({program.checked}): {given.out / program.file}")
    console.say(*(_line(name, one) for name, one in found.parameters.items()))
    console.say(*_errors(found))
    console.warn(found.warnings)
    console.hand_over(found.as_json(), given.json)


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
