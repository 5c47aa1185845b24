"""The tables of a simulated recording: readings of the force sensor, whole curves, certified points."""

from __future__ import annotations

import numpy as np

from tactilevision.records import CertifiedPoint, Curve, Floats
from tactilevision.synthetic.scenario import Scenario, stream

DEPTH_STD_MM = 0.003  # of one reading of depth in curves.csv


def read_forces(scenario: Scenario) -> tuple[Floats, Floats]:
    """Times on the F/T sensor's clock and its readings (T, 3), without a gap over the whole recording."""
    rng = stream(scenario.seed, 1)
    end = scenario.presses[-1].end_s + 0.5
    camera_clock = np.arange(0.3, end, 1 / scenario.options.rig.force_rate_Hz)
    force = np.zeros((camera_clock.size, 3))
    for press in scenario.presses:
        rows = slice(*np.searchsorted(camera_clock, [press.start_s, press.end_s]))
        force[rows] = press.force_N(camera_clock[rows], scenario.law)
        if press.fault == "saturated":  # a cable pulls on the sensor, which brings it to the end of its range
            touch = float(scenario.law.force_N(press.profile, press.touch_mm))
            force[rows, 2] += scenario.sensor.range_N - scenario.sensor.bias_N[2] - 0.7 * touch
    readings = scenario.sensor.read(force, camera_clock, rng)
    return np.round(camera_clock + scenario.clock_offset_s, 4), readings


def certified(scenario: Scenario) -> tuple[CertifiedPoint, ...]:
    """What a perfect eye would certify, with the force sensor's noise of one second and the workshop's heights."""
    rng = stream(scenario.seed, 1)
    noise = np.asarray(scenario.sensor.noise_N) / np.sqrt(scenario.options.rig.force_rate_Hz)
    kit = scenario.options.indenters
    points = []
    for press in (p for p in scenario.presses if not p.fault):
        normal = float(scenario.law.force_N(press.profile, press.touch_mm)) * press.gain
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


def curves(scenario: Scenario) -> tuple[Curve, ...]:
    """Depth of the gel and force against time at 50 Hz, on the camera's clock."""
    rng = stream(scenario.seed, 1)
    made = []
    for press in (p for p in scenario.presses if not p.fault):
        time_s = np.round(np.arange(press.start_s, press.end_s, 0.02), 4)
        depth = np.maximum(press.motion.at(time_s), 0.0) + DEPTH_STD_MM * rng.standard_normal(time_s.size)
        force = (
            press.force_N(time_s, scenario.law) + rng.standard_normal((time_s.size, 3)) * scenario.sensor.noise_N
        )
        phase = np.array(press.motion.phase_at(time_s))
        made.append(Curve(press.label, time_s, np.round(depth, 5), np.round(force, 5), phase))
    return tuple(made)
