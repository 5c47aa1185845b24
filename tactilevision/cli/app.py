"""The command line application; the module of a command is imported when the command is called."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from inspect import Signature, get_annotations, signature
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from tactilevision.cli import options as records
from tactilevision.cli.shared_options import Options
from tactilevision.errors import InputError, installed_version
from tactilevision.files.runs import output_lock

Entry = tuple[type[Options], str]  # what a command takes, and a summary
GROUPS: Mapping[str, Mapping[str, Entry]] = {
    "Height maps and forces": {
        "depth": (records.Depth, "Turn frames into height maps."),
        "view": (records.View, "Draw, compare, film and export height maps."),
        "force": (records.Force, "Turn frames into maps of traction on the gel."),
        "live": (records.Live, "Read frames live: depth, contact and wrench."),
    },
    "Young's modulus and Poisson's ratio": {
        "calibrate": (records.Calibrate, "Certify presses and fit E and nu of the gel."),
        "passport": (records.Passport, "Follow a gel over weeks, and say when to recalibrate."),
        "plan": (records.Plan, "Find the fewest presses that reach a goal."),
        "export-material": (records.ExportMaterial, "Write the gel for simulators and FE programs."),
        "validate": (records.Validate, "Compare a calibration with finite elements."),
    },
    "What a model lacks": {
        "workbench": (records.Workbench, "See where the model fails and mend it, in the browser."),
        "diagnose": (records.Diagnose, "Find the effect that is missing from the model."),
        "compare": (records.Compare, "Add effects one by one and watch the error fall."),
        "steps": (records.Steps, "List the steps of an analysis; undo and redo them."),
        "new-effect": (records.NewEffect, "Write a template of an effect of your own."),
    },
    "Sensors": {
        "calibrate-sensor": (records.CalibrateSensor, "Write a sensor's profile for --sensor."),
        "train": (records.Train, "Calibrate a photometric method for --method FILE."),
    },
    "Robot logs and data sets": {
        "import": (records.ImportLog, "Convert a log of ROS 1, ROS 2 or MCAP to a recording."),
        "export": (records.ExportLog, "Write depth and force to a log."),
        "lerobot": (records.Lerobot, "Add depth, contact and force to a LeRobot data set."),
    },
    "Simulation": {
        "simulate": (records.Simulate, "Simulate a recording with known truth."),
        "tabulate": (records.Tabulate, "Solve a grid of punch problems for a table."),
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
    """The commands by name; the module of each is imported when it runs."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands: Any = dict.fromkeys(COMMANDS)  # the names, to list and to suggest

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name, cls=Command, context_settings=HELP)(_prepared(COMMANDS[cmd_name][0]))
        return get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the summaries by group."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(f"{name:16}", summary) for name, (_, summary) in commands.items()])

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Return the commands that begin so, without importing them, and the program's own options."""
        named = [(name, summary) for name, (_, summary) in COMMANDS.items() if name.startswith(incomplete)]
        found = [SimpleNamespace(value=name, type="plain", help=summary) for name, summary in named]
        return [*found, *super(TyperGroup, self).shell_complete(ctx, incomplete)]


def _prepared(taken: type[Options]) -> Callable[..., None]:
    """Return the command as typer takes it, with a lock on its folder (or file) of results against other runs."""

    def run(**given: Any) -> None:
        command = resolve_name(f"tactilevision.cli.{taken.function}")
        into, _, file = taken.results.partition(" ")
        with output_lock(given[into], file=bool(file)) if into else nullcontext():
            command(taken(**given))

    named, there = (name for kind in taken.__mro__ for name in get_annotations(kind)), signature(taken).parameters
    hints = get_type_hints(taken, include_extras=True)
    own_first = [there[name].replace(annotation=hints[name]) for name in dict.fromkeys(named) if name in there]
    run.__signature__ = Signature(own_first)  # type: ignore[attr-defined]
    run.__annotations__, run.__doc__ = hints, taken.__doc__
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
        from tactilevision.files import cache

        os.environ[cache.VARIABLE] = cache.OFF  # of the workers, too
