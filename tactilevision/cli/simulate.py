"""Commands `simulate`, `tabulate` and `validate`: numerical solutions of contacts."""

from __future__ import annotations

import math
import os
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path

from calibration.tasks import validate as report
from tactilevision.cli import console, options
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


def simulate(given: options.Simulate) -> None:
    """Simulate a recording: gel, camera, rig and their faults; truth.toml says what was put in."""
    usual, strip_mm = SimulationOptions(), SHADOW_STRIP_MM if given.shadows else None
    wanted = stated(
        usual,
        frames=given.frames,
        gel=stated(usual.gel, youngs_modulus_MPa=given.youngs_modulus, poisson_ratio=given.poisson_ratio),
        camera=replace(usual.camera, markers=given.markers, shadow_strip_mm=strip_mm),
        presses=given.presses,
        faults=None if given.faults else (),
    )
    with console.progress_bar("rendering") as progress:
        folder = run(given.out, seed=given.seed, options=wanted, progress=progress)
    console.say(f"wrote {folder}: a recording with seed {given.seed}; its truth is in {folder / 'truth.toml'}")


def tabulate(given: options.Tabulate) -> None:
    """Solve a grid of punch problems and make a table of them."""
    grid = _grid(given.law, given.friction, given.poisson_ratio, given.a_over_h, given.edge_over_h)
    cases, folder, table = list(grid.cases()), given.out / "cases", given.out / "punch.npz"
    with _workers(given.workers, given.cluster) as pool, console.progress_bar("solving") as progress:
        now = solve(cases, folder, workers=pool, report=progress)
    merge(cases, folder, out=table, notes={"grid": _card(grid)})
    console.say(f"{len(cases)} cases, {now} of them solved now; wrote {table}, its card and punch.csv")
    console.hand_over({"cases": len(cases), "solved_now": now, "table": str(table)}, given.json)


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


def validate(given: options.Validate) -> None:
    """Compare with finite elements at the measured forces and depths, for each friction and law."""
    _check_presses(given.path)
    found = validate_recording(given.path, calibration=given.calibration, listener=console)
    content = write_validation(found, given.out, given.form)
    for law in dict.fromkeys(one.law for one in found.comparisons):
        console.say(*report.table(found, law), "")
    console.say(*report.statements(found), *(f"assumed: {line}" for line in found.assumptions))
    console.say(f"wrote {given.out / 'validation.json'} and the figures next to it")
    console.hand_over(content, given.json)


def _check_presses(path: Path) -> None:
    """Raise for what `calibrate` wrote of curves: it holds E and nu, and no presses."""
    tables = (layout.POINTS, layout.CURVES, layout.FRAME_TABLE)
    if (path / CALIBRATION).is_file() and not any((path / name).exists() for name in tables):
        raise InputError(
            "the presses are not here: this was calibrated from curves",
            where=path,
            remedy=f"Name the recording itself, with --calibration {path / CALIBRATION}.",
        )
