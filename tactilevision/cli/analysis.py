"""Commands `diagnose`, `compare`, `steps`, `new-effect` and `workbench`: what a model lacks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import typer

from calibration.diagnosis.vision_depth_check import face_error_mm
from calibration.effects.private import new_effect as write_template
from calibration.inputs.deadline import Deadline, Progress
from calibration.report import wording
from calibration.report.diagnosis_report import summary
from calibration.report.figures import FigureChoice
from calibration.report.headline import fall_sentence
from calibration.report.misfit import error_falls
from calibration.report.report import column
from calibration.tasks.compare import Compared
from calibration.tasks.session import History, Step, load_history, steps_of_comparison
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.opened import Frames, Opened, file_marks
from calibration.workbench.server import Server, plotly
from tactilevision import result_folders as folders
from tactilevision.cli import console, options
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.files.cache import remember, remembered
from tactilevision.files.opening import real_path
from tactilevision.pipeline import (
    CertifiedRecording,
    certify_recordings,
    observed,
    read_recordings,
    sharpest_poisson_ratio,
)
from tactilevision.records.constants import KILO, NU_SILICONE

PAGE = "page"  # what is remembered of a workbench: its port and token


def diagnose(given: options.Diagnose) -> None:
    """Find out what is missing from the model: which effect, how sure, and what to measure next."""
    deadline = Deadline.after(given.time_limit)
    (sure, sure_files), (own, own_files) = folders.named_effects(given.known), folders.named_effects(given.private)
    asked = History(tuple(map(str, given.recordings)), seed=given.seed, prior=given.prior, applied=given.apply)
    diagnosis = folders.Search(own, sure, sure_files | own_files, deadline, given.workers, given.cluster)
    out, choice = given.out, FigureChoice(given.form, given.pictures)
    found, content, commands = folders.diagnose_as(asked, diagnosis, out=out, choice=choice, listener=console)
    console.say(*summary(found), *(f"to try: {text}" for text in commands))
    console.say(f"wrote {given.out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(content, given.json)


def new_effect(given: options.NewEffect) -> None:
    """Write a template of an effect of your own, for --effect."""
    write_template(given.path, given.key)
    console.say(f"wrote {given.path}; use it with: tactilevision diagnose RECORDING --effect {given.path}")


def compare(given: options.Compare) -> None:
    """Add effects one after the other and watch the error, on held-out presses, next to the repeatability."""
    deadline = Deadline.after(given.time_limit)
    paths, left_out = tuple(map(str, given.recordings)), tuple(given.left_out or ())
    asked = History(paths, seed=given.seed, prior=given.prior, left_out=left_out)
    effects, files = folders.named_effects(given.chosen)
    found = folders.compare_as(asked, effects, deadline=deadline, listener=console)
    commands = folders.commands_after_comparison(found, asked, files)
    history = folders.history_of(asked, steps_of_comparison(found, files))
    choice = FigureChoice(given.form, given.pictures)
    folders.write_comparison(found, history, out=given.out, choice=choice, try_next=commands, listener=console)
    excluded = [f"{key} is excluded: {why}" for key, why in found.left_out]
    console.warn([*found.stated.warnings, *excluded])
    console.say(*(_model_line(model) for model in found.models), *(_picture_line(one) for one in found.pictured))
    console.say(*map(fall_sentence, error_falls(found)))
    console.say(*excluded, *(f"{words}: {text}" for words, text in commands))
    console.say(f"wrote {given.out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(found.as_json(), given.json)


def _picture_line(model: Compared) -> str:
    error = f"{KILO * model.held_out_N:.1f} µm"
    if model.fitted.data.slopes is not None:
        error = f"{error} outside the faces, {KILO * face_error_mm(model.fitted):.1f} µm at the faces"
    return f"{column(model):24s} error on held-out presses {error}"


def _model_line(model: Compared) -> str:
    error = wording.fit_error(model.held_out_N, model.rms_N)
    E = "" if model.material is None else f", E {wording.estimate(model.material.youngs_modulus)}"
    return f"{column(model):24s} {error}{E}"


def steps(given: options.Steps) -> None:
    """List the steps of an analysis; undo and redo them. The folder's results follow."""
    history = load_history(given.folder / folders.HISTORY)
    if given.undo or given.redo:
        history = history.undo() if given.undo else history
        history = history.redo() if given.redo else history
        choice = FigureChoice(given.form, given.pictures)
        folders.follow_steps(history, given.folder, given.private, choice=choice, listener=console)
    for number, step in enumerate(history.steps, start=1):
        console.say(f"{number}. + {step.key.replace('_', ' ')}: {_step_errors(step)}")
    for step in reversed(history.undone):
        console.say(f"   taken back: {step.key.replace('_', ' ')}")
    console.say(history.script(folders.again_in(given.folder)).splitlines()[-1])
    console.hand_over(history.as_json(), given.json)


def _step_errors(step: Step) -> str:
    """Return the error before and after a step; of the presses fitted where none could be held out."""
    if not isfinite(step.held_out_after_N):
        return f"rms {KILO * step.rms_before_N:.2f} -> {KILO * step.rms_after_N:.2f} mN"
    before, after = KILO * step.held_out_before_N, KILO * step.held_out_after_N
    if step.unit == "mm":
        return f"error of the picture's depth on held-out presses from {before:.1f} to {after:.1f} um"
    fall = f"from {before:.1f} to {after:.1f} mN"
    return f"error on held-out presses {fall}"


def workbench(given: options.Workbench) -> None:
    """Find where the model fails, add effects, and see the error fall, in the browser on this machine."""
    plotly()
    out = given.out
    history = _opening(given.recordings or [], given.state, seed=given.seed, prior=given.prior)
    own, files = folders.named_effects(given.private)
    paths = tuple(Path(name) for name in history.recordings)
    read = read_recordings(paths)
    opened = Opened(
        paths=paths,
        measured=tuple(CertifiedRecording(one).measured for one in read),
        bound=NU_SILICONE if history.prior else None,
        private=tuple(own),
        files=files,
        frames=tuple(Frames(one) if one.frame_names else None for one in read),
        marks=file_marks(paths),
    )
    labelled = [step for label in history.labels for step in label.steps]
    folders.check_named(
        [*history.steps, *history.undone, *labelled],
        opened.files,
        what="an effect of your own is in the state",
        where="--state",
    )
    bench = Bench(
        opened,
        history,
        export=_export,
        keep=lambda kept: folders.write_history(kept, out, out),
        out=out,
        read=_certified,
    )
    with _served(bench, out, given.port, framed=given.framed) as server:
        console.say(f"the workbench is at {server.address}", f"its state is written to {out}", "Ctrl-C ends it")
        if given.browser:
            typer.launch(server.address)
        bench.work()


def _served(bench: Bench, out: Path, port: int, *, framed: bool) -> Server:
    """Return the page at the port and the token that this folder's had before, so that an open page comes back."""
    before, _, token = remembered(PAGE, real_path(out)).partition(" ")
    try:
        server = Server(bench, port or int(before or 0), framed=framed, token=token)
    except InputError:
        if port or not before:
            raise
        server = Server(bench, framed=framed)  # another workbench has that port
    remember(PAGE, real_path(out), f"{server.port} {server.token}")
    return server


def _opening(recordings: Sequence[Path], state: Path | None, *, seed: int, prior: bool) -> History:
    """Return the saved history, or a new one. Raises InputError for both a state and recordings, or neither."""
    if (state is None) == (not recordings):
        raise InputError(
            "a workbench opens recordings, or the state of an analysis",
            where="workbench",
            remedy="Name RECORDING..., or --state FOLDER.",
        )
    if state is None:
        return History(tuple(str(real_path(path)) for path in recordings), seed=seed, prior=prior)
    return load_history(state / folders.HISTORY if state.is_dir() else state)


@dataclass(frozen=True, slots=True)
class _Both:
    """A listener that shows progress and warnings on the terminal and on the page."""

    bench: Bench

    @contextmanager
    def progress_bar(self, title: str) -> Iterator[Progress]:
        """Begin a step."""
        step = title.rstrip(":")
        self.bench.report(step, 0, 0)
        with console.progress_bar(title) as bar:

            def advance(done: int, total: int, what: str = "") -> None:
                bar(done, total, what)
                self.bench.report(f"{step}: {what}" if what else step, done, total)

            yield advance

    def warn(self, lines: Sequence[str]) -> None:
        """Show warnings."""
        console.warn(lines)
        self.bench.warned(lines)


def _certified(bench: Bench) -> Opened:
    """Return the recordings of an open page as `compare` uses them."""
    opened = bench.opened
    try:
        recordings = [one.recording for one in opened.measured]
        taken = certify_recordings(recordings, scale_doubt=False, listener=_Both(bench))
        data = observed(taken)
    except TactilevisionError as fault:
        console.warn([f"{fault} The page shows the presses as recorded."])
        raise
    return replace(
        opened,
        measured=tuple(one.measured for one in taken),
        observed=data,
        bulge=sharpest_poisson_ratio(taken),
        frames=tuple(_frames(one) for one in taken),
        warnings=tuple(dict.fromkeys((*(said for one in taken for said in _warnings(one)), *data.warnings))),
    )


def _warnings(taken: CertifiedRecording) -> tuple[str, ...]:
    """Return what the terminal warned of while a recording was certified."""
    return (*taken.warnings, *(() if taken.reconstructor is None else taken.reconstructor.warnings))


def _frames(taken: CertifiedRecording) -> Frames | None:
    if taken.reconstructor is None or not taken.recording.frame_names:
        return None
    return Frames(taken.recording, taken.reconstructor, taken.certificate.evidence if taken.certificate else {})


def _export(shown: Shown, opened: Opened, out: Path) -> Path:
    """Write the report, calibration.json, the history and the script that repeats it, all or none."""
    found, (verdict, caveats) = shown.found(opened), shown.said(opened)
    history = replace(shown.history, applied=True)
    commands = folders.commands_after_comparison(found, history, opened.files)
    folders.write_comparison(
        found, history, out=out, try_next=commands, verdict=[*verdict, *caveats], listener=console
    )
    return out / "report.html"
