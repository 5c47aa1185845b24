"""The command line application; the module of a command is imported when the command is called."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from tactilevision.errors import installed_version
from tactilevision.files import cache
from tactilevision.files.runs import output_lock

COMMANDS = {  # module, function, option that names the results to be locked, summary
    "calibrate": ("calibrate", "calibrate", "out", "Certify presses; fit Young's modulus and Poisson's ratio."),
    "calibrate-sensor": ("train", "calibrate_sensor", "out file", "Write a sensor profile for --sensor FILE.tvs."),
    "depth": ("depth", "depth", "out", "Turn frames into height maps."),
    "view": ("view", "view", "out", "Draw a height map."),
    "diagnose": ("analysis", "diagnose", "out", "Find out what is missing from the model."),
    "compare": ("analysis", "compare", "out", "Add effects one after the other and watch the error."),
    "steps": ("analysis", "steps", "folder", "Show the steps of an analysis, take one back, put one back."),
    "workbench": ("analysis", "workbench", "out", "Find where the model fails, in the browser on this machine."),
    "new-effect": ("analysis", "new_effect", "", "Write a template of an effect of your own."),
    "live": ("live", "live", "", "Read frames live: depth, contact and wrench."),
    "force": ("depth", "force", "out", "Turn frames into maps of traction on the gel."),
    "import": ("logs", "import_log", "out", "Convert a log of ROS 1, ROS 2 or MCAP to a recording."),
    "export": ("logs", "export_log", "out file", "Write depth and force to a log."),
    "lerobot": ("logs", "lerobot", "out", "Write a data set of LeRobot with depth, contact and force added."),
    "plan": ("calibrate", "plan", "", "Find the fewest presses that reach a goal."),
    "validate": ("simulate", "validate", "out", "Compare with finite elements at the measured forces and depths."),
    "tabulate": ("simulate", "tabulate", "out", "Solve a grid of punch problems and make a table of them."),
    "train": ("train", "train", "out file", "Calibrate a photometric method for --method FILE."),
    "simulate": ("simulate", "simulate", "out", "Simulate a recording with known truth."),
}


class Commands(TyperGroup):
    """The commands by name, each imported when it is asked for."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands: Any = dict.fromkeys(COMMANDS)  # the names, to list and to suggest

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        module, function, results, _ = COMMANDS[cmd_name]
        command = getattr(import_module(f"tactilevision.cli.{module}"), function)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name)(_locked(command, *results.split()) if results else command)
        return get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the summaries."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (*_, summary) in COMMANDS.items()])


def _locked(command: Callable[..., None], into: str, kind: str = "folder") -> Callable[..., None]:
    """Return the command, which locks its folder (or file) of results against other runs."""

    @wraps(command)
    def run(**given: Any) -> None:
        with output_lock(given[into], file=kind == "file"):
            command(**given)

    return run


app = typer.Typer(
    cls=Commands,
    help="Mechanics you can trust from vision-based tactile sensors.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def show_version(wanted: bool) -> None:
    """Print the version and stop."""
    if wanted:
        typer.echo(f"tactilevision {installed_version('tactilevision') or '(not installed)'}")
        raise typer.Exit


@app.callback()
def options(
    shows_version: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
    cached: Annotated[
        bool,
        typer.Option("--cache/--no-cache", help="Keep calibrated light and tables of the gel for the next run."),
    ] = True,
) -> None:
    """Mechanics you can trust from vision-based tactile sensors."""
    if not cached:
        os.environ[cache.VARIABLE] = cache.OFF  # of the workers, too
