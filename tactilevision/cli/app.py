"""All commands under one name. Each lives in its own file; this one only gathers them."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import typer

from tactilevision.cli import calibrate, depth, diagnose, force, plan, simulate, tabulate, train, validate, view

app = typer.Typer(
    help="Mechanics you can trust from vision-based tactile sensors.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("calibrate")(calibrate.calibrate)
app.command("depth")(depth.depth)
app.command("view")(view.view)
app.command("diagnose")(diagnose.diagnose)
app.command("compare")(diagnose.compare)
app.command("steps")(diagnose.steps)
app.command("new-effect")(diagnose.new_effect)
app.command("force")(force.force)
app.command("plan")(plan.plan)
app.command("validate")(validate.validate)
app.command("tabulate")(tabulate.tabulate)
app.command("train")(train.train)
app.command("simulate")(simulate.simulate)


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
