"""How long the workbench's state takes on 39 presses, in s of processor, without the browser and the verdict.

python -m benchmarks.workbench
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from calibration.inputs.gather import observe_all
from calibration.inputs.observations import Measured
from calibration.session import History
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.curve_view import curve_view
from calibration.workbench.models import Models
from calibration.workbench.opened import Opened
from calibration.workbench.state_view import state_view
from tactilevision.recording import read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "hidden_material"
MISSING = "viscoelasticity"  # hidden in the sample
PATIENT = 10  # times that what takes no time is done


def main() -> None:
    """Open the sample, add what is missing, undo, and make what the page is sent."""
    timed("plain imports, and the sample read", opened)
    sample = opened()
    models = Models(sample)
    timed("plain law fitted: the first waterfall", lambda: models.fitted((), ()))
    timed("effect added that was not fitted beforehand", lambda: models.fitted((), (MISSING,)))
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(
            sample, History(("sample",)), export=no_export, keep=lambda _: None, out=Path(folder), asks=False
        )
        timed(
            "opened, with what stands out and two effects fitted beforehand", lambda: bench.work(until_idle=True)
        )
        for action in ("add", "undo", "redo"):
            timed(f"{action}, once it was fitted", lambda action=action: act(bench, action))
        timed("state and curves made for the page, each time", lambda: views(bench), PATIENT)


def opened() -> Opened:
    """The sample as the command opens it."""
    recording = read_recording(SAMPLE)
    measured = Measured(recording, recording.points, recording.curves)
    return Opened((SAMPLE,), (measured,), observe_all([measured]))


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


if __name__ == "__main__":
    main()
