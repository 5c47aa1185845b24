"""Run the commands `simulate`, `tabulate` and `validate`: numerical solutions of contacts."""

from __future__ import annotations

import math
import os
from contextlib import nullcontext
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from calibration.tasks.validate import Validation
    from tactilevision.mechanics.tables.cases import Grid


# `tactilevision simulate OUT`: a recording with known truth.


class Frames(StrEnum):
    """What a simulated recording holds."""

    PNG = "png"
    JPEG = "jpeg"
    CURVES = "curves"
    POINTS = "points"


def simulate(
    out: Annotated[Path, typer.Argument(help="Folder of the recording; made if missing.")],
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recording.")] = 0,
    frames: Annotated[
        Frames, typer.Option(help="Format of the pictures; curves or points: no pictures.")
    ] = Frames.PNG,
    presses: Annotated[int | None, typer.Option(min=1, help="Good presses with each indenter.")] = None,
    youngs_modulus: Annotated[float | None, typer.Option(help="True Young's modulus in MPa.")] = None,
    poisson_ratio: Annotated[float | None, typer.Option(help="True Poisson's ratio.")] = None,
    faults: Annotated[bool, typer.Option(help="Add one bad press of every kind.")] = True,
    markers: Annotated[bool, typer.Option(help="Print markers on the gel.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps, strips of 12 by 2 mm, cast shadows.")] = False,
) -> None:
    """Simulate a recording: gel, camera, rig and their faults; truth.toml says what was put in."""
    from tactilevision.synthetic.lights import SHADOW_STRIP_MM
    from tactilevision.synthetic.options import SimulationOptions
    from tactilevision.synthetic.simulation import simulate as run

    options = SimulationOptions(frames=frames.value)
    gel = options.gel
    if youngs_modulus is not None:
        gel = replace(gel, youngs_modulus_MPa=youngs_modulus)
    if poisson_ratio is not None:
        gel = replace(gel, poisson_ratio=poisson_ratio)
    options = replace(options, gel=gel, camera=replace(options.camera, markers=markers))
    if shadows:
        options = replace(options, camera=replace(options.camera, shadow_strip_mm=SHADOW_STRIP_MM))
    if presses is not None:
        options = replace(options, presses=presses)
    if not faults:
        options = replace(options, faults=())
    with console.progress_bar("rendering") as progress:
        folder = run(out, seed=seed, options=options, progress=progress)
    console.say(f"wrote {folder}: a recording with seed {seed}; its truth is in {folder / 'truth.toml'}")


# `tactilevision tabulate OUT`: solve a grid of punch problems and make a table of them.

Numbers = Annotated[str | None, typer.Option(metavar="LIST", help="Numbers with commas between.")]


def tabulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the cases and the table; go on in it.")],
    law: Annotated[str | None, typer.Option(metavar="LIST", help="neo-hooke, hencky.")] = None,
    friction: Annotated[
        str | None, typer.Option(metavar="LIST", help="Coulomb's coefficients; inf for no slip.")
    ] = None,
    poisson_ratio: Numbers = None,
    a_over_h: Numbers = None,
    edge_over_h: Numbers = None,
    processes: Annotated[int | None, typer.Option(min=1, help="How many; left out: all cores.")] = None,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", "--scheduler", metavar="ADDRESS", help="A Dask cluster, or its scheduler file."),
    ] = None,
    json: console.JsonOption = None,
) -> None:
    """Solve the flat punch over nu, a/h, depth, friction, law and edge radius; writes OUT/punch.npz and its card.

    Each solved case is a file of its own in OUT/cases: a run that is stopped, or killed, goes on where it was.
    What is left out of the options spans what the shipped table does: some 1000 cases of a few seconds each.
    """
    from tactilevision.mechanics.tables.solve import tabulate as solve
    from tactilevision.mechanics.tables.table import merge

    grid = _grid(law, friction, poisson_ratio, a_over_h, edge_over_h)
    cases, folder = list(grid.cases()), out / "cases"
    with _workers(processes, cluster) as workers, console.progress_bar("solving") as progress:
        now = solve(cases, folder, workers=workers, report=progress)
    merge(cases, folder, out=out / "punch.npz", notes={"grid": _card(grid)})
    console.say(f"{len(cases)} cases, {now} of them solved now; wrote {out / 'punch.npz'}, its card and punch.csv")
    console.hand_over({"cases": len(cases), "solved_now": now, "table": str(out / "punch.npz")}, json)


def _workers(processes: int | None, cluster: str | None) -> AbstractContextManager[Executor | None]:
    from tactilevision.cluster.pool import cluster_pool
    from tactilevision.files.runs import worker_pool

    if cluster is not None:
        return cluster_pool(cluster)
    return nullcontext() if processes == 1 else worker_pool(processes or len(os.sched_getaffinity(0)))


def _grid(
    law: str | None, friction: str | None, poisson_ratio: str | None, a_over_h: str | None, edge_over_h: str | None
) -> Grid:
    from tactilevision.mechanics.tables.cases import Grid
    from tactilevision.mechanics.tables.solve import LAWS

    usual = Grid()
    laws = usual.laws if law is None else tuple(part.strip() for part in law.split(","))
    unknown = sorted(set(laws) - {one.name for one in LAWS})
    if unknown:
        raise InputError(
            "no such law",
            where="--law",
            value=", ".join(unknown),
            remedy="There are " + ", ".join(one.name for one in LAWS) + ".",
        )
    return Grid(
        laws=laws,
        frictions=_numbers("--friction", friction, usual.frictions, (0.0, math.inf)),
        poisson_ratios=_numbers("--poisson-ratio", poisson_ratio, usual.poisson_ratios, (0.0, 0.4999)),
        a_over_h=_numbers("--a-over-h", a_over_h, usual.a_over_h, (0.05, 3.0)),
        edges_over_h=_numbers("--edge-over-h", edge_over_h, usual.edges_over_h, (1e-3, 0.2)),
    )


def _numbers(
    name: str, text: str | None, usual: tuple[float, ...], bounds: tuple[float, float]
) -> tuple[float, ...]:
    """Numbers between commas, as a grid takes them."""
    if text is None:
        return usual
    try:
        values = tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError as fault:
        raise InputError("a list of numbers with commas between is needed", where=name, value=text) from fault
    if not all(bounds[0] <= value <= bounds[1] for value in values):
        raise InputError(f"lies beyond {bounds[0]:g} to {bounds[1]:g}", where=name, value=text)
    return values


def _card(grid: Grid) -> dict[str, object]:
    from dataclasses import asdict

    return {
        key: ["inf" if value == math.inf else value for value in values] for key, values in asdict(grid).items()
    }


# `tactilevision validate PATH`: finite elements against the measured depths and forces.

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
    from calibration.tasks import validate as report
    from tactilevision.files.writing import staged, write_json
    from tactilevision.pipeline import validate_recording

    _check_presses(path)
    found = validate_recording(path, calibration=calibration, listener=console)
    content = report.as_json(found)
    with staged(out) as stage:
        write_json(stage / "validation.json", content)
        _draw(found, stage, form)
    for law in dict.fromkeys(one.law for one in found.comparisons):
        console.say(*report.table(found, law), "")
    console.say(*report.statements(found), *(f"assumed: {line}" for line in found.assumptions))
    console.say(f"wrote {out / 'validation.json'} and the figures next to it")
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
