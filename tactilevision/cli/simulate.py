"""Commands `simulate`, `tabulate` and `validate`: numerical solutions of contacts."""

from __future__ import annotations

import math
import os
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from calibration.tasks import validate as report
from tactilevision.cli import console
from tactilevision.cluster.pool import cluster_pool
from tactilevision.errors import InputError, check_known
from tactilevision.files.runs import worker_pool
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.mechanics.tables.cases import Grid
from tactilevision.mechanics.tables.solve import LAWS, tabulate as solve
from tactilevision.mechanics.tables.table import merge
from tactilevision.pipeline import validate_recording
from tactilevision.recording import layout
from tactilevision.records.constants import NU_MAX
from tactilevision.records.rig import stated
from tactilevision.result_folders import CALIBRATION, write_validation
from tactilevision.synthetic.lights import SHADOW_STRIP_MM
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.simulation import simulate as run

# `tactilevision simulate OUT`: a recording with known truth.


def simulate(
    out: Annotated[Path, typer.Argument(help="Write the recording into this folder.")],
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recording.")] = 0,
    frames: Annotated[
        Literal["png", "jpeg", "curves", "points"],
        typer.Option(help="Choose the format of the pictures. With curves or points there are none."),
    ] = "png",
    presses: Annotated[int | None, typer.Option(min=1, help="Make so many with each indenter.")] = None,
    youngs_modulus: Annotated[float | None, typer.Option(help="Set the true modulus in MPa.")] = None,
    poisson_ratio: Annotated[float | None, typer.Option(help="Set the true ratio.")] = None,
    faults: Annotated[bool, typer.Option(help="Add one bad press of every kind.")] = True,
    markers: Annotated[bool, typer.Option(help="Print markers on the gel.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps, strips of 12 by 2 mm, cast shadows.")] = False,
) -> None:
    """Simulate a recording: gel, camera, rig and their faults; truth.toml says what was put in."""
    usual = SimulationOptions()
    options = stated(
        usual,
        frames=frames,
        gel=stated(usual.gel, youngs_modulus_MPa=youngs_modulus, poisson_ratio=poisson_ratio),
        camera=replace(usual.camera, markers=markers, shadow_strip_mm=SHADOW_STRIP_MM if shadows else None),
        presses=presses,
        faults=None if faults else (),
    )
    with console.progress_bar("rendering") as progress:
        folder = run(out, seed=seed, options=options, progress=progress)
    console.say(f"wrote {folder}: a recording with seed {seed}; its truth is in {folder / 'truth.toml'}")


# `tactilevision tabulate OUT`: solve a grid of punch problems and make a table of them.

Numbers = Annotated[str | None, typer.Option(metavar="LIST", help="List numbers, with commas between.")]


def tabulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of cases and table; a second run goes on.")],
    law: Annotated[str | None, typer.Option(metavar="LIST", help="Solve for neo-hooke, hencky.")] = None,
    friction: Annotated[
        str | None, typer.Option(metavar="LIST", help="Solve for these coefficients; inf: no slip.")
    ] = None,
    poisson_ratio: Numbers = None,
    a_over_h: Numbers = None,
    edge_over_h: Numbers = None,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    json: console.JsonOption = None,
) -> None:
    """Solve the flat punch over nu, a/h, depth, friction, law and edge radius; writes OUT/punch.npz and its card.

    Each solved case is a file of its own in OUT/cases: a run that is stopped, or killed, goes on where it was.
    Omitted options span what the shipped table does: some 1000 cases of a few seconds each.
    """
    grid = _grid(law, friction, poisson_ratio, a_over_h, edge_over_h)
    cases, folder = list(grid.cases()), out / "cases"
    with _workers(workers, cluster) as pool, console.progress_bar("solving") as progress:
        now = solve(cases, folder, workers=pool, report=progress)
    merge(cases, folder, out=out / "punch.npz", notes={"grid": _card(grid)})
    console.say(f"{len(cases)} cases, {now} of them solved now; wrote {out / 'punch.npz'}, its card and punch.csv")
    console.hand_over({"cases": len(cases), "solved_now": now, "table": str(out / "punch.npz")}, json)


def _workers(workers: int | None, cluster: str | None) -> AbstractContextManager[Executor | None]:
    if cluster is not None:
        return cluster_pool(cluster)
    return nullcontext() if workers == 1 else worker_pool(workers or len(os.sched_getaffinity(0)))


def _grid(
    law: str | None, friction: str | None, poisson_ratio: str | None, a_over_h: str | None, edge_over_h: str | None
) -> Grid:
    usual = Grid()
    laws = usual.laws if law is None else tuple(part.strip() for part in law.split(","))
    for name in laws:
        check_known(name, [one.name for one in LAWS], what="no such law", where="--law")
    return Grid(
        laws=laws,
        frictions=_within("--friction", friction, usual.frictions, (0.0, math.inf)),
        poisson_ratios=_within("--poisson-ratio", poisson_ratio, usual.poisson_ratios, (0.0, NU_MAX)),
        a_over_h=_within("--a-over-h", a_over_h, usual.a_over_h, (A_OVER_H_RANGE[0], 3)),
        edges_over_h=_within("--edge-over-h", edge_over_h, usual.edges_over_h, (1e-3, 0.2)),
    )


def _within(
    name: str, text: str | None, usual: tuple[float, ...], bounds: tuple[float, float]
) -> tuple[float, ...]:
    """Return the numbers of a list, or the usual ones. Raises InputError for one beyond the bounds."""
    values = console.numbers(name, text)
    if not all(bounds[0] <= value <= bounds[1] for value in values):
        raise InputError(f"lies beyond {bounds[0]:g} to {bounds[1]:g}", where=name, value=text)
    return values or usual


def _card(grid: Grid) -> dict[str, object]:
    return {
        key: ["inf" if value == math.inf else value for value in values] for key, values in asdict(grid).items()
    }


# `tactilevision validate PATH`: finite elements against the measured depths and forces.


def validate(
    path: Annotated[
        Path,
        typer.Argument(metavar="PATH", help="A recording (frames, points or curves), or what calibrate wrote."),
    ],
    out: console.OutOption = Path("validation_out"),
    calibration: Annotated[
        Path | None, typer.Option(help="Take E and nu from calibration.json; by default of PATH.")
    ] = None,
    form: console.FormatOption = "png",
    json: console.JsonOption = None,
) -> None:
    """Compare with finite elements at the measured forces and depths, for each friction and law.

    Says where the error follows the depth. Cases beyond the shipped table are solved on the spot, which takes
    some seconds each.
    """
    _check_presses(path)
    found = validate_recording(path, calibration=calibration, listener=console)
    content = write_validation(found, out, form)
    for law in dict.fromkeys(one.law for one in found.comparisons):
        console.say(*report.table(found, law), "")
    console.say(*report.statements(found), *(f"assumed: {line}" for line in found.assumptions))
    console.say(f"wrote {out / 'validation.json'} and the figures next to it")
    console.hand_over(content, json)


def _check_presses(path: Path) -> None:
    """Raise for what `calibrate` wrote of curves: it holds E and nu, and no presses."""
    tables = (layout.POINTS, layout.CURVES, layout.FRAME_TABLE)
    if (path / CALIBRATION).is_file() and not any((path / name).exists() for name in tables):
        raise InputError(
            "the presses are not here: this was calibrated from curves",
            where=path,
            remedy=f"Name the recording itself, with --calibration {path / CALIBRATION}.",
        )
