"""Presses drawn from formulas of their own: tracks and forces of a rig whose law, pace and clocks are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.contact.bevel import strip_places
from tactilevision.press.force_readings import force_window, subtract_tares
from tactilevision.press.recording_fit import Tracked
from tactilevision.press.track import PressTrack
from tactilevision.recording.model import StageSeries
from tactilevision.records.maps import Footprint, HeightMap
from tactilevision.records.measured import Floats, ForceSeries
from tactilevision.records.rig import Indenter, Press

C, BETA, THICKNESS = 3.8, 0.85, 3.0
EDGE_MM, FILL_MM, OVER_MM = 5.0, 0.026, 0.08
FREE_S, HOLD_S, REST_S = 1.0, 0.5, 3.0
NOISE_N, NOISE_MM, DENT_NOISE_MM = 0.0125, 0.002, 0.0005


@dataclass(frozen=True, slots=True)
class Rig:
    """The truth: F/T minus camera clock, pace over the stated one, compliance, lateness of touches, relaxation."""

    offset_s: float = 0.05
    pace: float = 1.0
    give_mm_per_N: float = 0.0
    late_mm: float = 0.0
    relaxing: float = 0.0
    speed_mm_s: float = 0.25
    rate_Hz: float = 30.0
    crooked: float = 0.4
    drift_N_s: float = 0.0


def force_of(depth: Floats | float) -> Floats:
    """Return the planted force (N) at depths (mm)."""
    w = np.asarray(depth, dtype=np.float64)
    return np.asarray(C * w * (1 + BETA * w / THICKNESS))


def planted(
    heights: Sequence[float],
    rng: np.random.Generator,
    rig: Rig,
    *,
    heights_off: Sequence[float] | None = None,
    uneven: float = 0.0,
) -> tuple[list[Tracked], ForceSeries, StageSeries]:
    """Return presses, forces without their zeros, and the stage; `heights` are depths at the touch (mm).

    `heights_off` (mm): true depth of touch less the stated one. `uneven`: relative change of the pace on the way.
    """
    off = np.zeros(len(heights)) if heights_off is None else np.asarray(heights_off)
    starts, clock = [], 0.0
    for height in heights:
        starts.append(clock + FREE_S)
        clock = starts[-1] + (height + OVER_MM) / rig.speed_mm_s + HOLD_S + 1.5 + REST_S
    time = np.arange(0, clock + 1.0, 0.005)
    ways = [
        _way(time, start, height + OVER_MM, rig, uneven) for start, height in zip(starts, heights, strict=True)
    ]
    depth = sum((_depth_of(way, rig) for way in ways), np.zeros_like(time))
    touches = np.array(heights) + off
    elastic = force_of(depth)
    normal = elastic.copy()
    if rig.relaxing:
        branch = np.zeros_like(elastic)
        for i in range(1, elastic.size):
            branch[i] = (branch[i - 1] + elastic[i] - elastic[i - 1]) * np.exp(-0.005)
        normal = (1 - rig.relaxing) * elastic + rig.relaxing * branch
    for start, end, touch in zip(starts, [*starts[1:], clock], touches, strict=True):
        here = (time >= start - 0.5) & (time < end - 0.5)
        normal[here] += 3 * np.maximum(depth[here] - touch, 0) ** 1.5
    reading = np.c_[0 * normal, 0 * normal, normal + 0.2 + rig.drift_N_s * time]
    forces = ForceSeries(
        time + rig.offset_s, reading + NOISE_N * rng.standard_normal(reading.shape), (NOISE_N,) * 3
    )
    found, tares = [], []
    for k, (start, height) in enumerate(zip(starts, heights, strict=True)):
        end = starts[k + 1] if k + 1 < len(starts) else clock + 1.0
        press = Press(f"p{k}", f"A{height:g}", start - 0.3, end - REST_S, speed_mm_s=rig.speed_mm_s)
        window = force_window(forces, press, free_s=(start - FREE_S, end - FREE_S), offset_s=rig.offset_s)
        assert window is not None
        track = _track(press, height, time, depth, float(touches[k]), rng, rig)
        tares.append(window.tare)
        found.append(Tracked(track, window, height, EDGE_MM))
    stage = StageSeries(time + rig.offset_s, 7.0 + sum(ways, np.zeros_like(time)) / rig.pace)
    return found, subtract_tares(forces, tares), stage


def _way(time: Floats, start: float, top: float, rig: Rig, uneven: float) -> Floats:
    """Return the way (T,) mm of the rig into the gel: ramp, hold, quick release."""
    speed = rig.pace * rig.speed_mm_s
    since = time - start
    ramp = speed * since * (1 + uneven * np.sin(4 * np.maximum(since, 0)))
    reached = int(np.argmax(ramp >= top))
    release = top - np.maximum(time - time[reached] - HOLD_S, 0)
    return np.asarray(np.where(np.arange(time.size) < reached, np.clip(ramp, 0, top), np.maximum(release, 0)))


def _depth_of(way: Floats, rig: Rig) -> Floats:
    depth = way
    for _ in range(4):
        depth = np.maximum(way - rig.give_mm_per_N * force_of(depth), 0)
    return depth


def _track(
    press: Press, height: float, time: Floats, depth: Floats, touch: float, rng: np.random.Generator, rig: Rig
) -> PressTrack:
    """Return what a camera reads crookedly, at jittered times, of a press and of the dent at its bevel's edge."""
    frames = np.arange(press.start_s - 0.4, press.end_s, 1 / rig.rate_Hz)
    frames = frames + rng.uniform(-0.1, 0.1, frames.size) / rig.rate_Hz
    true = np.interp(frames, time, depth)
    read = true * (1.2 - rig.crooked * true) * rng.normal(1, 0.02) + NOISE_MM * rng.standard_normal(frames.size)
    beyond = np.maximum(true - touch - rig.late_mm, 0)
    dent = 0.8 * (0.45 * beyond + 0.55 * (np.hypot(beyond, FILL_MM) - FILL_MM))
    dent = dent + DENT_NOISE_MM * rng.standard_normal(frames.size)
    s = strip_places(8.0)
    strips = dent[:, None] * (np.abs(s - EDGE_MM) < 0.2)
    shape = (4, 4)
    face = Footprint(
        np.ones(shape, bool), (0.0, 0.0), 0.01, 2.5, 0.01, (0.0, 0.0), 1e-4, float(true.max()), 1e-3, 0.01
    )
    indenter = Indenter(
        f"A{height:g}", "flat_cylinder", radius_mm=2.5, height_mm=1.1 * height, height_std_mm=0.001, bevel="right",
        bevel_distance_mm=EDGE_MM, bevel_angle_deg=10.0,
    )  # fmt: skip
    nothing = HeightMap(np.zeros(shape), np.ones(shape, bool), (0.1, 0.1))
    return PressTrack(
        press=press, indenter=indenter, names=("",) * frames.size, time_s=frames, depth_mm=read, zero_mm=0.0,
        tilts=np.zeros((frames.size, 2)), s_mm=s, strips=strips, colours=np.zeros((frames.size, s.size, 3)),
        r_mm=np.arange(2.5, 6, 0.1), rings=np.zeros((frames.size, 4, 35)), deepest=int(true.argmax()),
        face_map=nothing, footprint=face,
    )  # fmt: skip
