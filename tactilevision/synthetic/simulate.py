"""A whole recording with known truth, made frame by frame: the test bench of everything that reads recordings."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.errors import OutputError
from tactilevision.recording import Recording, layout, write_recording
from tactilevision.records import Floats
from tactilevision.runs import LOCK, output_lock
from tactilevision.synthetic import writing
from tactilevision.synthetic.ball import BallPress
from tactilevision.synthetic.camera import Imaging
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.optics import build_camera
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.plan import PlannedPress
from tactilevision.synthetic.reference import picture_still, plan_balls
from tactilevision.synthetic.scenario import Scenario, draw_scenario, stream
from tactilevision.synthetic.truth import truth_of

Progress = Callable[[int, int], None]
TRUTH = "truth.toml"


def simulate(
    out: Path | str, *, seed: int, options: SimulationOptions | None = None, progress: Progress | None = None
) -> Path:
    """Write a recording and its truth.toml into `out`, and return that path.

    The same seed and options give the same bytes on the same machine and versions. `progress(done, of)` is
    called after each picture. Raises InputError for impossible options, OutputError where `out` is refused.
    """
    return write_scenario(out, draw_scenario(options or SimulationOptions(), seed), progress=progress)


def write_scenario(
    out: Path | str, scenario: Scenario, *, camera: Imaging | None = None, progress: Progress | None = None
) -> Path:
    """Write a scenario's recording and its truth.toml into `out`, and return that path.

    `camera` takes every picture; None: the options' own. Raises OutputError where `out` is refused.
    """
    folder = Path(out)
    with output_lock(folder):
        _clear(folder)
        writing.write_toml(folder / TRUTH, truth_of(scenario))
        record = writing.recording_of(folder, scenario)
        if record.forces is not None:
            cameras = _cameras(scenario) if camera is None else (camera, camera)
            record = _pictured(record, scenario, cameras, progress or (lambda done, of: None))
        write_recording(record)
    return folder


def _clear(folder: Path) -> None:
    """Make room where an earlier simulation stands (it has a truth.toml); nothing else is ever replaced."""
    if not any(path.name != LOCK for path in folder.iterdir()):
        return
    if not (folder / TRUTH).is_file():
        raise OutputError(
            "the folder holds files that no simulation wrote",
            where=folder,
            remedy="Name a folder that is empty or not there yet.",
        )
    tables = (layout.FRAME_TABLE, layout.FORCES, layout.PRESSES, layout.STAGE, layout.CURVES, layout.POINTS)
    try:
        for name in (layout.SETTINGS, *tables):  # the settings first: without them it is no recording
            (folder / name).unlink(missing_ok=True)
        for name in (layout.FRAMES, layout.FLATS, layout.BALLS):
            if (folder / name).is_dir():
                shutil.rmtree(folder / name)
        (folder / layout.BALL_TABLE).unlink(missing_ok=True)
    except OSError as fault:
        raise OutputError(
            f"cannot be cleared: {fault.strerror or fault}", where=folder, remedy="Choose another folder."
        ) from fault


def frame_times(scenario: Scenario) -> list[tuple[PlannedPress, Floats]]:
    """For each press the times (N,) s of the frames that are kept, on the camera's clock."""
    rng = stream(scenario.seed, 2)
    rig = scenario.options.rig
    chosen = []
    for press in scenario.presses:
        times = np.arange(press.start_s, press.end_s, 1 / rig.frame_rate_Hz)
        times = times + np.clip(rng.normal(0.0, 4e-4, times.size), -2e-3, 2e-3)
        if rig.frames_per_press is not None:
            times = times[_telling(press, times, rig.frames_per_press)]
        if press.fault == "dropped_frames":
            since = times - press.touch_time_s
            times = times[(since < -0.25) | (since > 0.25 + press.protocol.dwell_s)]
        chosen.append((press, times))
    return chosen


def _telling(press: PlannedPress, times: Floats, count: int) -> Floats:
    """Indices of the frames worth keeping: dense round the bevel's touch, some of every other phase."""
    interval = float(np.median(np.diff(times)))
    turn = press.motion.loading_time_s(float(press.motion.face_mm.max()))
    contact = press.motion.loading_time_s(0.0)
    event = turn if np.isnan(press.touch_time_s) else press.touch_time_s
    dwell = press.protocol.dwell_s
    onward = event + dwell + interval * np.array([1, 2, 4, 8, 16] if dwell > 0 else [8, 16])
    contact_times = np.concatenate([event + interval * np.arange(-3, 5), onward])
    hold, release = press.protocol.hold_s, np.array(press.motion.time_s[-3:-1])
    rest = [press.start_s, contact + 3 * interval, turn + 0.7 * hold, press.end_s]
    # the clocks show there
    release_times = release[0] + np.array([0.1, 0.25, 0.4, 0.55]) * (release[1] - release[0])
    more = max(count - contact_times.size - release_times.size - len(rest), 0)
    growing = np.linspace(event - 0.5 * (turn - event), turn, 2 * more // 3 + 2)[1:-1]
    ramp = np.linspace(contact, event, more - 2 * more // 3 + 2)[1:-1]
    wanted = np.concatenate([contact_times, rest, release_times, growing, ramp])
    return np.unique(np.clip(np.searchsorted(times, wanted), 0, times.size - 1))


def _cameras(scenario: Scenario) -> tuple[Imaging, Imaging]:
    """The camera as it took the reference pictures and as it takes the frames."""
    camera = build_camera(scenario.options.camera, stream(scenario.seed, 3))
    end_s = scenario.presses[-1].end_s if scenario.presses else 1.0
    return camera, replace(camera, slope_response=replace(scenario.options.slope_response, end_s=end_s))


def _pictured(
    record: Recording, scenario: Scenario, cameras: tuple[Imaging, Imaging], progress: Progress
) -> Recording:
    """Write the pictures and give the record that lists them."""
    options, folder, (camera, worn) = scenario.options, record.path, cameras
    rng = stream(scenario.seed, 4)
    plan, balls = frame_times(scenario), _balls(scenario)
    total, done = sum(times.size for _, times in plan) + len(balls) + options.flats, 0
    frames = writing.FrameWriter(folder, options)
    for press, times in plan:
        for time_s in times:
            frames.add(worn.picture(press.surface(float(time_s)), rng, time_s=float(time_s)), float(time_s))
            progress(done := done + 1, total)
    if options.torn_frame:
        frames.tear(_unimportant(plan))
    records = writing.ball_records(folder, balls, grid=camera.grid, stated=options.state_balls)
    flats = [folder / layout.FLATS / f"{i:02d}.png" for i in range(options.flats)]
    stills = [(path, Flat()) for path in flats] + list(zip((r.path for r in records), balls, strict=True))
    for path, surface in stills:
        writing.write_picture(path, picture_still(camera, surface, rng=rng))
        progress(done := done + 1, total)
    names, times_s = tuple(frames.names), np.array(frames.times_s)
    return replace(record, frame_names=names, frame_times_s=times_s, balls=records)


def _unimportant(plan: list[tuple[PlannedPress, Floats]]) -> int:
    """Index of the last frame, in free air, of the first good press."""
    first = next((i for i, (press, _) in enumerate(plan) if not press.fault), 0)
    return sum(times.size for _, times in plan[: first + 1]) - 1


def _balls(scenario: Scenario) -> tuple[BallPress, ...]:
    camera = scenario.options.camera
    half = (camera.width_px * camera.mm_per_px[0] / 2, camera.height_px * camera.mm_per_px[1] / 2)
    return plan_balls(
        scenario.options.balls,
        scenario.options.ball_radii_mm,
        half_mm=half,
        gel=scenario.options.gel,
        rng=stream(scenario.seed, 5),
    )
