"""Commands `diagnose`, `compare`, `steps` and `new-effect`, and the work of `workbench`: what a model lacks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

from calibration.diagnosis.vision_depth_check import face_error_mm
from calibration.effects.private import new_effect as write_template
from calibration.inputs.deadline import Deadline, Progress
from calibration.model.stages import Effect
from calibration.report import wording
from calibration.report.diagnosis_report import summary
from calibration.report.figures import FigureChoice
from calibration.report.headline import fall_sentence
from calibration.report.misfit import error_falls
from calibration.report.report import column
from calibration.tasks.compare import Compared
from calibration.tasks.session import HISTORY, History, Step, load_history, steps_of_comparison
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.opened import Opened
from calibration.workbench.recorded import Frames, Marks
from tactilevision import result_folders as folders
from tactilevision.cli import console, options
from tactilevision.errors import TactilevisionError
from tactilevision.pipeline import (
    CertifiedRecording,
    certify_recordings,
    observed,
    sharpest_poisson_ratio,
)
from tactilevision.recording.model import Recording
from tactilevision.records.constants import KILO, NU_SILICONE


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
    history = load_history(given.folder / HISTORY)
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


def bench_of(
    history: History,
    recordings: Sequence[Recording],
    frames: Sequence[Frames | None],
    marks: Marks,
    own: tuple[Sequence[Effect], Mapping[str, str]],
    out: Path,
) -> Bench:
    """Return the workbench of recordings that are not certified yet; `own` effects and their files by key."""
    opened = Opened(
        paths=tuple(Path(name) for name in history.recordings),
        measured=tuple(CertifiedRecording(one).measured for one in recordings),
        bound=NU_SILICONE if history.prior else None,
        private=tuple(own[0]),
        files=own[1],
        frames=tuple(frames),
        marks=marks,
    )
    return Bench(
        opened,
        history,
        export=_export,
        keep=lambda kept: folders.write_history(kept, out, out),
        out=out,
        read=_certified,
    )


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
