"""`tactilevision steps`: the steps of an analysis, taken back and put back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import again_in
from tactilevision.cli.compare import step_errors


def steps(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What diagnose or compare wrote.")],
    undo: Annotated[bool, typer.Option("--undo", help="Take the last step back.")] = False,
    redo: Annotated[bool, typer.Option("--redo", help="Put back the step taken back last.")] = False,
) -> None:
    """The steps of an analysis: show them, take one back, and write the script that repeats them (repeat.sh)."""
    from calibration.session import load_history
    from tactilevision.files import write_text

    history = load_history(folder / "history.json")
    if undo:
        history = history.undo()
    if redo:
        history = history.redo()
    history.save(folder / "history.json")
    script = history.script(again_in(folder))
    write_text(folder / "repeat.sh", script)
    for number, step in enumerate(history.steps, start=1):
        console.say(f"{number}. + {step.key.replace('_', ' ')}: {step_errors(step)}")
    for step in reversed(history.undone):
        console.say(f"   taken back: {step.key.replace('_', ' ')}")
    console.say(script.splitlines()[-1])
