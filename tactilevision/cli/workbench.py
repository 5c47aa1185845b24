"""Command `workbench`: compare, diagnose and steps in a browser on this machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import (
    Private,
    Seed,
    named_effects,
    next_commands,
    write_history,
)
from tactilevision.records.constants import NU_SILICONE

if TYPE_CHECKING:
    from calibration.tasks.session import History
    from calibration.workbench.bench import Shown
    from calibration.workbench.opened import Frames, Opened
    from tactilevision.pipeline import CertifiedRecording

Opening = Annotated[
    list[Path] | None, typer.Argument(metavar="RECORDING...", help="Recordings of one sensor; none with --state.")
]
State = Annotated[
    Path | None,
    typer.Option(
        "--state", metavar="FOLDER", help="Continue an analysis: the folder that workbench or compare wrote."
    ),
]


def workbench(
    recordings: Opening = None,
    out: console.OutOption = Path("workbench_out"),
    state: State = None,
    private: Private = None,
    prior: console.PriorOption = True,
    seed: Seed = 0,
    port: Annotated[int, typer.Option(help="Port of the page on 127.0.0.1; 0: a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Find where the model fails, add effects, and see the error fall, in the browser on this machine."""
    from calibration.workbench.bench import Bench
    from calibration.workbench.server import Server, plotly

    plotly()
    history = _history(recordings or [], state, seed=seed, prior=prior)
    opened = _opened(history, private)
    _check_steps(history, opened)
    bench = Bench(opened, history, export=_export, keep=lambda kept: write_history(kept, out, out), out=out)
    with Server(bench, port) as server:
        console.say(
            f"the workbench is at {server.address}", "its state is written to " + str(out), "Ctrl-C ends it"
        )
        if browser:
            typer.launch(server.address)
        bench.work()


def _history(recordings: Sequence[Path], state: Path | None, *, seed: int, prior: bool) -> History:
    """Return the saved history, or a new one. Raises InputError for both a state and recordings, or neither."""
    from calibration.tasks.session import History, load_history
    from tactilevision.errors import InputError

    if (state is None) == (not recordings):
        raise InputError(
            "a workbench opens recordings, or the state of an analysis",
            where="workbench",
            remedy="Name RECORDING..., or --state FOLDER.",
        )
    if state is None:
        return History(tuple(str(path.resolve()) for path in recordings), seed=seed, prior=prior)
    return load_history(state / "history.json" if state.is_dir() else state)


def _opened(history: History, private: Sequence[Path] | None) -> Opened:
    """Return the recordings as `compare` uses them."""
    from calibration.workbench.opened import Opened, file_marks
    from tactilevision.pipeline import certify_recordings, observed, sharpest_poisson_ratio

    paths = tuple(Path(name) for name in history.recordings)
    marks = file_marks(paths)
    taken = certify_recordings(paths, scale_doubt=False, listener=console)
    own, files = named_effects(private)
    return Opened(
        paths=paths,
        measured=tuple(one.measured for one in taken),
        data=observed(taken),
        bulge=sharpest_poisson_ratio(taken),
        bound=NU_SILICONE if history.prior else None,
        private=tuple(own),
        files=files,
        frames=tuple(_frames(one) for one in taken),
        warnings=tuple(warning for one in taken for warning in one.recording.warnings),
        marks=marks,
    )


def _frames(taken: CertifiedRecording) -> Frames | None:
    from calibration.workbench.opened import Frames

    if taken.reconstructor is None or not taken.recording.frame_names:
        return None
    found = taken.certificate
    return Frames(taken.recording, taken.reconstructor, {} if found is None else found.evidence)


def _check_steps(history: History, opened: Opened) -> None:
    """Raise InputError where the state has an effect whose file is not named on the command line."""
    from tactilevision.errors import InputError

    labelled = [step for state in history.labels for step in state.steps]
    for step in (*history.steps, *history.undone, *labelled):
        if step.path and step.key not in opened.files:
            raise InputError(
                "the state has a private effect, whose file is only run if it is named",
                where="--state",
                value=step.key,
                remedy=f"Add --effect FILE.py; it was {step.path}.",
            )


def _export(shown: Shown, opened: Opened, out: Path) -> Path:
    """Write the report, calibration.json, the history and the script that repeats it, all or none."""
    from tactilevision.cli.compare import forget_found, keep_calibration, write_comparison
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.files.writing import staged, write_json

    assert shown.now is not None
    found = replace(shown.now.found, suggested=shown.suggested)
    history = replace(shown.history, applied=True)
    commands = next_commands(
        history.recordings, found, opened.files, prior=history.prior, left_out=history.left_out
    )
    with staged(out) as stage:
        write_comparison(found, FigureFolder(stage), title=f"Comparison of {opened.title}", try_next=commands)
        keep_calibration(out, stage)
        material = found.models[-1].material
        assert material is not None
        write_json(stage / "calibration.json", material.as_json())
        write_history(history, stage, out)
    forget_found(out)
    return out / "report.html"
