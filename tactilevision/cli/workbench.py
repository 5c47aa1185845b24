"""Command `workbench`: the page appears before the models are imported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from calibration.tasks.session import HISTORY, History, load_history
from calibration.workbench.recorded import Frames, file_marks
from calibration.workbench.server import Server, plotly
from tactilevision.cli import console, options
from tactilevision.errors import InputError
from tactilevision.files.cache import remember, remembered
from tactilevision.files.opening import real_path
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recordings

if TYPE_CHECKING:
    from calibration.model.stages import Effect

PAGE = "page"  # what is remembered of a workbench: its port and token


def workbench(given: options.Workbench) -> None:
    """Find where the model fails, add effects, and see the error fall, in the browser on this machine."""
    plotly()  # fails here where it is missing
    out, history = given.out, _opening(given.recordings or [], given.state, seed=given.seed, prior=given.prior)
    paths = [Path(name) for name in history.recordings]
    recordings, marks = read_recordings(paths), file_marks(paths)
    frames = [Frames(one) if one.frame_names else None for one in recordings]
    own = _own_effects(history, given.private or ())
    with _served(recordings, frames, out, given.port, framed=given.framed) as server:
        console.say(f"the workbench is at {server.address}", f"its state is written to {out}", "Ctrl-C ends it")
        if given.browser:
            typer.launch(server.address)
        server.wait_for_page()
        from tactilevision.cli.analysis import bench_of  # the models

        bench = bench_of(history, recordings, frames, marks, own, out)
        server.show(bench)
        bench.work()


def _own_effects(history: History, private: Sequence[Path]) -> tuple[Sequence[Effect], Mapping[str, str]]:
    """Return the private effects and their files by key; the models are imported only where there are any."""
    labelled = [step for label in history.labels for step in label.steps]
    steps = [*history.steps, *history.undone, *labelled]
    if not private and not any(step.path for step in steps):
        return (), {}
    from tactilevision import result_folders as folders

    own, files = folders.named_effects(private)
    folders.check_named(steps, files, what="an effect of your own is in the state", where="--state")
    return own, files


def _served(
    recordings: Sequence[Recording], frames: Sequence[Frames | None], out: Path, port: int, *, framed: bool
) -> Server:
    """Return the page at the port and the token that this folder's had before, so that an open page comes back."""
    before, _, token = remembered(PAGE, real_path(out)).partition(" ")
    try:
        server = Server(recordings, frames, port=port or int(before or 0), framed=framed, token=token)
    except InputError:
        if port or not before:
            raise
        server = Server(recordings, frames, framed=framed)  # another workbench has that port
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
    return load_history(state / HISTORY if state.is_dir() else state)
