"""What is read of it: clocks, depth, forces, and what the picture makes of the depth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.design import Design, Motion, move
from benchmarks.blind.history import gel_force_N
from benchmarks.blind.world import World
from tactilevision.records.measured import Floats

RANGE_N = 1.0  # N, above which an amplifier with two ranges has another zero


@dataclass(frozen=True, slots=True)
class Reads:
    """All samples, (M, T): time, depth, force (M, T, 3) and the depth that the picture gives; without noise at
    first.
    """

    time_s: Floats
    depth_mm: Floats
    force_N: Floats
    seen_mm: Floats
    phase: tuple[str, ...]


def read(world: World, design: Design) -> Reads:
    """Everything that is read in this world by this design, without noise."""
    motion = move(design)
    force = gel_force_N(world, design, motion) + _slips(world, motion)
    true = _sample(motion.sample_s, motion, motion.depth_mm)
    normal = _sample(motion.sample_s, motion, force)
    late = _sample(motion.sample_s + world.amount("clock_offset"), motion, motion.depth_mm)
    side = np.array([t.shear for t in design.touches])[:, None, :] * normal[:, :, None]
    lean = world.amount("tilt") * normal[:, :, None]
    side = side + lean * [np.cos(world.shapes.get("azimuth", 0)), np.sin(world.shapes.get("azimuth", 0))]
    across = world.amount("force_crosstalk") * (side @ _direction(world))
    normal_read = normal + across + world.amount("force_bias") + _creep(world, motion)
    normal_read = normal_read + world.amount("two_ranges") * (normal > RANGE_N)
    depth = _depth_read(world, motion, late, normal)
    return Reads(
        motion.sample_s, depth, np.dstack([side, normal_read]), _picture(world, motion, true), motion.phase
    )


def _depth_read(world: World, motion: Motion, late: Floats, normal: Floats) -> Floats:
    if world.source == "vision":
        late = _picture(world, motion, late)
    depth = late + world.amount("backing_compliance") * normal - world.amount("depth_zero")
    if world.amount("screw_error"):
        turn = 2 * np.pi / world.shape("period_mm")
        depth = depth + world.amount("screw_error") * np.sin(turn * late + world.shape("azimuth"))
    back = np.array([word == "unload" for word in motion.phase])
    depth = depth + world.amount("backlash") * back
    # the bevel stands for a depth that the risen gel met early
    return np.asarray(depth / (1 - world.amount("bevel_rise") * world.shapes.get("rise", 0.1)))


def _picture(world: World, motion: Motion, true: Floats) -> Floats:
    """Depth that the picture gives: gain, drift over the presses, a slope that saturates, the more the deeper."""
    share = np.linspace(0, 1, len(true))[:, None]
    gain = 1 + world.amount("photometric_gain") + world.amount("photometric_drift") * share
    loss = np.sqrt(3 * world.amount("slope_saturation")) / 0.6
    bent = np.tanh(loss * true) / loss if loss else true
    return np.asarray(gain * bent)


def _creep(world: World, motion: Motion) -> Floats:
    """The force sensor's zero runs away from the moment of touch, and is back at the next press."""
    size = world.amount("zero_creep")
    if not size:
        return np.zeros_like(motion.sample_s)
    touch = np.array(
        [np.interp(0.0, d[:100], t[:100]) for d, t in zip(motion.depth_mm, motion.time_s, strict=True)]
    )
    age = np.maximum(motion.sample_s - touch[:, None], 0)
    return np.asarray(size * (1 - np.exp(-age / world.shape("creep_s"))))


def _slips(world: World, motion: Motion) -> Floats:
    """The gel sticks to the face and slips: the force drops and builds up again, at depths of chance."""
    size = world.amount("stick_slip")
    if not size:
        return np.zeros_like(motion.depth_mm)
    rng = np.random.default_rng(int(world.shape("slip_seed")))
    lost = np.zeros_like(motion.depth_mm)
    for row, depth in enumerate(motion.depth_mm):
        for place in rng.uniform(0.1, 0.9, 3) * depth.max():
            since = depth - place
            lost[row] += np.where((since > 0) & (motion.stage[row] < 2), np.exp(-since / 0.08), 0.0)
    return -size * lost


def _direction(world: World) -> Floats:
    azimuth = world.shapes.get("azimuth", 0.0)
    return np.array([np.cos(azimuth), np.sin(azimuth)])


def _sample(at_s: Floats, motion: Motion, values: Floats) -> Floats:
    rows = zip(at_s, motion.time_s, values, strict=True)
    return np.array([np.interp(at, time, value) for at, time, value in rows])


@dataclass(frozen=True, slots=True)
class Noise:
    """Of a sample in N, of a press (gain, and a zero of the depth in mm); `kind` white, ar1 or heavy."""

    sample_N: float = 0.004
    gain: float = 0.005
    zero_mm: float = 0.004
    kind: str = "white"

    def times(self, factor: float) -> Noise:
        """More or less of all of it."""
        return replace(
            self, sample_N=factor * self.sample_N, gain=factor * self.gain, zero_mm=factor * self.zero_mm
        )


AR1 = 0.6


def add_noise(reads: Reads, noise: Noise, rng: np.random.Generator) -> Reads:
    """What a real day would have given. The zero moves the depth, the gain the normal force, both press by
    press.
    """
    presses, samples = reads.depth_mm.shape
    zero = noise.zero_mm * rng.standard_normal((presses, 1))
    gain = 1 + noise.gain * rng.standard_normal((presses, 1))
    force = reads.force_N.copy()
    force[:, :, 2] = force[:, :, 2] * gain + noise.sample_N * _unit(noise.kind, (presses, samples), rng)
    force[:, :, :2] += noise.sample_N * rng.standard_normal((presses, samples, 2))
    seen = reads.seen_mm * (1 + 0.6 * noise.gain * rng.standard_normal((presses, 1)))
    seen = seen + 0.5 * noise.zero_mm * rng.standard_normal(seen.shape)
    return replace(reads, depth_mm=reads.depth_mm + zero, force_N=force, seen_mm=seen)


def _unit(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> Floats:
    """Numbers of variance 1: white, each .6 of the one before, or Student's t with three degrees of freedom."""
    if kind == "heavy":
        return np.asarray(rng.standard_t(3, shape) / np.sqrt(3))
    values = rng.standard_normal(shape)
    if kind == "ar1":
        for k in range(1, shape[1]):
            values[:, k] = AR1 * values[:, k - 1] + np.sqrt(1 - AR1**2) * values[:, k]
    return values
