"""Recordings whose height maps are drawn by formula, so that certifying is held against what was planted.

The pictures on disk are empty; a stand-in for the reconstruction draws the surface at each frame's time. The
map is coarse (0.15 mm a pixel), for speed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter

from tactilevision.recording.model import Recording
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Bytes, Floats, ForceSeries
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

SIZE, MM_PER_PX = (170, 130), 0.15
SPEED, HOLD_S, OVER_MM, OFFSET_S, C = 0.25, 0.4, 0.07, 0.037, 3.5
RISE = 0.10
_REACH = np.sqrt(np.array([0.0, 0.8, 1.5, 2.5, 3.5, 5.5, 7.5, 12.5]))
_BESIDE = PchipInterpolator(_REACH, [1.0, 0.0, -0.09, -RISE, -0.073, -0.028, -0.012, 0.0])
SIDES = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "bottom": (0.0, 1.0), "top": (0.0, -1.0)}


@dataclass(frozen=True)
class Made:
    """One planted press."""

    height_mm: float = 0.3
    side: str = "right"
    fault: str = ""
    start_s: float = 0.0
    dwell_s: float = 0.0
    stop_mm: float = 0.001  # where the dwell is, beyond the touch
    pause: bool = False
    crumb: bool = False  # under the gel beside the face: a bump of a third of its depth
    chip: bool = False  # a sector of the face has broken off, and the gel is pressed by half there
    clock_s: float = 0.0  # by how much the F/T clock is off for this press

    @property
    def touch_mm(self) -> float:
        return self.height_mm / (1 + RISE)

    @property
    def top_mm(self) -> float:
        return 0.7 * self.touch_mm if self.fault == "bevel_not_touched" else self.touch_mm + OVER_MM

    @property
    def touch_s(self) -> float:
        return self.start_s + 0.6 + self.touch_mm / SPEED

    @property
    def end_s(self) -> float:
        return self.start_s + 0.6 + self.top_mm / SPEED + self.dwell_s + HOLD_S + self.top_mm + 0.5

    def depth(self, time: Floats) -> Floats:
        stop, top = min(self.touch_mm + self.stop_mm, self.top_mm), self.top_mm
        steps = [self.start_s + 0.6, stop / SPEED, self.dwell_s, (top - stop) / SPEED, HOLD_S, top]
        return np.interp(time, np.cumsum(steps), [0.0, stop, stop, top, top, 0.0])


def line_up(made: list[Made]) -> list[Made]:
    """One press after the other, with four seconds of rest (a hurried one: 0.6)."""
    clock, placed = 1.0, []
    for press in made:
        clock += 0.6 if press.fault == "short_rest" else 4.0
        placed.append(replace(press, start_s=clock))
        clock = placed[-1].end_s
    return placed


class Drawn:
    """Draws the height map of a frame: what a reconstruction would give, 3 % off in scale, with noise."""

    def __init__(self, sensor: Sensor, made: list[Made], seed: int) -> None:
        self.sensor, self.made, self.seed = sensor, made, seed

    def depth_map(self, frame: Frame) -> tuple[HeightMap, Bytes, Callable[[], HeightMap]]:
        height = self.height_map(frame)
        return height, frame.rgb, lambda: height

    def height_map(self, frame: Frame) -> HeightMap:
        rng = np.random.default_rng([self.seed, int(1e4 * frame.time_s)])
        press = next((m for m in self.made if m.start_s <= frame.time_s <= m.end_s), None)
        depth = np.zeros(SIZE[::-1])
        if press is not None:
            depth = surface(press, float(press.depth(np.array([frame.time_s]))[0]))
        noise = gaussian_filter(rng.standard_normal(SIZE[::-1]), 0.5 / MM_PER_PX)
        depth = 1.03 * depth + 0.002 * noise / noise.std()
        return HeightMap(depth, np.ones(depth.shape, bool), (MM_PER_PX, MM_PER_PX), time_s=frame.time_s)


@lru_cache(maxsize=64)
def _places(fault: str, side: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Distances from the axis, along x and towards the bevel (mm), and the gel beside the face over its depth."""
    aside = (12.0, 0.0) if fault == "border" else (0.3, -0.2)
    x = (np.arange(SIZE[0]) - (SIZE[0] - 1) / 2) * MM_PER_PX - aside[0]
    y = (np.arange(SIZE[1]) - (SIZE[1] - 1) / 2) * MM_PER_PX - aside[1]
    grid = np.meshgrid(x, y)
    along = SIDES[side][0] * grid[0] + SIDES[side][1] * grid[1]
    r, radius = np.hypot(*grid), 2.0 if fault == "footprint" else 2.5
    return r, grid[0], along, _BESIDE(np.sqrt(np.clip(r - radius, 0, 12.5)))


def surface(press: Made, w: float) -> Floats:
    r, x, along, unit = _places(press.fault, press.side)
    radius = 2.0 if press.fault == "footprint" else 2.5
    tilt = 0.04 * x if press.fault == "tilt" and w > 0 else 0.0
    depth = np.where(r <= radius, np.maximum(w + tilt, 0), w * unit)
    if press.chip:
        broken = (x > 0.8 * r) & (r > 0.25 * radius) & (r <= radius)
        depth = np.where(broken, 0.5 * w, depth)
    if press.crumb:
        depth = depth + 0.35 * w * np.exp(-0.5 * ((r - 1.35 * radius) ** 2 + (x - 0.5) ** 2) / 0.4**2)
    beyond = along - 5.0
    bevel = w - press.height_mm - np.tan(np.radians(10)) * beyond
    depth = np.where((beyond >= 0) & (bevel > depth), bevel, depth)
    return np.asarray(gaussian_filter(depth, 0.08 / MM_PER_PX))


def forces(made: list[Made], rng: np.random.Generator) -> ForceSeries:
    time = np.arange(0, made[-1].end_s + 3, 0.005)
    force = np.zeros((time.size, 3))
    for press in made:
        w = press.depth(time - press.clock_s)
        normal = C * w * (1 + 0.28 * w) + 0.5 * np.maximum(w - press.touch_mm, 0)
        aside = 0.25 if press.fault == "tangential" else 0.01
        if press.fault == "saturated":
            normal = np.minimum(normal, 0.6 * normal.max())
        force += np.c_[aside * normal, 0 * normal, normal]
    noise = np.array([0.00625, 0.00625, 0.0125]) * rng.standard_normal(force.shape)
    for press in made:
        if press.fault == "saturated":  # the rail itself is free of noise
            flat = (time > press.start_s) & (
                force[:, 2] >= 0.999 * force[(time > press.start_s) & (time < press.end_s), 2].max()
            )
            noise[flat & (time < press.end_s)] = 0
    return ForceSeries(time + OFFSET_S, force + noise + [0.1, -0.2, 0.3], (0.00625, 0.00625, 0.0125))


def recording(
    folder: Path, made: list[Made], *, seed: int = 0, rate_Hz: float = 30.0, state_place: bool = True
) -> tuple[Recording, Drawn]:
    """The recording, its empty pictures written to `folder`, and what draws its height maps."""
    rng = np.random.default_rng(seed)
    times: list[float] = []
    for press in made:
        here = np.arange(press.start_s + 0.45, press.end_s - 0.3, 1 / rate_Hz)
        here = here + rng.uniform(-0.1, 0.1, here.size) / rate_Hz
        if press.fault == "dropped_frames":
            here = here[np.abs(here - press.touch_s) > 0.15]
        if press.dwell_s:  # nothing new is to be seen there, and so few frames are kept
            here = here[(here < press.touch_s - 0.01) | (here > press.touch_s + press.dwell_s - 0.05)]
        if press.pause:  # the last of the ramp and the first of the hold go by unseen
            top_s = press.end_s - 0.5 - press.top_mm - HOLD_S
            here = here[(here < top_s - 0.8 * OVER_MM / SPEED) | (here > top_s + 0.9 * HOLD_S)]
        times += here.tolist()
    names = tuple(f"{k:05d}.png" for k in range(len(times)))
    ok, png = cv2.imencode(".png", np.full((SIZE[1], SIZE[0], 3), 99, np.uint8))
    assert ok
    for name in names:
        (folder / name).write_bytes(png.tobytes())
    gel = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)
    sensor = Sensor("custom", *SIZE, (MM_PER_PX, MM_PER_PX), gel)
    place: dict[str, Any] = {"bevel_distance_mm": 5.0, "bevel_angle_deg": 10.0} if state_place else {}
    indenters = {}
    for p in made:
        body: dict[str, Any] = {
            "radius_mm": 2.5,
            "height_mm": p.height_mm,
            "height_std_mm": 0.001,
            "bevel": p.side,
        }
        indenters[_name(p)] = Indenter(_name(p), **body, **place)
    presses = tuple(Press(str(k + 1), _name(p), p.start_s, p.end_s) for k, p in enumerate(made))
    drawn = Drawn(sensor, made, seed)
    return Recording(
        path=folder,
        name="drawn",
        sensor=sensor,
        indenters=indenters,
        presses=presses,
        frames_path=folder,
        frame_names=names,
        frame_times_s=np.array(times),
        forces=forces(made, rng),
    ), drawn


def _name(press: Made) -> str:
    return f"{press.side}{press.height_mm}"
