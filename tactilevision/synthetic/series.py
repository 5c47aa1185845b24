"""The tables of a simulated recording: readings of the force sensor, whole curves, certified points."""

from __future__ import annotations

import numpy as np

from tactilevision.records import Floats
from tactilevision.synthetic.story import Story, stream

DEPTH_STD_MM = 0.003  # of one reading of depth in curves.csv


def read_forces(story: Story) -> tuple[Floats, Floats]:
    """Times on the F/T sensor's clock and its readings (T, 3), without a gap over the whole recording."""
    rng = stream(story.seed, 1)
    end = story.presses[-1].end_s + 0.5
    camera_clock = np.arange(0.3, end, 1 / story.options.rig.force_rate_Hz)
    force = np.zeros((camera_clock.size, 3))
    for press in story.presses:
        rows = slice(*np.searchsorted(camera_clock, [press.start_s, press.end_s]))
        force[rows] = press.force_N(camera_clock[rows], story.law)
        if press.fault == "saturated":  # a cable pulls on the sensor, which brings it to the end of its range
            touch = float(story.law.force_N(press.touch_mm))
            force[rows, 2] += story.sensor.range_N - story.sensor.bias_N[2] - 0.7 * touch
    readings = story.sensor.read(force, camera_clock, rng)
    return camera_clock + story.clock_offset_s, readings


def certified(story: Story) -> list[dict[str, object]]:
    """Rows of points.csv: what a perfect eye would certify, with the force sensor's noise of one second."""
    rng = stream(story.seed, 1)
    rows: list[dict[str, object]] = []
    noise = np.asarray(story.sensor.noise_N) / np.sqrt(story.options.rig.force_rate_Hz)
    machined = dict(zip(_names(story), story.options.indenters.heights_mm, strict=True))
    for press in (p for p in story.presses if not p.fault):
        force = story.law.force_N(press.touch_mm) * press.gain
        fx, fy, fz = force * np.array([*press.tangential, 1.0]) + noise * rng.standard_normal(3)
        depth = press.touch_mm + machined[press.indenter] - press.bevel.height_mm
        rows.append({
            "press": press.label, "indenter": press.indenter, "depth_mm": round(depth, 6), "fz_N": round(fz, 6),
            "depth_std_mm": story.options.indenters.height_std_mm, "fz_std_N": round(float(noise[2]), 6),
            "fx_N": round(fx, 6), "fy_N": round(fy, 6), "time_s": round(press.touch_time_s, 4),
            "rest_s": round(press.rest_s, 3), "speed_mm_s": press.protocol.speed_mm_s,
        })  # fmt: skip
    return rows


def curves(story: Story) -> list[dict[str, object]]:
    """Rows of curves.csv: depth of the gel and force against time at 50 Hz, on the camera's clock."""
    rng = stream(story.seed, 1)
    rows: list[dict[str, object]] = []
    for press in (p for p in story.presses if not p.fault):
        time_s = np.arange(press.start_s, press.end_s, 0.02)
        depth = np.maximum(press.motion.at(time_s), 0.0) + DEPTH_STD_MM * rng.standard_normal(time_s.size)
        force = press.force_N(time_s, story.law) + rng.standard_normal((time_s.size, 3)) * story.sensor.noise_N
        for t, w, f, phase in zip(time_s, depth, force, press.motion.phase_at(time_s), strict=True):
            rows.append({"press": press.label, "phase": phase, "time_s": round(t, 4), "depth_mm": round(w, 5),
                         "fx_N": round(f[0], 5), "fy_N": round(f[1], 5), "fz_N": round(f[2], 5)})  # fmt: skip
    return rows


def _names(story: Story) -> list[str]:
    return [f"A{i + 1}" for i in range(len(story.options.indenters.heights_mm))]
