"""Writes a simulated recording's files, one at a time and each whole or not at all."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np

from tactilevision.errors import OutputError
from tactilevision.files import replacing, write_text
from tactilevision.records import Bytes, Floats
from tactilevision.synthetic.gel import Grid, Singles
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.plan import PlannedPress
from tactilevision.synthetic.reference import BallPress
from tactilevision.synthetic.series import DEPTH_STD_MM

_SUFFIX = {"png": ".png", "jpeg": ".jpg"}


def write_toml(path: Path, content: Mapping[str, Any]) -> None:
    import tomli_w

    write_text(path, tomli_w.dumps(content))


def write_settings(folder: Path, options: SimulationOptions, clock_offset_s: float) -> None:
    """recording.toml: what the maker of the recording would know."""
    gel, kit, camera, rig = options.gel, options.indenters, options.camera, options.rig
    pad: dict[str, Any] = {"thickness_mm": gel.thickness_mm, "shape": "disc", "radius_mm": gel.radius_mm}
    if gel.prior_std is not None:
        pad["poisson_ratio"] = gel.poisson_ratio if gel.prior is None else gel.prior
        pad["poisson_ratio_std"] = gel.prior_std
    sensor: dict[str, Any] = {"kind": "gelslim3", "serial": "simulated", "mm_per_px": list(camera.mm_per_px)}
    if camera.light_seed is not None or (camera.width_px, camera.height_px) != (427, 320):
        sensor |= {"kind": "custom", "width_px": camera.width_px, "height_px": camera.height_px}
    if camera.distortion_px > 0 and options.frames in _SUFFIX:
        sensor["rectification"] = "maps.npz"
    if camera.markers:
        sensor["has_markers"] = True
    content: dict[str, Any] = {
        "format": 1,
        "name": options.name,
        "date": date.fromisoformat(options.date),
        "sensor": sensor | {"gel": pad},
        "force": {"std_N": [0.00625, 0.00625, 0.0125], "rate_Hz": rig.force_rate_Hz},
        "depth": {"source": "gauge" if options.frames == "points" else "vision", "std_mm": DEPTH_STD_MM},
        "indenter": {f"A{i + 1}": _indenter(options, h) for i, h in enumerate(kit.heights_mm)},
    }
    if options.frames == "points":
        content["depth"]["std_mm"] = kit.height_std_mm
    if rig.state_clock_offset:
        content["clock"] = {"offset_s": round(clock_offset_s, 5)}
    write_toml(folder / "recording.toml", content)


def _indenter(options: SimulationOptions, height_mm: float) -> dict[str, Any]:
    kit = options.indenters
    place = {"bevel_distance_mm": kit.bevel_distance_mm, "bevel_angle_deg": kit.bevel_angle_deg}
    return {
        "shape": "flat_cylinder",
        "radius_mm": kit.radius_mm,
        "height_mm": height_mm,
        "height_std_mm": kit.height_std_mm,
        "bevel": kit.bevel,
    } | (place if kit.state_bevel_place else {})


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """A CSV table whose columns are the first row's keys."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def write_points(folder: Path, rows: Sequence[Mapping[str, object]]) -> None:
    write_rows(folder / "points.csv", rows)


def write_curves(folder: Path, rows: Sequence[Mapping[str, object]]) -> None:
    write_rows(folder / "curves.csv", rows)


def write_presses(folder: Path, presses: Sequence[PlannedPress]) -> None:
    """presses.csv as the protocol has it; it does not know which presses went wrong."""
    write_rows(
        folder / "presses.csv",
        [
            {
                "press": p.label,
                "indenter": p.indenter,
                "start_s": f"{p.start_s:.4f}",
                "end_s": f"{p.end_s:.4f}",
                "rest_s": f"{p.rest_s:.2f}",
                "speed_mm_s": p.protocol.speed_mm_s,
                "hold_s": p.protocol.hold_s,
            }
            for p in presses
        ],
    )


def write_forces(folder: Path, time_s: Floats, force_N: Floats) -> None:
    """forces.csv on the F/T sensor's clock."""
    with replacing(folder / "forces.csv") as temporary:
        table = np.column_stack([time_s, force_N])
        np.savetxt(temporary, table, fmt=("%.4f", "%.5f", "%.5f", "%.4f"), delimiter=",",
                   header="time_s,fx_N,fy_N,fz_N", comments="")  # fmt: skip


def write_maps(folder: Path, map_x: Singles, map_y: Singles) -> None:
    """maps.npz: rectified[y, x] = raw[map_y, map_x]."""
    with replacing(folder / "maps.npz") as temporary:
        np.savez_compressed(temporary, map_x=map_x, map_y=map_y)


def write_image(path: Path, rgb: Bytes, *, jpeg_quality: int = 92) -> None:
    """A PNG or JPEG by its suffix; JPEG keeps the colours at full resolution, which photometry needs."""
    with replacing(path) as temporary:
        temporary.write_bytes(_encoded(rgb, path.suffix, jpeg_quality))


def _encoded(rgb: Bytes, suffix: str, jpeg_quality: int) -> bytes:
    settings: list[int] = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if suffix == ".jpg":
        settings = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality,
                    cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]  # fmt: skip
    done, data = cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), settings)
    if not done:
        raise OutputError("the picture cannot be encoded", where=suffix)
    return bytes(data.tobytes())


def write_balls(folder: Path, balls: Sequence[BallPress], grid: Grid, *, stated: bool) -> None:
    """ball.csv; with `stated` also where each ball is, in rectified pixels."""
    if not balls:
        return
    rows: list[dict[str, object]] = []
    for i, ball in enumerate(balls):
        row: dict[str, object] = {"frame": f"{i:02d}.png", "ball_radius_mm": ball.radius_mm}
        if stated:
            step_x, step_y = grid.spacing_mm
            row["centre_x_px"] = f"{(ball.centre_mm[0] - grid.x_mm[0]) / step_x:.2f}"
            row["centre_y_px"] = f"{(ball.centre_mm[1] - grid.y_mm[0]) / step_y:.2f}"
            row["contact_radius_px"] = f"{ball.contact_radius_mm / step_x:.2f}"
        rows.append(row)
    write_rows(folder / "reference" / "ball.csv", rows)


class FrameWriter:
    """Writes frames as they come and, at the end, frames.csv: a recording cut short has no table of frames."""

    def __init__(self, folder: Path, options: SimulationOptions) -> None:
        self._folder, self._options = folder, options
        self._suffix = _SUFFIX[options.frames]
        self._rows: list[dict[str, object]] = []

    def __enter__(self) -> Self:
        return self

    def add(self, rgb: Bytes, time_s: float) -> None:
        name = f"{len(self._rows):05d}{self._suffix}"
        write_image(self._folder / "frames" / name, rgb, jpeg_quality=self._options.jpeg_quality)
        self._rows.append({"frame": name, "time_s": f"{time_s:.4f}"})

    def tear(self, index: int) -> None:
        """Cut a frame's file in half, as a full disk or a lost connection does."""
        path = self._folder / "frames" / str(self._rows[index]["frame"])
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._rows:
            write_rows(self._folder / "frames.csv", self._rows)
