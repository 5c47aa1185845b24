"""`tactilevision steps`: the steps of an analysis, taken back and put back, and the folder with them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import (
    ANSWERED,
    Private,
    again_in,
    named_effects,
    observed,
    treated,
    with_nu,
    write_history,
)
from tactilevision.cli.measure import take

if TYPE_CHECKING:
    from calibration.model.stages import Effect
    from calibration.session import History, Step
    from calibration.tasks.compare import Comparison

FOUND = "as_found"  # folder with the results of all steps, while some are taken back
BEFORE = "calibration_before.json"  # the calibration that --apply replaced
PAGES = ("report.html", "diagnosis.json", "comparison.json")
FIGURES = (
    "error",
    "error_depth",
    "presses",
    "secant",
    "residuals",
    "modulus",
    "offsets",
    "reconstructed",
    "confusability",
    "height_map_*",
    "presses/sheet_*",
    "candidates/*",
)


def steps(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What diagnose or compare wrote.")],
    undo: Annotated[bool, typer.Option("--undo", help="Take the last step back.")] = False,
    redo: Annotated[bool, typer.Option("--redo", help="Put back the step taken back last.")] = False,
    private: Private = None,
    form: console.FormatOption = console.FigureFormat.PNG,
) -> None:
    """The steps of an analysis: show them, take one back, put one back; the folder's results follow.

    With an effect of your own among the steps that stay, name its file again.
    """
    from calibration.session import load_history

    history = load_history(folder / "history.json")
    if undo or redo:
        history = history.undo() if undo else history
        history = history.redo() if redo else history
        _follow(history, folder, private, form)
    for number, step in enumerate(history.steps, start=1):
        console.say(f"{number}. + {step.key.replace('_', ' ')}: {step_errors(step)}")
    for step in reversed(history.undone):
        console.say(f"   taken back: {step.key.replace('_', ' ')}")
    console.say(history.script(again_in(folder)).splitlines()[-1])


def _follow(history: History, folder: Path, private: Sequence[Path] | None, form: str) -> None:
    """Make the folder's results those of the steps: as they were found where all stand, else fitted anew."""
    from tactilevision.files import staged

    found = folder / FOUND
    whole = not history.undone and found.is_dir()
    before = list(_results(folder, history))
    with staged(folder) as stage:
        if whole:
            shutil.copytree(found, stage, dirs_exist_ok=True)
        else:
            _refit(history, folder, stage, private=private, form=form)
            if not found.is_dir():
                for path in before:
                    _copy(path, stage / FOUND / path.relative_to(folder))
        write_history(history, stage, folder)
        kept = {folder / path.relative_to(stage) for path in stage.rglob("*")}
    for path in before:
        if path not in kept:
            path.unlink(missing_ok=True)
            if path.parent != folder and not any(path.parent.iterdir()):
                path.parent.rmdir()
    if whole:
        forget_found(folder)


def _refit(history: History, folder: Path, stage: Path, *, private: Sequence[Path] | None, form: str) -> None:
    """The recordings again, with the steps that stand."""
    import numpy as np

    from calibration.laws.flat_punch import elastomer_bound
    from calibration.tasks.compare import compare
    from tactilevision.cli.comparison import write_comparison
    from tactilevision.cli.pictures import FigureFolder

    effects = _effects(history.steps, private)
    taken, bulge = with_nu(take([Path(name) for name in history.recordings], answered=ANSWERED))
    rng = np.random.default_rng(history.seed)
    data, again = observed(taken, history.left_out), treated(taken, effects, history.left_out)
    with console.progress_bar("fitting") as progress:
        bound = elastomer_bound(history.prior)
        result = compare(data, effects, rng=rng, bulge=bulge, bound=bound, treated=again, progress=progress)
    names = ", ".join(step.key.replace("_", " ") for step in reversed(history.undone))
    state = f"Taken back: {names}. `tactilevision steps {folder} --redo` puts it back."
    if (folder / "diagnosis.json").is_file() or (folder / FOUND / "diagnosis.json").is_file():
        state += f" What the diagnosis found is kept in {FOUND}/report.html."
    title = "Comparison of " + ", ".join(one.recording.name for one in taken)
    write_comparison(result, FigureFolder(stage, form), title=title, state=state)
    if history.applied:
        _restore_calibration(history, result, folder, stage)


def _restore_calibration(history: History, result: Comparison, folder: Path, stage: Path) -> None:
    """The calibration that --apply replaced where no step stands, else the one with those that do."""
    from tactilevision.files import write_json

    if not history.steps and (folder / BEFORE).is_file():
        _copy(folder / BEFORE, stage / "calibration.json")
        return
    material = result.models[-1].material
    assert material is not None
    write_json(stage / "calibration.json", material.as_json())


def _effects(taken: Sequence[Step], private: Sequence[Path] | None) -> list[Effect]:
    """The effects of these steps; no file is run because a history names it."""
    from calibration.effects import get_effect
    from tactilevision.errors import InputError

    own = {effect.key: effect for effect in named_effects(private)[0]}
    for step in taken:
        if step.path and step.key not in own:
            raise InputError(
                "an effect of your own is among the steps that stay, and its file is only run where you name it",
                where="steps",
                value=step.key,
                remedy=f"Add --effect FILE.py; it was {step.path}.",
            )
    return [own[step.key] if step.path else get_effect(step.key) for step in taken]


def _results(folder: Path, history: History) -> Iterator[Path]:
    """What diagnose and compare have written there, the history aside."""
    from tactilevision.plots.style import FORMS

    names = [*PAGES, *(["calibration.json"] if history.applied else [])]
    names += [f"{figure}.{form}" for figure in FIGURES for form in FORMS]
    for name in names:
        yield from sorted(path for path in folder.glob(name) if path.is_file() and not path.is_symlink())


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)


def keep_calibration(out: Path, stage: Path) -> None:
    """Keep the calibration that --apply is about to replace, unless an earlier --apply wrote it."""
    from calibration.session import load_history
    from tactilevision.errors import InputError

    if not (out / "calibration.json").is_file():
        return
    try:
        applied = load_history(out / "history.json").applied
    except InputError:
        applied = False
    if not applied:
        _copy(out / "calibration.json", stage / BEFORE)


def forget_found(folder: Path) -> None:
    """Remove the results kept of an analysis whose steps all stand, or that another one replaces."""
    if (folder / FOUND).is_dir() and not (folder / FOUND).is_symlink():
        shutil.rmtree(folder / FOUND)


def step_errors(step: Step) -> str:
    """What a step did to the error; on the presses fitted where none could be left out, or none was on file."""
    from calibration.report import wording

    if step.unit == "mm":
        held = 1e3 * step.held_out_before_N, 1e3 * step.held_out_after_N
        return f"error of the picture's depth on presses left out from {held[0]:.1f} to {held[1]:.1f} um"
    if not isfinite(step.held_out_after_N):
        return f"rms {1e3 * step.rms_before_N:.2f} -> {1e3 * step.rms_after_N:.2f} mN"
    fall = f"from {1e3 * step.held_out_before_N:.1f} to {1e3 * step.held_out_after_N:.1f} mN"
    return f"error on presses left out {fall}, {wording.repeatability(step.repeatability_N)}"
