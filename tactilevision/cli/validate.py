"""`tactilevision validate PATH`: finite elements against the measured depths and forces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.measure import Taken, beside_the_punch, take

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.tasks.validate import Validation
    from tactilevision.records import Estimate, Material, Pair

CALIBRATION = "calibration.json"


def validate(
    path: Annotated[
        Path,
        typer.Argument(metavar="PATH", help="A recording (frames, points or curves), or what calibrate wrote."),
    ],
    out: console.OutOption = Path("validation_out"),
    calibration: Annotated[
        Path | None,
        typer.Option(help="calibration.json with E and nu; else the one in PATH, else it is calibrated first."),
    ] = None,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
) -> None:
    """Compare with finite elements at the measured forces and depths, for each friction and law.

    Says where the error follows the depth. Cases beyond the shipped table are solved on the spot, which takes
    some seconds each.
    """
    from calibration.report import validation_report as report
    from calibration.tasks.calibrate import observe
    from calibration.tasks.validate import validate as compare
    from tactilevision.files import staged, write_json

    _check_presses(path)
    taken, bulge = beside_the_punch(take([path])[0])
    data = observe([taken.measured])
    material = _material(taken, calibration, bulge)
    with console.progress_bar("finite elements") as progress:
        found = compare(data, material, progress=progress)
    content = report.as_json(found)
    with staged(out) as stage:
        write_json(stage / "validation.json", content)
        _draw(found, stage, form)
    for law in dict.fromkeys(one.law for one in found.comparisons):
        console.say(*report.table(found, law), "")
    console.say(*report.statements(found), *(f"assumed: {line}" for line in found.assumptions))
    console.say(f"wrote {out / 'validation.json'} and the figures beside it")
    console.hand_over(content, json)


def _check_presses(path: Path) -> None:
    """Raise for what `calibrate` wrote of curves: it holds E and nu, and no presses."""
    from tactilevision.errors import InputError
    from tactilevision.recording import layout

    tables = (layout.POINTS, layout.CURVES, layout.FRAME_TABLE)
    if (path / CALIBRATION).is_file() and not any((path / name).exists() for name in tables):
        raise InputError(
            "the presses are not here: this was calibrated from curves",
            where=path,
            remedy=f"Name the recording itself, with --calibration {path / CALIBRATION}.",
        )


def _material(taken: Taken, calibration: Path | None, bulge: Estimate | None) -> Material:
    """As stated, as found beside the points, or calibrated now: at the middle of what is not fixed."""
    from tactilevision.force.calibrated import read_material

    beside = taken.recording.path / CALIBRATION
    if calibration is not None or beside.is_file():
        return read_material(calibration or beside)
    from calibration.tasks.calibrate import calibrate

    clock = taken.certificate.clock_offset if taken.certificate else None
    result = calibrate(taken.measured, clock_offset=clock, bulge=bulge)
    if result.material is not None:
        return result.material
    return _middle(result.poisson_ratio.interval95, result.youngs_modulus_of_nu)


def _middle(interval: Pair | None, modulus_of_nu: Sequence[Pair]) -> Material:
    """Where the data leave nu open: the middle of its interval, and E at the fitted stiffness there.

    The two vary together along E(nu), by the interval's width.
    """
    import numpy as np

    from tactilevision.records import Material

    nus, moduli = np.array(modulus_of_nu).T
    low, high = interval if interval is not None else (nus[0], nus[-1])
    nu = (low + high) / 2
    console.warn([f"the data do not fix nu: the middle of its interval, {nu:.3f}, is taken, and E that fits it"])
    ends = np.array([np.interp((low, high), nus, moduli), (low, high)])
    std = np.diff(ends)[:, 0] / 3.92
    return Material(float(np.interp(nu, nus, moduli)), min(nu, 0.4999), np.outer(std, std))


def _draw(found: Validation, folder: Path, form: str) -> None:
    from tactilevision.plots import style
    from tactilevision.plots.validation import Panel, Series, draw_validation

    samples, laws = found.samples, list(dict.fromkeys(one.law for one in found.comparisons))
    for name, quantity, title, measured, pick in (
        ("depth_at_equal_force", "depth (mm)", "Depths at the measured forces", samples.depth_mm, 0),
        ("force_at_equal_depth", "force (N)", "Forces at the measured depths", samples.force_N, 1),
    ):
        panels = []
        for law in laws:
            series = [
                Series(
                    one.name, (one.fem_depth_mm, one.fem_force_N)[pick], (one.depth_error, one.force_error)[pick]
                )
                for one in found.comparisons
                if one.law == law
            ]
            panels.append(Panel(law.title(), samples.depth_mm, measured, series))
        style.save_figure(draw_validation(panels, quantity, title=title), folder / f"{name}.png", form=form)
