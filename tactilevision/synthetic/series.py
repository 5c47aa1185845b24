"""The tables of a simulated recording: readings of the force sensor, whole curves, certified points."""

from __future__ import annotations

import numpy as np

from tactilevision.records import CertifiedPoint, Curve, Floats
from tactilevision.synthetic.scenario import Story, stream

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
            touch = float(story.law.force_N(press.profile, press.touch_mm))
            force[rows, 2] += story.sensor.range_N - story.sensor.bias_N[2] - 0.7 * touch
    readings = story.sensor.read(force, camera_clock, rng)
    return np.round(camera_clock + story.clock_offset_s, 4), readings


def certified(story: Story) -> tuple[CertifiedPoint, ...]:
    """What a perfect eye would certify, with the force sensor's noise of one second and the workshop's heights."""
    rng = stream(story.seed, 1)
    noise = np.asarray(story.sensor.noise_N) / np.sqrt(story.options.rig.force_rate_Hz)
    kit = story.options.indenters
    points = []
    for press in (p for p in story.presses if not p.fault):
        normal = float(story.law.force_N(press.profile, press.touch_mm)) * press.gain
        fx, fy, fz = (
            round(float(f), 6) for f in normal * np.array([*press.tangential, 1.0]) + noise * rng.normal(size=3)
        )
        machined = kit.heights_mm[int(press.indenter[1:]) - 1]
        points.append(CertifiedPoint(
            press.label, press.indenter, round(press.touch_mm + machined - press.bevel.height_mm, 6), fz,
            depth_std_mm=kit.height_std_mm, fz_std_N=round(float(noise[2]), 6), fx_N=fx, fy_N=fy,
            time_s=round(press.touch_time_s, 4), rest_s=round(press.rest_s, 3),
            speed_mm_s=press.protocol.speed_mm_s,
        ))  # fmt: skip
    return tuple(points)


def curves(story: Story) -> tuple[Curve, ...]:
    """Depth of the gel and force against time at 50 Hz, on the camera's clock."""
    rng = stream(story.seed, 1)
    made = []
    for press in (p for p in story.presses if not p.fault):
        time_s = np.round(np.arange(press.start_s, press.end_s, 0.02), 4)
        depth = np.maximum(press.motion.at(time_s), 0.0) + DEPTH_STD_MM * rng.standard_normal(time_s.size)
        force = press.force_N(time_s, story.law) + rng.standard_normal((time_s.size, 3)) * story.sensor.noise_N
        phase = np.array(press.motion.phase_at(time_s))
        made.append(Curve(press.label, time_s, np.round(depth, 5), np.round(force, 5), phase))
    return tuple(made)
