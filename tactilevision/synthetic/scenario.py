"""Plan the presses of a simulated recording, with its force tables and its truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Curve, Floats, Pair
from tactilevision.synthetic.lights import SlopeResponse
from tactilevision.synthetic.options import GelOptions, SimulationOptions
from tactilevision.synthetic.punch import SIDES, Bevel, PunchPress, PunchProfile, punch_profile
from tactilevision.synthetic.rig import ForceSensor, Motion, Protocol, move

DEPTH_STD_MM = 0.003  # of one reading of depth in curves.csv
_RECOVERY = (0.05, 1.0)  # share of the force missing right after a press, and its time constant in s


@dataclass(frozen=True, slots=True)
class PlannedPress:
    """One press. `fault` is empty for a good one; `touch_mm`: true depth at the touch of the bevel."""

    label: str
    indenter: str
    fault: str
    motion: Motion
    protocol: Protocol
    centre_mm: Pair
    tilt: Pair
    profile: PunchProfile
    bevel: Bevel
    touch_mm: float
    rest_s: float
    gain: float
    tangential: Pair

    @property
    def start_s(self) -> float:
        return float(self.motion.time_s[0])

    @property
    def end_s(self) -> float:
        return float(self.motion.time_s[-1])

    @property
    def touch_time_s(self) -> float:
        """Time of the bevel's first touch; NaN if it never touches."""
        return self.motion.loading_time_s(self.touch_mm)

    def surface(self, time_s: float) -> PunchPress:
        """Return the gel at a time on the camera's clock."""
        return PunchPress(self.profile, float(self.motion.at(time_s)), self.centre_mm, self.tilt, self.bevel)

    def touch_force_N(self, gel: GelOptions) -> float:
        """Return the normal force at the touch of the bevel."""
        return float(gel.force_N(self.profile, self.touch_mm)) * self.gain

    def force_N(self, time_s: Floats, gel: GelOptions) -> Floats:
        """Return the true force (T, 3) at evenly spaced times on the camera's clock."""
        depth = self.motion.at(time_s)
        normal = gel.force_N(self.profile, depth) * self.gain
        reduced_MPa = gel.reduced_modulus_MPa
        normal = normal + self.bevel.force_N(self.profile, depth, reduced_modulus_MPa=reduced_MPa)
        if time_s.size > 1:
            normal = gel.relaxed(normal, float(time_s[1] - time_s[0]))
        return np.column_stack([self.tangential[0] * normal, self.tangential[1] * normal, normal])


def gel_under(options: SimulationOptions, radius_mm: float) -> PunchProfile:
    """Return the gel of the options under a punch of this radius."""
    gel = options.gel
    return punch_profile(
        gel.poisson_ratio,
        radius_mm,
        gel.thickness_mm,
        friction=gel.friction,
        edge_radius_mm=options.indenters.edge_radius_mm,
        pad_radius_mm=gel.radius_mm,
    )


def true_heights(options: SimulationOptions, rng: np.random.Generator) -> dict[str, float]:
    """Return the true heights over the bevel, by indenter."""
    nominal = np.asarray(options.indenters.heights_mm)
    made = nominal + options.indenters.height_std_mm * rng.standard_normal(nominal.size)
    return {f"A{i + 1}": float(height) for i, height in enumerate(made)}


def plan_presses(options: SimulationOptions, rng: np.random.Generator) -> tuple[PlannedPress, ...]:
    """Return rounds of presses by all indenters, with the faults at random places in between."""
    heights = true_heights(options, rng)
    order = [(name, "") for _ in range(options.presses) for name in heights]
    for i, fault in enumerate(options.faults):
        name = list(heights)[-1 if fault == "saturated" else i % len(heights)]
        order.insert(int(rng.integers(1, max(len(order), 1) + 1)), (name, fault))
    presses: list[PlannedPress] = []
    clock_s, released_s = 1.0, -20.0
    for number, (name, fault) in enumerate(order, start=1):
        hurried = number < len(order) and order[number][1] == "short_rest"
        press = _press(options, rng, label=f"p{number:02d}", indenter=(name, heights[name]), fault=fault)
        press = _placed(press, clock_s, released_s, free_after_s=0.25 if hurried else press.protocol.free_s)
        presses.append(press)
        released_s = press.motion.released_s()
        clock_s = press.end_s + (0.02 if hurried else options.rig.protocol.rest_s * rng.uniform(0.9, 1.3))
    return tuple(presses)


def _press(
    options: SimulationOptions, rng: np.random.Generator, *, label: str, indenter: tuple[str, float], fault: str
) -> PlannedPress:
    kit, rig = options.indenters, options.rig
    tilt = rng.normal(0.0, rig.tilt_std, 2)
    if fault == "tilt":
        tilt = _direction(rng) * rng.uniform(0.03, 0.045)
    radius = kit.radius_mm * (0.8 if fault == "footprint" else 1.0)
    profile = gel_under(options, radius)
    bevel = Bevel(kit.bevel, kit.bevel_distance_mm, indenter[1], kit.bevel_angle_deg, kit.radius_mm)
    slope = (float(tilt[0]), float(tilt[1]))
    touch = bevel.touch_depth_mm(profile, slope)
    deepest = touch * 0.75 if fault == "bevel_not_touched" else touch + rig.protocol.overtravel_mm
    protocol = replace(rig.protocol, free_s=0.05, gap_mm=0.02) if fault == "short_rest" else rig.protocol
    ratio = rng.uniform(0.2, 0.3) if fault == "tangential" else rig.tangential * rng.uniform(0.3, 1.0)
    aside = _direction(rng) * ratio
    centre = _centre(options, rng, cut=fault == "border")
    gain = 1 + rig.gain_std * rng.standard_normal()
    return PlannedPress(
        label,
        indenter[0],
        fault,
        move(protocol, touch, deepest_mm=deepest),
        protocol,
        centre,
        slope,
        profile,
        bevel,
        touch,
        0.0,
        float(gain),
        (float(aside[0]), float(aside[1])),
    )


def _placed(press: PlannedPress, start_s: float, released_s: float, *, free_after_s: float) -> PlannedPress:
    """Return the press at its time, with the rest of the gel before it."""
    motion = press.motion
    times = motion.time_s + start_s
    times[-1] = times[-2] + free_after_s
    moved = replace(motion, time_s=times)
    rest = moved.loading_time_s(0.0) - released_s
    share, constant = _RECOVERY
    return replace(press, motion=moved, rest_s=rest, gain=press.gain * (1 - share * np.exp(-rest / constant)))


def _centre(options: SimulationOptions, rng: np.random.Generator, *, cut: bool) -> Pair:
    """Return a place near the middle with the bevel in view; `cut`: over the far border."""
    kit = options.indenters
    towards = SIDES[kit.bevel]
    offset = -0.35 * kit.bevel_distance_mm
    if cut:
        offset = -float(np.dot(options.camera.half_mm, np.abs(towards))) + 0.45 * kit.radius_mm
    x, y = offset * np.asarray(towards) + rng.normal(0.0, options.rig.place_std_mm, 2)
    return float(x), float(y)


def _direction(rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that happens in a simulated recording: presses, clocks, the force sensor."""

    options: SimulationOptions
    seed: int
    presses: tuple[PlannedPress, ...]
    clock_offset_s: float
    sensor: ForceSensor

    def read_forces(self) -> tuple[Floats, Floats]:
        """Return times on the force sensor's clock and its readings (T, 3) over the whole recording."""
        rng = stream(self.seed, 1)
        end = self.presses[-1].end_s + 0.5
        camera_clock = np.arange(0.3, end, 1 / self.options.rig.force_rate_Hz)
        force = np.zeros((camera_clock.size, 3))
        for press in self.presses:
            rows = slice(*np.searchsorted(camera_clock, [press.start_s, press.end_s]))
            force[rows] = press.force_N(camera_clock[rows], self.options.gel)
            if press.fault == "saturated":  # a cable pulls the sensor to the end of its range
                touch = float(self.options.gel.force_N(press.profile, press.touch_mm))
                force[rows, 2] += self.sensor.range_N - self.sensor.bias_N[2] - 0.7 * touch
        readings = self.sensor.read(force, camera_clock, rng)
        return np.round(camera_clock + self.clock_offset_s, 4), readings

    def certified(self) -> tuple[CertifiedPoint, ...]:
        """Return the true points, with the noise of one second of force readings and the nominal heights."""
        rng = stream(self.seed, 1)
        noise = np.asarray(self.sensor.noise_N) / np.sqrt(self.options.rig.force_rate_Hz)
        kit = self.options.indenters
        points = []
        for press in (p for p in self.presses if not p.fault):
            normal = press.touch_force_N(self.options.gel)
            force_N = normal * np.array([*press.tangential, 1.0]) + noise * rng.normal(size=3)
            fx, fy, fz = np.round(force_N, 6).tolist()
            machined = kit.heights_mm[int(press.indenter[1:]) - 1]
            points.append(CertifiedPoint(
                press.label, press.indenter, round(press.touch_mm + machined - press.bevel.height_mm, 6), fz,
                depth_std_mm=kit.height_std_mm, fz_std_N=round(float(noise[2]), 6), fx_N=fx, fy_N=fy,
                time_s=round(press.touch_time_s, 4), rest_s=round(press.rest_s, 3),
                speed_mm_s=press.protocol.speed_mm_s,
            ))  # fmt: skip
        return tuple(points)

    def curves(self) -> tuple[Curve, ...]:
        """Return depth and force against time at 50 Hz, on the camera's clock."""
        rng = stream(self.seed, 1)
        made = []
        for press in (p for p in self.presses if not p.fault):
            time_s = np.round(np.arange(press.start_s, press.end_s, 1 / 50), 4)
            depth = np.maximum(press.motion.at(time_s), 0.0) + DEPTH_STD_MM * rng.standard_normal(time_s.size)
            noise_N = rng.standard_normal((time_s.size, 3)) * self.sensor.noise_N
            force = press.force_N(time_s, self.options.gel) + noise_N
            phase = np.array(press.motion.phase_at(time_s))
            made.append(Curve(press.label, time_s, np.round(depth, 5), np.round(force, 5), phase))
        return tuple(made)

    def truth(self) -> dict[str, Any]:
        """Return the content of truth.toml: the material by the names of calibration.json, and every press."""
        gel, kit = self.options.gel, self.options.indenters
        profile = gel_under(self.options, kit.radius_mm)
        line = profile.line()
        return {
            "seed": self.seed,
            "youngs_modulus_MPa": gel.youngs_modulus_MPa,
            "poisson_ratio": gel.poisson_ratio,
            "reduced_modulus_MPa": gel.reduced_modulus_MPa,
            "c_N_per_mm": gel.youngs_modulus_MPa * line[0],
            "beta": line[1],
            "friction": gel.friction,
            "edge_radius_mm": kit.edge_radius_mm,
            "solved_to_mm": float(profile.depths_mm[-1]),
            "clock_offset_s": self.clock_offset_s,
            "presses_accepted": [p.label for p in self.presses if not p.fault],
            "presses_rejected": [{"press": p.label, "reason": p.fault} for p in self.presses if p.fault],
            "press": [_press_truth(self, p) for p in self.presses],
            **_hidden(self.options.slope_response),
        }


def draw_scenario(options: SimulationOptions, seed: int) -> Scenario:
    """Return a random scenario, without the noise of pictures and forces."""
    rng = stream(seed, 0)
    gel = options.gel
    presses = plan_presses(options, rng)
    offset = options.rig.clock_offset_s
    random_offset = float(rng.uniform(-0.2, 0.2))
    largest = max(float(gel.force_N(p.profile, p.touch_mm + options.rig.protocol.overtravel_mm)) for p in presses)
    bias, drift = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1e-4, 1e-4, 3)
    sensor = ForceSensor(
        bias_N=(float(bias[0]), float(bias[1]), float(bias[2])),
        drift_N_s=(float(drift[0]), float(drift[1]), float(drift[2])),
        range_N=round(1.4 * largest + 0.5, 1),
    )
    return Scenario(options, seed, presses, random_offset if offset is None else offset, sensor)


def stream(seed: int, number: int) -> np.random.Generator:
    """Return one of several independent generators, so that the picture format does not affect the forces."""
    return np.random.default_rng([seed, number])


def _hidden(slope_response: SlopeResponse) -> dict[str, Any]:
    """Return the changes of the light since the reference pictures; empty without any."""
    amounts = {
        "photometric_gain": (slope_response.gain, "1"),
        "photometric_drift": (slope_response.drift, "1"),
        "slope_saturation": (0.0 if math.isinf(slope_response.steepest) else slope_response.steepest, "mm/mm"),
    }
    tables = {
        key: {"amount": amount, "unit": unit, "catalogued": True}
        for key, (amount, unit) in amounts.items()
        if amount
    }
    return {"hidden": tables} if tables else {}


def _press_truth(scenario: Scenario, press: PlannedPress) -> dict[str, Any]:
    content = {
        "press": press.label,
        "indenter": press.indenter,
        "good": not press.fault,
        "reason": press.fault,
        "height_mm": press.bevel.height_mm,
        "centre_mm": list(press.centre_mm),
        "tilt": list(press.tilt),
        "gain": press.gain,
    }
    if not math.isnan(press.touch_time_s):
        force_N = press.touch_force_N(scenario.options.gel)
        content |= {"touch_time_s": press.touch_time_s, "depth_mm": press.touch_mm, "force_N": force_N}
    return content
