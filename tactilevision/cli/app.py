"""The command line application; the module of a command is imported when the command is called."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import wraps
from importlib import import_module
from inspect import Parameter, signature
from types import SimpleNamespace
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from tactilevision.cli import console
from tactilevision.errors import InputError, installed_version
from tactilevision.files import cache
from tactilevision.files.runs import output_lock

Entry = tuple[str, str, str, str]  # module, function, option that names the results to be locked, summary
GROUPS: Mapping[str, Mapping[str, Entry]] = {
    "Height maps and forces": {
        "depth": ("depth", "depth", "out", "Turn frames into height maps."),
        "view": ("view", "view", "out", "Draw, compare, film and export height maps."),
        "force": ("depth", "force", "out", "Turn frames into maps of traction on the gel."),
        "live": ("live", "live", "", "Read frames live: depth, contact and wrench."),
    },
    "Young's modulus and Poisson's ratio": {
        "calibrate": ("calibrate", "calibrate", "out", "Certify presses and fit E and nu of the gel."),
        "passport": ("calibrate", "passport", "out", "Follow a gel over weeks, and say when to recalibrate."),
        "plan": ("calibrate", "plan", "", "Find the fewest presses that reach a goal."),
        "export-material": ("material", "export_material", "out", "Write the gel for simulators and FE programs."),
        "validate": ("simulate", "validate", "out", "Compare a calibration with finite elements."),
    },
    "What a model lacks": {
        "workbench": ("analysis", "workbench", "out", "See where the model fails and mend it, in the browser."),
        "diagnose": ("analysis", "diagnose", "out", "Find the effect that is missing from the model."),
        "compare": ("analysis", "compare", "out", "Add effects one by one and watch the error fall."),
        "steps": ("analysis", "steps", "folder", "List the steps of an analysis; undo and redo them."),
        "new-effect": ("analysis", "new_effect", "", "Write a template of an effect of your own."),
    },
    "Sensors": {
        "calibrate-sensor": ("train", "calibrate_sensor", "out file", "Write a sensor's profile for --sensor."),
        "train": ("train", "train", "out file", "Calibrate a photometric method for --method FILE."),
    },
    "Robot logs and data sets": {
        "import": ("logs", "import_log", "out", "Convert a log of ROS 1, ROS 2 or MCAP to a recording."),
        "export": ("logs", "export_log", "out file", "Write depth and force to a log."),
        "lerobot": ("logs", "lerobot", "out", "Add depth, contact and force to a LeRobot data set."),
    },
    "Simulation": {
        "simulate": ("simulate", "simulate", "out", "Simulate a recording with known truth."),
        "tabulate": ("simulate", "tabulate", "out", "Solve a grid of punch problems for a table."),
    },
}
COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}
RENAMED = {  # by command and the option that it does not have: what to write instead
    ("compare", "--effect"): "Add an effect by --with KEY or --with FILE.py; `diagnose --effect` offers one.",
    ("plan", "--out"): "Use --json FILE.",
    ("tabulate", "--processes"): "Use --workers.",
    **{(name, "--scheduler"): "Use --cluster ADDRESS." for name in COMMANDS},
}
HELP = {"help_option_names": ["-h", "--help"]}


class Command(TyperCommand):
    """A command that names the option that was meant where an unknown one is given."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options. Raises InputError for one of an earlier name."""
        for given in args:
            option = given.partition("=")[0]
            if remedy := RENAMED.get((str(self.name), option)):
                raise InputError("there is no such option", where=f"{self.name} {option}", remedy=remedy)
        try:
            return super().parse_args(ctx, args)
        except Exception as fault:
            if meant := getattr(fault, "possibilities", None):
                fault.message = f"{fault.message}. Did you mean {' or '.join(meant)}?"  # type: ignore[attr-defined]
                fault.possibilities = None  # type: ignore[attr-defined]
            raise


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
        alone.command(cmd_name, cls=Command, context_settings=HELP)(_prepared(command, *results.split()))
        return get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the summaries by group."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(f"{name:16}", summary) for name, (*_, summary) in commands.items()])

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Return the commands that begin so, without importing them, and the program's own options."""
        named = [(name, summary) for name, (*_, summary) in COMMANDS.items() if name.startswith(incomplete)]
        found = [SimpleNamespace(value=name, type="plain", help=summary) for name, summary in named]
        return [*found, *super(TyperGroup, self).shell_complete(ctx, incomplete)]


def _prepared(command: Callable[..., None], into: str = "", kind: str = "folder") -> Callable[..., None]:
    """Return the command with --quiet, which locks its folder (or file) of results against other runs."""

    @wraps(command)
    def run(*, quiet: bool, **given: Any) -> None:
        with output_lock(given[into], file=kind == "file") if into else nullcontext():
            command(**given)

    own = signature(command, eval_str=True)
    last = Parameter("quiet", Parameter.KEYWORD_ONLY, default=False, annotation=console.QuietOption)
    run.__signature__ = own.replace(parameters=[*own.parameters.values(), last])  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "quiet": console.QuietOption}
    return run


app = typer.Typer(
    cls=Commands,
    help="Mechanics you can trust from vision-based tactile sensors.",
    no_args_is_help=True,
    context_settings=HELP,
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
