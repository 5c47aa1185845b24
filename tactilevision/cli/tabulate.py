"""`tactilevision tabulate OUT`: solve a grid of punch problems and make a table of them."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from tactilevision.mechanics.tables.cases import Grid
    from tactilevision.mechanics.tables.tabulate import Progress

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
    from tactilevision.mechanics.tables.merge import merge
    from tactilevision.mechanics.tables.tabulate import tabulate as solve

    grid = _grid(law, friction, poisson_ratio, a_over_h, edge_over_h)
    cases, folder = list(grid.cases()), out / "cases"
    with _workers(processes, cluster) as workers, console.progress_bar("solving") as bar:

        def report(progress: Progress) -> None:
            bar(progress.done, progress.total, f"({_words(progress.left_s)} left)")

        now = solve(cases, folder, workers=workers, report=report)
    merge(cases, folder, out=out / "punch.npz", notes={"grid": _card(grid)})
    console.say(f"{len(cases)} cases, {now} of them solved now; wrote {out / 'punch.npz'}, its card and punch.csv")
    console.hand_over({"cases": len(cases), "solved_now": now, "table": str(out / "punch.npz")}, json)


def _workers(processes: int | None, cluster: str | None) -> AbstractContextManager[Executor | None]:
    from tactilevision.cluster.pool import cluster_pool
    from tactilevision.mechanics.tables import tabulate as method

    if cluster is not None:
        return cluster_pool(cluster)
    return nullcontext() if processes == 1 else method.processes(processes)


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


def _words(seconds: float) -> str:
    return f"about {seconds / 3600:.1f} h" if seconds > 5400 else f"about {math.ceil(seconds / 60)} min"


def _card(grid: Grid) -> dict[str, object]:
    from dataclasses import asdict

    return {
        key: ["inf" if value == math.inf else value for value in values] for key, values in asdict(grid).items()
    }
