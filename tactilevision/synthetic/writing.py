"""A simulated recording as the record that reading it gives, and its pictures, one at a time."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2

from tactilevision.files import replacing, write_text
from tactilevision.recording import BallPress as BallRecord, Recording, layout
from tactilevision.records import Bytes, ForceSeries, Gel, Indenter, Press, Sensor
from tactilevision.synthetic.ball import BallPress
from tactilevision.synthetic.gel import Grid
from tactilevision.synthetic.optics import distortion
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.plan import PlannedPress
from tactilevision.synthetic.scenario import Scenario
from tactilevision.synthetic.series import DEPTH_STD_MM, certified, curves, read_forces

_SUFFIX = {"png": ".png", "jpeg": ".jpg"}


def recording_of(folder: Path, scenario: Scenario) -> Recording:
    """All that the maker of the recording would know, but for its pictures."""
    options = scenario.options
    pictured = options.frames in _SUFFIX
    forces = ForceSeries(*read_forces(scenario), scenario.sensor.noise_N) if pictured else None
    gauge, drawn = options.frames == "points", curves(scenario) if options.frames == "curves" else ()
    listed = {curve.press for curve in drawn}
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
        points=certified(scenario) if gauge else (),
        curves=drawn,
    )


def _sensor(options: SimulationOptions, pictured: bool) -> Sensor:
    camera, gel = options.camera, options.gel
    gelslim = camera.light_seed is None and (camera.width_px, camera.height_px) == (427, 320)
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
        rectification=distortion(camera).to_rectified if pictured and camera.distortion_px > 0 else None,
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
    """A row of presses.csv: the protocol, which does not know what went wrong."""
    return Press(
        press=press.label,
        indenter=press.indenter,
        start_s=round(press.start_s, 4),
        end_s=round(press.end_s, 4),
        rest_s=round(press.rest_s, 2),
        speed_mm_s=press.protocol.speed_mm_s,
        hold_s=press.protocol.hold_s,
    )


def ball_records(
    folder: Path, balls: tuple[BallPress, ...], *, grid: Grid, stated: bool
) -> tuple[BallRecord, ...]:
    """Rows of the balls' table; with `stated` also where each ball is, in rectified pixels."""
    records = []
    for i, ball in enumerate(balls):
        path = folder / layout.BALLS / f"{i:02d}.png"
        step_x, step_y = grid.spacing_mm
        x, y = (ball.centre_mm[0] - grid.x_mm[0]) / step_x, (ball.centre_mm[1] - grid.y_mm[0]) / step_y
        place = (round(float(x), 2), round(float(y), 2)) if stated else None
        contact = round(ball.contact_radius_mm / step_x, 2) if stated else None
        records.append(BallRecord(path, ball.radius_mm, place, contact))
    return tuple(records)


def write_toml(path: Path, content: Mapping[str, Any]) -> None:
    import tomli_w

    write_text(path, tomli_w.dumps(content))


def write_picture(path: Path, rgb: Bytes, *, jpeg_quality: int = 95) -> None:
    """A picture by its suffix; JPEG keeps the colours at full resolution, which photometry needs."""
    settings = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]  # smallest for noisy pictures
    if path.suffix == ".jpg":
        settings = [
            cv2.IMWRITE_JPEG_QUALITY,
            jpeg_quality,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ]
    _, data = cv2.imencode(path.suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), settings)
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


class FrameWriter:
    """Writes frames as they come and remembers their names and times for the table of frames."""

    def __init__(self, folder: Path, options: SimulationOptions) -> None:
        self._folder, self._quality = folder / layout.FRAMES, options.jpeg_quality
        self._suffix = _SUFFIX[options.frames]
        self.names: list[str] = []
        self.times_s: list[float] = []

    def add(self, rgb: Bytes, time_s: float) -> None:
        self.names.append(f"{len(self.names):05d}{self._suffix}")
        self.times_s.append(round(time_s, 4))
        write_picture(self._folder / self.names[-1], rgb, jpeg_quality=self._quality)

    def tear(self, index: int) -> None:
        """Cut a frame's file in half, as a full disk or a lost connection does."""
        path = self._folder / self.names[index]
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
