"""Folders of results of calibrations, analyses, passports and validations, each written as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.effects import get_effect, written
from calibration.effects.private import load_effect
from calibration.inputs.deadline import NEVER, Deadline
from calibration.model.stages import Effect
from calibration.report.diagnosis_report import diagnosis_page
from calibration.report.figures import (
    USUAL,
    FigureChoice,
    FigureFolder,
    of_ageing,
    of_fit,
    of_history,
    of_presses,
    shown_presses,
)
from calibration.report.passport_report import passport_page
from calibration.report.report import calibration_page, comparison_page
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import HistoryRow, history
from calibration.tasks.compare import Comparison, as_comparison
from calibration.tasks.passport import Passport, check_sources, entry_of, passport_of, source_of, stored_entry
from calibration.tasks.session import HISTORY, History, Step, load_history, steps_of_comparison
from tactilevision.batch.tree import find_recordings
from tactilevision.errors import InputError
from tactilevision.files.ledger import folder_digest, read_ledger, write_ledger
from tactilevision.files.opening import linked, real_path
from tactilevision.files.writing import copy_own, plain_name, remove, staged, write_json, write_text
from tactilevision.pipeline import (
    Calibrated,
    CertifiedRecording,
    Listener,
    calibrate_each,
    certify_recordings,
    compare_recordings,
    diagnose_recording,
    height_residuals,
)
from tactilevision.plots import style
from tactilevision.plots.validation import Panel, Series, draw_validation
from tactilevision.recording import layout
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_curves, write_points, write_settings, write_table

if TYPE_CHECKING:
    from calibration.tasks.validate import Validation

CALIBRATION = "calibration.json"


@contextmanager
def replaced(out: Path, names: Sequence[str], figures: Sequence[str]) -> Iterator[Path]:
    """Stage results, then remove files of these names and figures that an earlier run left."""
    earlier = _found(out, names, figures)
    with staged(out) as stage:
        yield stage
        kept = {out / path.relative_to(stage) for path in stage.rglob("*")}
    for path in earlier:
        if path not in kept:
            remove(path)
            if path.parent != out and not any(path.parent.iterdir()):
                remove(path.parent)


def _found(folder: Path, names: Sequence[str], figures: Sequence[str]) -> list[Path]:
    """Return the files of these names, and of these figures in any form."""
    patterns = [*names, *(f"{figure}.{form}" for figure in figures for form in style.FORMS)]
    found = (path for pattern in patterns for path in sorted(folder.glob(pattern)))
    return [p for p in found if p.is_file() and not linked(folder, p.relative_to(folder).as_posix())]


# Calibrations: the newest in the folder itself, each older one in a folder of its own.


def write_calibrations(
    outcomes: Sequence[Calibrated], out: Path, *, law: str, choice: FigureChoice, listener: Listener
) -> tuple[HistoryRow, ...]:
    """Write tables, calibration.json, figures and the report of each; return how the stiffness has changed.

    Files of an earlier calibration that this one does not replace are removed: they would be taken for part of it.
    """
    own = [] if _holds_a_recording(out) else [layout.POINTS, layout.CURVES]
    figures = ("fit", "material", "history", "presses/*") if (out / CALIBRATION).exists() else ()
    rows: tuple[HistoryRow, ...] = ()
    with replaced(out, ["history.csv", *own] if figures else [], figures) as stage:
        for number, outcome in enumerate(outcomes, start=1):
            older = f"{number:02d}_{plain_name(outcome.certified.recording.name)}"
            place = Path() if outcome is outcomes[-1] else Path(older)
            _write_calibration(outcome, FigureFolder(stage / place, choice), listener)
            if not _holds_a_recording(out / place):
                _describe(outcome.certified, stage / place)
        measured = [one.certified.measured for one in outcomes if one.result is not None]
        if len(measured) > 1:
            rows = history(measured, law=law)
            flat = [row.as_row() for row in rows]
            write_table(stage / "history.csv", {column: [row[column] for row in flat] for column in flat[0]})
            of_history(rows, FigureFolder(stage, choice))
    return rows


def _write_calibration(outcome: Calibrated, figures: FigureFolder, listener: Listener) -> None:
    certified, result, folder = outcome.certified, outcome.result, figures.path
    certificate = certified.certificate
    if certified.points:
        write_points(folder, certified.points)
    if certificate is not None and certificate.curves:
        write_curves(folder, certificate.curves)
    write_json(folder / CALIBRATION, outcome.content)
    with listener.progress_bar("drawing") as progress:
        page = calibration_page(
            f"Calibration of {certified.recording.name}",
            result,
            points=certified.points,
            fit=of_fit(result, certified.points, folder=figures) if result is not None else [],
            presses=of_presses(
                certified.recording,
                certificate,
                shown=shown_presses(result, certificate.points, figures.choice),
                folder=figures,
                progress=progress,
            )
            if certificate
            else [],
            notes=certified.warnings if result is None else (),
            why=str(outcome.fault),
        )
    write_text(folder / "report.html", page)


def _holds_a_recording(folder: Path) -> bool:
    """Return whether recording.toml is somebody's own, not one that an earlier calibration left."""
    measured = any((folder / name).exists() for name in (layout.PRESSES, layout.FORCES, layout.FRAME_TABLE))
    return (folder / layout.SETTINGS).exists() and (measured or not (folder / CALIBRATION).exists())


def _describe(certified: CertifiedRecording, folder: Path) -> None:
    """Describe gel and indenters next to the points, so that the results are themselves a recording."""
    sensor = replace(certified.recording.sensor, rectification=None)  # there are no frames here to rectify
    write_settings(replace(certified.recording, path=folder, sensor=sensor))


# Analyses: a diagnosis or a comparison, and the steps taken back and put back.

BEFORE = "calibration_before.json"  # the calibration that --apply replaced
PAGES = ("report.html", "diagnosis.json", "comparison.json")
FIGURES = (
    *("error", "error_depth", "presses", "secant", "residuals", "modulus", "offsets", "reconstructed"),
    *("confusability", "height_map_*", "presses/sheet_*", "candidates/*"),
)
FIND, TRY = "to find what is missing", "to try"  # what a suggested command is for


def named_effects(names: Sequence[str | Path] | None) -> tuple[list[Effect], dict[str, str]]:
    """Return effects in the order named, by key or by the file of a private one, and the files by key."""
    effects, files = [], {}
    for name in names or ():
        own = str(name).endswith(".py")
        effects.append(load_effect(name) if own else get_effect(str(name)))
        if own:
            files[effects[-1].key] = str(real_path(name))
    return effects, files


def again_in(folder: Path) -> Path:
    """Return the folder of a repeated analysis, within what it repeats, which stays."""
    return real_path(folder) / "repeated"


def write_history(history: History, folder: Path, out: Path) -> None:
    """Write history.json, and the script that repeats its steps from wherever it is run; both end up in `out`."""
    history.save(folder / HISTORY)
    write_text(folder / "repeat.sh", history.script(again_in(out)))


@contextmanager
def _stage(
    out: Path, choice: FigureChoice, history: History, material: CalibrationResult | None
) -> Iterator[FigureFolder]:
    """Stage the results of an analysis with its history and, where that is applied, its material."""
    with staged(out) as stage:
        write_history(history, stage, out)
        if history.applied:
            _keep_calibration(out, stage)
            _write_material(material, stage)
        yield FigureFolder(stage, choice)
    _forget_found(out)


def _write_material(material: CalibrationResult | None, folder: Path) -> None:
    assert material is not None
    write_json(folder / CALIBRATION, material.as_json())


def write_diagnosis(
    found: Diagnosis,
    taken: Sequence[CertifiedRecording],
    history: History,
    *,
    out: Path,
    choice: FigureChoice,
    private: Sequence[Effect],
    commands: Sequence[str],
    listener: Listener,
) -> dict[str, Any]:
    """Write diagnosis.json, figures, page and history; return the content. `history.applied`: and the material."""
    reliefs = height_residuals(taken)
    content = found.as_json() | {"height_map": [c.as_json() for one in reliefs for c in one.covariates]}
    with _stage(out, choice, history, found.material.after) as folder:
        write_json(folder.path / "diagnosis.json", content)
        with listener.progress_bar("drawing") as progress:
            page = diagnosis_page(
                found, folder, private=private, reliefs=reliefs, commands=commands, progress=progress
            )
        write_text(folder.path / "report.html", page)
    return content


@dataclass(frozen=True, slots=True)
class Search:
    """How a diagnosis is done: private effects and known ones, their files by key, and by whom until when."""

    private: Sequence[Effect] = ()
    known: Sequence[Effect] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    deadline: Deadline = NEVER
    workers: int | None = 1
    cluster: str | None = None


def diagnose_as(
    asked: History, how: Search, *, out: Path, choice: FigureChoice = USUAL, listener: Listener
) -> tuple[Diagnosis, dict[str, Any], list[str]]:
    """Diagnose a history's recordings into `out`; return the diagnosis, what was written, and commands to try."""
    taken = certify_recordings(asked.recordings, scale_doubt=False, cluster=how.cluster, listener=listener)
    found = diagnose_recording(
        taken, effects=how.private, known=how.known, prior=asked.prior, seed=asked.seed, deadline=how.deadline,
        workers=how.workers, cluster=how.cluster, listener=listener,
    )  # fmt: skip
    steps = [Step(one.key, how.files.get(one.key, "")) for one in how.known]
    history = history_of(asked, [*steps, *steps_of_comparison(as_comparison(found), how.files)])
    commands = commands_after_diagnosis(found, asked, how.files)
    content = write_diagnosis(
        found, taken, history, out=out, choice=choice, private=how.private, commands=commands, listener=listener
    )
    return found, content, commands


def history_of(asked: History, steps: Sequence[Step]) -> History:
    """Return the history of these steps, which names its recordings wherever it is read."""
    paths = tuple(str(real_path(name)) for name in asked.recordings)
    return reduce(History.add, steps, replace(asked, recordings=paths))


def commands_after_diagnosis(found: Diagnosis, base: History, files: Mapping[str, str]) -> list[str]:
    """Return commands to try: each candidate; of an UNKNOWN the effect nearest to it."""
    fitted = {effect.key: written(effect) for effect in found.fits.fitted.model.effects}
    named = [fitted.get(effect.key, effect.key) for effect in found.effects]
    nearest = [] if found.remainder.nearest is None else found.remainder.nearest[0].split("+")
    sets = [[key] for key in found.candidates] if len(found.candidates) > len(named) else [named]
    return [base.with_effects(keys, files).command() for keys in (*sets, nearest) if keys]


def commands_after_comparison(found: Comparison, base: History, files: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return commands to try: a diagnosis of the base model alone, then effects; with their purpose."""
    added = [step.key for step in steps_of_comparison(found, files)]
    first = [] if added or base.left_out else [(FIND, base.command("diagnose"))]
    tried = {key: base.with_effects([*added, key], files).command() for key in found.suggested}
    return [*first, *((f"{TRY} {key.replace('_', ' ')}", text) for key, text in tried.items())]


def compare_as(
    asked: History, effects: Sequence[Effect], *, deadline: Deadline = NEVER, listener: Listener
) -> Comparison:
    """Return the comparison of a history's recordings with these effects."""
    how: dict[str, Any] = {"left_out": asked.left_out, "prior": asked.prior, "seed": asked.seed}
    return compare_recordings(asked.recordings, effects, **how, deadline=deadline, listener=listener)


def write_comparison(
    found: Comparison,
    history: History,
    *,
    out: Path,
    choice: FigureChoice = USUAL,
    try_next: Sequence[tuple[str, str]] = (),
    verdict: Sequence[str] = (),
    listener: Listener,
) -> None:
    """Write comparison.json, figures, page and history. `history.applied`: and the last model's material.

    `verdict`: that of a diagnosis and its caveats, for the page.
    """
    with _stage(out, choice, history, found.material) as folder:
        _fill_comparison(found, folder, listener, try_next=try_next, verdict=verdict)


def _fill_comparison(
    found: Comparison,
    folder: FigureFolder,
    listener: Listener,
    *,
    try_next: Sequence[tuple[str, str]] = (),
    verdict: Sequence[str] = (),
    state: str = "",
) -> None:
    write_json(folder.path / "comparison.json", found.as_json())
    with listener.progress_bar("drawing") as progress:
        page = comparison_page(found, folder, try_next=try_next, state=state, verdict=verdict, progress=progress)
    write_text(folder.path / "report.html", page)


def follow_steps(
    history: History, folder: Path, private: Sequence[Path] | None, *, choice: FigureChoice, listener: Listener
) -> None:
    """Make the folder's results those of the steps: as they were found where all stand, else fitted anew."""
    found = folder / layout.FOUND
    whole = not history.undone and found.is_dir() and not found.is_symlink()
    names = [*PAGES, *([CALIBRATION] if history.applied else [])]
    with replaced(folder, names, FIGURES) as stage:
        if whole:
            for path in _found(found, ["**/*"], ()):
                copy_own(path, stage / path.relative_to(found))
        else:
            _refit(history, folder, FigureFolder(stage, choice), private=private, listener=listener)
            if not found.is_dir():
                for path in _found(folder, names, FIGURES):
                    copy_own(path, stage / layout.FOUND / path.relative_to(folder))
        write_history(history, stage, folder)
    if whole:
        _forget_found(folder)


def _refit(
    history: History, folder: Path, figures: FigureFolder, *, private: Sequence[Path] | None, listener: Listener
) -> None:
    """Compare the recordings again with the steps that stand."""
    found = compare_as(history, _effects(history.steps, private), listener=listener)
    names = ", ".join(step.key.replace("_", " ") for step in reversed(history.undone))
    state = f"Taken back: {names}. `tactilevision steps {folder} --redo` puts it back."
    if (folder / "diagnosis.json").is_file() or (folder / layout.FOUND / "diagnosis.json").is_file():
        state += f" What the diagnosis found is kept in {layout.FOUND}/report.html."
    _fill_comparison(found, figures, listener, state=state)
    if history.applied and not history.steps and (folder / BEFORE).is_file():
        copy_own(folder / BEFORE, figures.path / CALIBRATION)
    elif history.applied:
        _write_material(found.material, figures.path)


def _effects(taken: Sequence[Step], private: Sequence[Path] | None) -> list[Effect]:
    """Return the effects of these steps; no file is run because a history names it."""
    own = {effect.key: effect for effect in named_effects(private)[0]}
    check_named(taken, own, what="an effect of your own is among the steps that stay", where="steps")
    return [own[step.key] if step.path else get_effect(step.key) for step in taken]


def check_named(steps: Sequence[Step], own: Mapping[str, object], *, what: str, where: str) -> None:
    """Raise InputError for a step with a private effect that is not among the `own`, whose files were named."""
    for step in steps:
        if step.path and step.key not in own:
            raise InputError(
                f"{what}, and its file is only run where you name it",
                where=where,
                value=step.key,
                remedy=f"Add --effect FILE.py; it was {step.path}.",
            )


def _keep_calibration(out: Path, stage: Path) -> None:
    """Keep the calibration that --apply is about to replace, unless an earlier --apply wrote it."""
    if not (out / CALIBRATION).is_file():
        return
    try:
        applied = load_history(out / HISTORY).applied
    except InputError:
        applied = False
    if not applied:
        copy_own(out / CALIBRATION, stage / BEFORE)


def _forget_found(folder: Path) -> None:
    """Remove the results kept of an analysis whose steps all stand, or that another one replaces."""
    remove(folder / layout.FOUND)


# Passports.


def write_passport(
    recordings: Sequence[Path],
    out: Path,
    *,
    ledger: Path | None = None,
    tolerance: float,
    choice: FigureChoice = USUAL,
    listener: Listener,
) -> Passport:
    """Write passport.html, passport.json and a figure of a sensor's gel; its entries are added to the `ledger`.

    `recordings` are in order of time, or folders of them. Those that are in the ledger are not calibrated again.
    `tolerance` is the relative error of E that is tolerated. Raises InputError as `check_sources` does, and for a
    ledger that is damaged.
    """
    found_in = ([read_recording(path) for path in find_recordings(given)] for given in recordings)
    opened = [one for group in found_in for one in sorted(group, key=lambda one: str(one.date or ""))]
    sources = [source_of(one, folder_digest(one.path)) for one in opened]
    stored = [] if ledger is None else read_ledger(ledger, sources[0].sensor)
    known = [stored_entry(content, where=ledger) for content in stored]
    have = {one.sha256 for one in known}
    fresh = [k for k, one in enumerate(sources) if one.sha256 not in have]
    check_sources(sources)
    check_sources([*known, *(sources[k] for k in fresh)])
    entries = list(known)
    for place in fresh:
        (done,) = calibrate_each([opened[place]], listener=listener)
        certificate = done.certified.certificate
        curves = certificate.curves if certificate else done.certified.measured.curves
        radius_mm = next((one.own.radius_mm for one in entries if one.own is not None), None)
        measured, told = done.certified.measured, (done.content, done.result)
        entries.append(entry_of(sources[place], measured, *told, curves=curves, radius_mm=radius_mm))
    found = passport_of(entries, tolerance=tolerance)
    with staged(out) as stage:
        figure = of_ageing(found, FigureFolder(stage, choice))
        write_json(stage / "passport.json", found.as_json())
        write_text(stage / "passport.html", passport_page(found, figure))
        if ledger is not None:
            write_ledger(ledger, [one.as_json() for one in entries])
    return found


# Validations by finite elements.


def write_validation(found: Validation, out: Path, form: str) -> dict[str, Any]:
    """Write validation.json and a figure of depths and one of forces; return the content."""
    from calibration.tasks.validate import as_json  # with finite elements, which take a while

    content = as_json(found)
    with staged(out) as stage:
        write_json(stage / "validation.json", content)
        _draw_validation(found, stage, form)
    return content


def _draw_validation(found: Validation, folder: Path, form: str) -> None:
    samples, laws = found.samples, list(dict.fromkeys(one.law for one in found.comparisons))
    for name, quantity, title, measured, pick in (
        ("depth_at_equal_force", "depth (mm)", "Depths at the measured forces", samples.depth_mm, "depth"),
        ("force_at_equal_depth", "force (N)", "Forces at the measured depths", samples.force_N, "force"),
    ):
        solved = "fem_depth_mm" if pick == "depth" else "fem_force_N"
        panels = []
        for law in laws:
            ofs = [one for one in found.comparisons if one.law == law]
            series = [Series(one.name, getattr(one, solved), getattr(one, f"{pick}_error")) for one in ofs]
            panels.append(Panel(law.title(), samples.depth_mm, measured, series))
        style.save_figure(draw_validation(panels, quantity, title=title), folder / f"{name}.png", form=form)
