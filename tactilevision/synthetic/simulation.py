"""Simulate a recording with known truth, frame by frame, and write it."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import OutputError
from tactilevision.files.runs import LOCK, output_lock
from tactilevision.files.writing import remove, write_bytes, write_text
from tactilevision.recording import layout
from tactilevision.recording.model import BallPress as BallRecord, Recording
from tactilevision.recording.write import write_image, write_recording
from tactilevision.records.measured import Bytes, Floats, ForceSeries, Pair
from tactilevision.records.rig import Gel, Indenter, Press, Sensor
from tactilevision.synthetic.camera import GELSLIM3, Imaging, build_camera, distortion
from tactilevision.synthetic.gel import BallPress, Flat
from tactilevision.synthetic.options import GelOptions, SimulationOptions
from tactilevision.synthetic.scenario import DEPTH_STD_MM, PlannedPress, Scenario, draw_scenario, stream

_AVERAGED = 16  # frames in one reference picture
PLASTIC_NUMBER = 1.324717957244746  # x^3 = x + 1, of Roberts' sequence R2


def picture_still(camera: Imaging, surface: BallPress | Flat, *, rng: np.random.Generator) -> Bytes:
    """Return a reference picture (H, W, 3) uint8 in raw geometry, the mean of several frames."""
    return camera.expose(camera.ideal(surface), rng, averaged=_AVERAGED)


def plan_balls(
    count: int, radii_mm: tuple[float, ...], *, half_mm: Pair, gel: GelOptions, rng: np.random.Generator
) -> tuple[BallPress, ...]:
    """Return ball presses spread evenly over the field by the R2 sequence, radii in turn."""
    start = rng.random(2)
    steps = PLASTIC_NUMBER ** -np.array([1.0, 2.0])
    balls = []
    for i in range(count):
        place = ((start + i * steps) % 1.0) * 2 - 1
        place = np.sign(place) * np.abs(place) ** 1.25  # closer together where the presses are
        radius = radii_mm[i % len(radii_mm)]
        contact = float(radius * rng.uniform(0.35, 0.58))
        x, y = place * (np.asarray(half_mm) - 1.0 - contact)
        balls.append(BallPress(radius, contact, gel.thickness_mm, gel.poisson_ratio, (float(x), float(y))))
    return tuple(balls)


_SUFFIX = {"png": ".png", "jpeg": ".jpg"}


def recording_of(folder: Path, scenario: Scenario) -> Recording:
    """Return the recording without its pictures."""
    options = scenario.options
    pictured = options.frames in _SUFFIX
    forces = ForceSeries(*scenario.read_forces(), scenario.sensor.noise_N) if pictured else None
    gauge, measured = options.frames == "points", scenario.curves() if options.frames == "curves" else ()
    listed = {curve.press for curve in measured}
    return Recording(
        path=folder,
        name=options.name,
        date=datetime.date.fromisoformat(options.date),
        sensor=_sensor(options, pictured),
        force_std_N=scenario.sensor.noise_N,
        force_rate_Hz=options.rig.force_rate_Hz,
        depth_source="gauge" if gauge else "vision",
        depth_std_mm=options.indenters.height_std_mm if gauge else DEPTH_STD_MM,
        clock_offset_s=round(scenario.clock_offset_s, 5) if options.rig.state_clock_offset and pictured else None,
        indenters={f"A{i + 1}": _indenter(options, i) for i in range(len(options.indenters.heights_mm))},
        presses=tuple(_press(p) for p in scenario.presses if pictured or p.label in listed),
        forces=forces,
        points=scenario.certified() if gauge else (),
        curves=measured,
    )


def _sensor(options: SimulationOptions, pictured: bool) -> Sensor:
    camera, gel = options.camera, options.gel
    size = camera.width_px, camera.height_px
    gelslim = camera.light_seed is None and size == (GELSLIM3.width_px, GELSLIM3.height_px)
    known = gel.prior_std is not None
    prior = gel.poisson_ratio if gel.prior is None else gel.prior
    pad = Gel(
        thickness_mm=gel.thickness_mm,
        shape="disc",
        radius_mm=gel.radius_mm,
        poisson_ratio=prior if known else None,
        poisson_ratio_std=gel.prior_std,
    )
    return Sensor(
        kind="gelslim3" if gelslim else "custom",
        width_px=camera.width_px,
        height_px=camera.height_px,
        mm_per_px=camera.mm_per_px,
        gel=pad,
        rectification=distortion(camera)[0] if pictured and camera.distortion_px > 0 else None,
        has_markers=camera.markers,
        serial="simulated",
    )


def _indenter(options: SimulationOptions, number: int) -> Indenter:
    kit = options.indenters
    return Indenter(
        name=f"A{number + 1}",
        radius_mm=kit.radius_mm,
        height_mm=kit.heights_mm[number],
        height_std_mm=kit.height_std_mm,
        bevel=kit.bevel,
        bevel_distance_mm=kit.bevel_distance_mm if kit.state_bevel_place else None,
        bevel_angle_deg=kit.bevel_angle_deg if kit.state_bevel_place else None,
    )


def _press(press: PlannedPress) -> Press:
    """Return a row of presses.csv, without the fault."""
    return Press(
        press=press.label,
        indenter=press.indenter,
        start_s=round(press.start_s, 4),
        end_s=round(press.end_s, 4),
        rest_s=round(press.rest_s, 2),
        speed_mm_s=press.protocol.speed_mm_s,
        hold_s=press.protocol.hold_s,
    )


def write_toml(path: Path, content: Mapping[str, Any]) -> None:
    import tomli_w

    write_text(path, tomli_w.dumps(content))


Progress = Callable[[int, int], None]
TRUTH = "truth.toml"


def simulate(
    out: Path | str, *, seed: int, options: SimulationOptions | None = None, progress: Progress | None = None
) -> Path:
    """Write a recording and its truth.toml into `out`, and return that path.

    The same seed and options give the same bytes on the same machine and versions. `progress(done, of)` is called
    after each picture. Raises InputError for impossible options, OutputError where `out` is refused.
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
        write_toml(folder / TRUTH, scenario.truth())
        record = recording_of(folder, scenario)
        if record.forces is not None:
            cameras = _cameras(scenario) if camera is None else (camera, camera)
            record = _pictured(record, scenario, cameras, progress or (lambda done, of: None))
        write_recording(record)
    return folder


def _clear(folder: Path) -> None:
    """Remove an earlier simulation, which has a truth.toml. Raises OutputError for other files."""
    if not any(path.name != LOCK for path in folder.iterdir()):
        return
    if not (folder / TRUTH).is_file():
        raise OutputError(
            "the folder holds files that no simulation wrote",
            where=folder,
            remedy="Name a folder that is empty or not there yet.",
        )
    tables = (layout.FRAME_TABLE, layout.FORCES, layout.PRESSES, layout.STAGE, layout.CURVES, layout.POINTS)
    # settings first: without them it is no recording
    for name in (layout.SETTINGS, *tables, layout.BALL_TABLE, layout.FRAMES, layout.FLATS, layout.BALLS):
        remove(folder / name)


def frame_times(scenario: Scenario) -> list[tuple[PlannedPress, Floats]]:
    """Return for each press the times (N,) s of the kept frames, on the camera's clock."""
    rng = stream(scenario.seed, 2)
    rig = scenario.options.rig
    chosen = []
    for press in scenario.presses:
        times = np.arange(press.start_s, press.end_s, 1 / rig.frame_rate_Hz)
        times = times + np.clip(rng.normal(0.0, 4e-4, times.size), -2e-3, 2e-3)
        if rig.frames_per_press is not None:
            times = times[_informative(press, times, rig.frames_per_press)]
        if press.fault == "dropped_frames":
            since = times - press.touch_time_s
            times = times[(since < -0.25) | (since > 0.25 + press.protocol.dwell_s)]
        chosen.append((press, times))
    return chosen


def _informative(press: PlannedPress, times: Floats, count: int) -> Floats:
    """Return the indices of frames to keep: dense around the touch of the bevel, some of every other phase."""
    interval = float(np.median(np.diff(times)))
    turn = press.motion.loading_time_s(float(press.motion.face_mm.max()))
    contact = press.motion.loading_time_s(0.0)
    event = turn if np.isnan(press.touch_time_s) else press.touch_time_s
    dwell = press.protocol.dwell_s
    onward = event + dwell + interval * np.array([1, 2, 4, 8, 16] if dwell > 0 else [8, 16])
    contact_times = np.concatenate([event + interval * np.arange(-3, 5), onward])
    hold, release = press.protocol.hold_s, np.array(press.motion.time_s[-3:-1])
    rest = [press.start_s, contact + 3 * interval, turn + 0.7 * hold, press.end_s]
    release_times = release[0] + np.array([0.1, 0.25, 0.4, 0.55]) * (release[1] - release[0])
    more = max(count - contact_times.size - release_times.size - len(rest), 0)
    growing = np.linspace(event - 0.5 * (turn - event), turn, 2 * more // 3 + 2)[1:-1]
    ramp = np.linspace(contact, event, more - 2 * more // 3 + 2)[1:-1]
    wanted = np.concatenate([contact_times, rest, release_times, growing, ramp])
    return np.unique(np.clip(np.searchsorted(times, wanted), 0, times.size - 1))


def _cameras(scenario: Scenario) -> tuple[Imaging, Imaging]:
    """Return the camera of the reference pictures and that of the frames."""
    camera = build_camera(scenario.options.camera, stream(scenario.seed, 3))
    end_s = scenario.presses[-1].end_s if scenario.presses else 1.0
    return camera, replace(camera, slope_response=replace(scenario.options.slope_response, end_s=end_s))


def _pictured(
    record: Recording, scenario: Scenario, cameras: tuple[Imaging, Imaging], progress: Progress
) -> Recording:
    """Write the pictures and return the record that lists them."""
    options, folder, (camera, worn) = scenario.options, record.path, cameras
    rng = stream(scenario.seed, 4)
    plan, rng_of_balls = frame_times(scenario), stream(scenario.seed, 5)
    half_mm = options.camera.half_mm
    balls = plan_balls(options.balls, options.ball_radii_mm, half_mm=half_mm, gel=options.gel, rng=rng_of_balls)
    total, done = sum(times.size for _, times in plan) + len(balls) + options.flats, 0
    names: list[str] = []
    for press, times in plan:
        for time_s in times.tolist():
            names.append(f"{len(names):05d}{_SUFFIX[options.frames]}")
            rgb = worn.picture(press.surface(time_s), rng, time_s=time_s)
            write_image(folder / layout.FRAMES / names[-1], rgb, jpeg_quality=options.jpeg_quality)
            progress(done := done + 1, total)
    if options.torn_frame:  # cut in half, as by a full disk or a lost connection
        path = folder / layout.FRAMES / names[_unimportant(plan)]
        write_bytes(path, path.read_bytes()[: path.stat().st_size // 2])
    records = tuple(
        BallRecord(folder / layout.BALLS / f"{i:02d}.png", ball.radius_mm) for i, ball in enumerate(balls)
    )
    flats = [folder / layout.FLATS / f"{i:02d}.png" for i in range(options.flats)]
    stills = [(path, Flat()) for path in flats] + list(zip((r.path for r in records), balls, strict=True))
    for path, surface in stills:
        write_image(path, picture_still(camera, surface, rng=rng))
        progress(done := done + 1, total)
    times_s = np.round(np.concatenate([times for _, times in plan]), 4)
    return replace(record, frame_names=tuple(names), frame_times_s=times_s, balls=records)


def _unimportant(plan: list[tuple[PlannedPress, Floats]]) -> int:
    """Return the index of the last frame, in free air, of the first good press."""
    first = next((i for i, (press, _) in enumerate(plan) if not press.fault), 0)
    return sum(times.size for _, times in plan[: first + 1]) - 1
