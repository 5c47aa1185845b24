"""Run the commands `compare` and `steps`: effects added, removed and compared by error."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import (
    LeftOut,
    Private,
    Recordings,
    Seed,
    Settings,
    TimeLimit,
    again_in,
    keep_history,
    named_effects,
    next_commands,
    write_history,
)

if TYPE_CHECKING:
    from calibration.model.stages import Effect
    from calibration.report.report import Pictures
    from calibration.tasks.compare import Compared, Comparison
    from calibration.tasks.session import History, Step
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.records.misfit import ErrorFall


# A comparison written into its folder: numbers, figures and page.


def write_comparison(
    found: Comparison,
    folder: FigureFolder,
    *,
    title: str,
    try_next: Sequence[tuple[str, str]] = (),
    state: str = "",
) -> None:
    """comparison.json, the figures and report.html. `try_next`: what for, and how."""
    from calibration.report.misfit import error_fall_of_comparison, error_fall_of_picture
    from calibration.report.report import comparison_page
    from tactilevision.files.writing import write_json, write_text

    write_json(folder.path / "comparison.json", content_of(found))
    both = [error_fall_of_comparison(found), *error_fall_of_picture(found.pictured)]
    falls = sorted(both, key=lambda fall: (len(fall.models) == 1, fall.reached))  # what changes, then what is off
    page = comparison_page(
        title, found, falls, pictures=_pictures(found, falls, folder), try_next=try_next, state=state
    )
    write_text(folder.path / "report.html", page)


def content_of(found: Comparison) -> list[dict[str, object]]:
    """The content of comparison.json: the last model of the force names the plain errors worth a try."""
    content = found.as_json()
    content[-1]["suggested"] = list(found.suggested)
    return [*content, *(_of_picture(model, found.pictured[0]) for model in found.pictured)]


def _of_picture(model: Compared, base: Compared) -> dict[str, object]:
    """Print a model of the reconstructed depth."""
    from calibration.diagnosis.vision_depth_check import face_error_mm

    return {
        "name": model.name,
        "effects": list(model.effects),
        "parameters": {name: estimate.as_json() for name, estimate in model.parameters},
        "rms_error_mm": {
            "held_out_before": base.held_out_N,
            "held_out_after": model.held_out_N,
            "floor": model.repeatability_N,
            "faces_before": face_error_mm(base.fitted),
            "faces_after": face_error_mm(model.fitted),
        },
    }


def _pictures(found: Comparison, falls: Sequence[ErrorFall], folder: FigureFolder) -> Pictures:
    from calibration.report.misfit import force_curves, model_names, residual_strips
    from calibration.report.report import Pictures
    from tactilevision.cli import pictures as keep

    names = model_names([model.effects for model in found.models])
    fits = dict(zip(names, (model.fitted for model in found.models), strict=True))
    moduli = [model.material.youngs_modulus for model in found.models if model.material is not None]
    curves = force_curves(fits)
    with console.progress_bar("drawing") as progress:
        return Pictures(
            fall=keep.keep_falls(falls, folder),
            presses=keep.keep_presses(curves, found.models[0].fitted.data.gel.thickness_mm, folder),
            strips=keep.keep_strips(residual_strips(fits, [model.covariates for model in found.models]), folder),
            moduli=keep.keep_moduli(names, moduli, folder),
            every_press=keep.keep_every_press(curves, folder, progress),
        )


# `tactilevision steps`: the steps of an analysis, taken back and put back, and the folder with them.

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
    from calibration.tasks.session import load_history

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
    from tactilevision.files.writing import staged

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
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.pipeline import certify_recordings, compare_recordings

    effects = _effects(history.steps, private)
    taken = certify_recordings(history.recordings, scale_doubt=False, listener=console)
    left_out, prior, seed = history.left_out, history.prior, history.seed
    result = compare_recordings(taken, effects, left_out=left_out, prior=prior, seed=seed, listener=console)
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
    from tactilevision.files.writing import write_json

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
    from calibration.tasks.session import load_history
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


# `tactilevision compare`: effects added one after the other, and what that does to the error.

Chosen = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        "--effect",
        metavar="KEY|FILE.py",
        help="An effect to add, in this order: a key, or the file of one of your own, which is run.",
    ),
]


def compare_effects(
    recordings: Recordings,
    out: console.OutOption = Path("comparison_out"),
    chosen: Chosen = None,
    prior: console.PriorOption = True,
    seed: Seed = 0,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
    time_limit: TimeLimit = None,
    left_out: LeftOut = None,
) -> None:
    """Add effects one after the other and watch the error, on presses left out, beside the repeatability."""
    from calibration.inputs.deadline import Deadline
    from calibration.tasks.session import steps_of_comparison
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.files.writing import staged
    from tactilevision.pipeline import certify_recordings, compare_recordings

    deadline, aside = Deadline.after(time_limit), tuple(left_out or ())
    effects, files = named_effects(chosen)
    taken = certify_recordings(recordings, scale_doubt=False, listener=console)
    found = compare_recordings(
        taken, effects, left_out=aside, prior=prior, seed=seed, deadline=deadline, listener=console
    )
    commands = next_commands(recordings, found, files, prior=prior, left_out=aside)
    title = "Comparison of " + ", ".join(one.recording.name for one in taken)
    passed_over = [f"{key} is excluded: {why}" for key, why in found.left_out]
    with staged(out) as stage:
        write_comparison(found, FigureFolder(stage, form), title=title, try_next=commands)
        steps = steps_of_comparison(found, files)
        keep_history(recordings, steps, stage, out=out, settings=Settings(seed, prior, left_out=aside))
    forget_found(out)
    console.warn(passed_over)
    console.say(*lines_of(found), *passed_over, *(f"{words}: {text}" for words, text in commands))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(content_of(found), json)


def lines_of(found: Comparison) -> list[str]:
    """One line a model: its name, its error and the repeatability."""
    from calibration.report.report import column

    return [
        *(_model_line(column(model), model) for model in found.models),
        *(_picture_line(column(model), model) for model in found.pictured),
    ]


def _picture_line(name: str, model: Compared) -> str:
    from calibration.diagnosis.vision_depth_check import face_error_mm

    error, repeats = (f"{1e3 * one:.1f} µm" for one in (model.held_out_N, model.repeatability_N))
    if model.fitted.data.slopes is not None:
        error = f"{error} outside the faces, {1e3 * face_error_mm(model.fitted):.1f} µm at the faces"
    return f"{name:24s} error on presses left out {error}, repeatability {repeats}"


def _model_line(name: str, model: Compared) -> str:
    from calibration.report import wording

    error = wording.fit_error(model.held_out_N, model.rms_N)
    E = "" if model.material is None else f", E {wording.estimate(model.material.youngs_modulus)}"
    return f"{name:24s} {error}, {wording.repeatability(model.repeatability_N)}{E}"
