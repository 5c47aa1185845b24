"""The command line application with all commands."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer

from tactilevision.cli import calibrate, compare, depth, diagnose, live, logs, simulate, train, view, workbench
from tactilevision.files.runs import output_lock

app = typer.Typer(
    help="Mechanics you can trust from vision-based tactile sensors.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def alone(command: Callable[..., None], *, into: str = "out", file: bool = False) -> Callable[..., None]:
    """Return the command, which locks its folder (or file) of results against other runs."""

    @wraps(command)
    def run(**given: Any) -> None:
        with output_lock(given[into], file=file):
            command(**given)

    return run


app.command("calibrate")(alone(calibrate.calibrate))
app.command("calibrate-sensor")(alone(train.calibrate_sensor, file=True))
app.command("depth")(alone(depth.depth))
app.command("view")(alone(view.view))
app.command("diagnose")(alone(diagnose.diagnose))
app.command("compare")(alone(compare.compare_effects))
app.command("steps")(alone(compare.steps, into="folder"))
app.command("workbench")(alone(workbench.workbench))
app.command("new-effect")(diagnose.new_effect)
app.command("live")(live.live)
app.command("force")(alone(depth.force))
app.command("import")(alone(logs.import_log))
app.command("export")(alone(logs.export_log, file=True))
app.command("lerobot")(alone(logs.lerobot))
app.command("plan")(calibrate.plan)
app.command("validate")(alone(simulate.validate))
app.command("tabulate")(alone(simulate.tabulate))
app.command("train")(alone(train.train, file=True))
app.command("simulate")(alone(simulate.simulate))


def show_version(wanted: bool) -> None:
    """Print the version and stop."""
    if wanted:
        try:
            typer.echo(f"tactilevision {version('tactilevision')}")
        except PackageNotFoundError:
            typer.echo("tactilevision (not installed)")
        raise typer.Exit


@app.callback()
def options(
    shows_version: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Mechanics you can trust from vision-based tactile sensors."""
