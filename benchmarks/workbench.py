"""How long the workbench's state takes on 39 presses, in s of processor, without the browser and the verdict.

python -m benchmarks.workbench
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured
from calibration.tasks.session import History
from calibration.workbench.analysis import Models
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.curve_views import curve_view
from calibration.workbench.opened import Opened
from calibration.workbench.recorded import Frames
from calibration.workbench.server import Server
from calibration.workbench.views import state_view
from tactilevision.files.writing import as_json
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.recording.read import read_recording

SAMPLES = Path(__file__).parents[1] / "sample_frames"
SAMPLE = SAMPLES / "hidden_material"
PICTURES = SAMPLES / "hidden_rig"  # frames for the slider
MANY = 10_000  # frames of one press, at the times of a camera of 100 a second
MISSING = "viscoelasticity"  # hidden in the sample
QUICK = "depth_zero"  # not in it
PATIENT = 10  # times that what takes no time is done


def main() -> None:
    """Open the sample, add what is missing, undo, and make what the page is sent."""
    for path in sorted(one for one in SAMPLES.iterdir() if (one / "presses.csv").is_file()):
        timed(f"{path.name}: presses and a frame on the page, after imports", partial(first_paint, path))
    timed("plain imports, and the sample read", opened)
    sample = opened()
    models = Models(sample)
    timed("plain law fitted: the first waterfall", lambda: models.fitted((), ()))
    for key in (MISSING, QUICK):
        timed(f"{key} added: the error falls", partial(models.fitted, (), (key,)))
    timed("and what it says of the gel", lambda: models.completed((), (MISSING,)))
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(
            sample, History(("sample",)), export=no_export, keep=lambda _: None, out=Path(folder), asks=False
        )
        timed("opened, with what stands out", lambda: bench.work(until_idle=True))
        timed("Add of a card to its new bar", lambda: (act(bench, "add"), state_view(bench)))
        for action in ("undo", "redo"):
            timed(f"{action}, once it was fitted", partial(act, bench, action))
        timed("state and curves made for the page, each time", lambda: views(bench), PATIENT)
    scrubbed()


def first_paint(path: Path) -> None:
    """Make what the page shows first: its files, the presses, and a frame; nothing is certified yet."""
    recording = read_recording(path)
    frames = Frames(recording) if recording.frame_names else None
    with Server((recording,), (frames,)) as server:
        as_json(server.get("state", {}))
        if frames is not None:
            frames.view(recording.presses[0].press)
            frames.picture(0)


def scrubbed() -> None:
    """Move through a press of many frames: what the page is told of them, then frames far apart."""
    recording = read_recording(PICTURES)
    press = replace(recording.presses[0], start_s=0.0, end_s=MANY / 100)
    names = [recording.frame_names[k % len(recording.frame_names)] for k in range(MANY)]
    long = replace(recording, presses=(press,), frame_names=tuple(names), frame_times_s=np.arange(MANY) / 100)
    frames, numbers = Frames(long, build_reconstructor(recording)), iter(range(0, MANY, 97))
    timed(f"what the page is told of a press of {MANY} frames", lambda: as_json(frames.view(press.press)), PATIENT)
    timed("a small picture while the slider moves", lambda: frames.small(next(numbers)), PATIENT)
    timed("a frame with its height map where it rests", lambda: frames.see(next(numbers)), PATIENT)


def opened() -> Opened:
    """The sample as the command opens it."""
    recording = read_recording(SAMPLE)
    measured = Measured(recording, recording.points, recording.curves)
    return Opened((SAMPLE,), (measured,), observe_curves([measured]))


def act(bench: Bench, action: str) -> None:
    """One action, until its model is shown; what is looked for afterwards is left to the next."""
    bench.act(action, MISSING if action == "add" else "")
    bench.work_once()


def views(bench: Bench) -> None:
    """What the page is sent."""
    state_view(bench)
    curve_view(bench.shown)


def no_export(_shown: Shown, _opened: Opened, out: Path) -> Path:
    """Nothing is written."""
    return out


def timed(what: str, job: Callable[[], object], times: int = 1) -> None:
    """Do it, and say what it took."""
    began = time.process_time()
    for _ in range(times):
        job()
    print(f"{what:64s} {(time.process_time() - began) / times:8.3f} s", flush=True)


def quick() -> None:
    sample = opened()
    timed("plain law fitted: the first waterfall", lambda: Models(sample).fitted((), ()))
    scrubbed()


if __name__ == "__main__":
    main()
