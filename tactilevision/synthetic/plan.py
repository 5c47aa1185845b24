"""Which presses are made, in what order, and what goes wrong in the bad ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.synthetic.bevel import Bevel
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.profile import PunchProfile, punch_profile
from tactilevision.synthetic.punch import PunchPress
from tactilevision.synthetic.rig import GelLaw, Motion, Protocol, bevel_force_N, move

_RECOVERY = (0.05, 1.0)  # share of the force that a gel lacks right after a press, and its time constant in s


@dataclass(frozen=True, slots=True)
class PlannedPress:
    """One press in full. `fault` is empty for a good one; `touch_mm` the true depth at the bevel's touch."""

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
        """When the bevel first touches; NaN where it never does."""
        return self.motion.loading_time_s(self.touch_mm)

    def surface(self, time_s: float) -> PunchPress:
        """The gel at a time on the camera's clock."""
        return PunchPress(self.profile, float(self.motion.at(time_s)), self.centre_mm, self.tilt, self.bevel)

    def force_N(self, time_s: Floats, law: GelLaw) -> Floats:
        """True force (T, 3) at evenly spaced times on the camera's clock."""
        depth = self.motion.at(time_s)
        normal = law.force_N(self.profile, depth) * self.gain
        normal = normal + bevel_force_N(
            self.bevel, self.profile, reduced_modulus_MPa=law.reduced_modulus_MPa, depths_mm=depth
        )
        if time_s.size > 1:
            normal = law.relaxed(normal, float(time_s[1] - time_s[0]))
        return np.column_stack([self.tangential[0] * normal, self.tangential[1] * normal, normal])


def gel_law(options: SimulationOptions) -> GelLaw:
    """The modulus and the relaxation that the options ask for."""
    gel = options.gel
    return GelLaw(gel.youngs_modulus_MPa, gel.youngs_modulus_MPa / (1 - gel.poisson_ratio**2), gel.relaxing)


def gel_under(options: SimulationOptions, radius_mm: float) -> PunchProfile:
    """The options' gel under a punch of this radius."""
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
    """Heights over the bevel as they came out of the workshop, by indenter."""
    machined = np.asarray(options.indenters.heights_mm)
    made = machined + options.indenters.height_std_mm * rng.standard_normal(machined.size)
    return {f"A{i + 1}": float(height) for i, height in enumerate(made)}


def plan_presses(options: SimulationOptions, rng: np.random.Generator) -> tuple[PlannedPress, ...]:
    """Rounds through all indenters, the faults strewn in between, one after the other in time."""
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
    """The press at its time, with the rest the gel had before it."""
    motion = press.motion
    times = motion.time_s + start_s
    times[-1] = times[-2] + free_after_s
    moved = replace(motion, time_s=times)
    rest = moved.loading_time_s(0.0) - released_s
    share, constant = _RECOVERY
    return replace(press, motion=moved, rest_s=rest, gain=press.gain * (1 - share * np.exp(-rest / constant)))


def _centre(options: SimulationOptions, rng: np.random.Generator, *, cut: bool) -> Pair:
    """Near the middle, so far from the bevel's side that the bevel is in view; `cut`: over the far border."""
    kit, camera = options.indenters, options.camera
    towards = {"right": (1, 0), "left": (-1, 0), "top": (0, -1), "bottom": (0, 1)}[kit.bevel]
    half = np.array([camera.width_px * camera.mm_per_px[0], camera.height_px * camera.mm_per_px[1]]) / 2
    offset = -0.35 * kit.bevel_distance_mm
    if cut:
        offset = -float(half @ np.abs(towards)) + 0.45 * kit.radius_mm
    x, y = offset * np.asarray(towards) + rng.normal(0.0, options.rig.place_std_mm, 2)
    return float(x), float(y)


def _direction(rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])
