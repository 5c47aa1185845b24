"""What the gel does with time: stepped along every press and every wait, one internal state a spot."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.contact import REFERENCE_C, Curves, clinging_mm, elastic_N
from benchmarks.blind.design import Design, Motion
from benchmarks.blind.world import World
from tactilevision.records.measured import Floats

_ZERO_C_IN_K = 273.15


def gel_force_N(world: World, design: Design, motion: Motion) -> Floats:
    """The force that the gel bears (M, F), presses in their order."""
    pairs, known = zip(design.touches, motion.depth_mm, strict=True), Curves()
    force = np.array([elastic_N(world, touch, depth, known) for touch, depth in pairs])
    force *= modulus_factor(world, design)[:, None]
    force *= _worn(world, design, motion)
    elastic = _clings(world, design, motion, force)
    flowed = np.zeros_like(force)
    for key, tau in (("viscoelasticity", "tau_s"), ("recovery", "recovery_s")):
        if world.amount(key):
            flowed += world.amount(key) * _flows(design, motion, elastic, world.shape(tau))
    # a gel that has flowed leaves the face before depth 0, and pulls only where it clings
    return np.where(elastic > 0, np.maximum(elastic - flowed, 0), elastic)


def modulus_factor(world: World, design: Design) -> Floats:
    """What age and temperature do to the modulus, press by press (M,)."""
    warm = np.array([t.temperature_C for t in design.touches])
    factor = 1 + world.amount("temperature") * (warm - REFERENCE_C) / (REFERENCE_C + _ZERO_C_IN_K)
    if world.amount("ageing"):
        factor = factor * (1 + np.array([_aged(world, t.day) for t in design.touches]))
    return np.asarray(factor)


def _aged(world: World, day: int) -> float:
    """dE/dt = E0 alpha/(t + t0), in two thousand steps."""
    if day == 0:
        return 0.0
    steps = np.linspace(0, day, 2001)
    rate = world.amount("ageing") / (steps + world.shape("ageing_day"))
    return float(np.sum((rate[1:] + rate[:-1]) / 2 * np.diff(steps)))


def _worn(world: World, design: Design, motion: Motion) -> Floats:
    """Damage by the largest work done so far at a spot: less force below it (after Ogden and Roxburgh's error
    function).
    """
    size = world.amount("mullins")
    if not size:
        return np.ones_like(motion.depth_mm)
    from scipy.special import erf

    factor, worst = np.ones_like(motion.depth_mm), dict[tuple[float, float], float]()
    for row, touch in enumerate(design.touches):
        work = np.maximum(motion.depth_mm[row], 0) ** 2
        most = np.maximum(np.maximum.accumulate(work), worst.get(touch.place_mm, 0.0))
        factor[row] = 1 - size * erf((most - work) / world.shape("damage_mm") ** 2)
        worst[touch.place_mm] = float(most[-1])
    return factor


def _clings(world: World, design: Design, motion: Motion, force: Floats) -> Floats:
    """Below 0 nothing pushes; while unloading the face may pull, until it lets go."""
    free = motion.depth_mm < 0
    held = np.zeros_like(free)
    for row, touch in enumerate(design.touches):
        limit = clinging_mm(world, touch)
        held[row] = free[row] & (motion.stage[row] == 2) & (motion.depth_mm[row] >= -limit)
    # a face that stands askew presses above its first touch, which lies below the depth 0 of its centre
    return np.where(free & ~held & (force < 0), 0.0, force)


def _flows(design: Design, motion: Motion, force: Floats, tau: float) -> Floats:
    """State of a Maxwell branch, q' = (F - q)/tau, stepped with F straight in each step; each spot has its own.

    Between presses the state fades; another punch at the spot finds it in proportion to its own force.
    """
    flowed, state = np.zeros_like(force), dict[tuple[float, float], tuple[float, float, float]]()
    for row, touch in enumerate(design.touches):
        time, push = motion.time_s[row], force[row]
        size = float(push.max())
        q, ended, size_before = state.get(touch.place_mm, (0.0, -np.inf, 1.0))
        q *= float(np.exp(-(time[0] - ended) / tau)) * size / size_before
        step = np.diff(time)
        rate = np.diff(push) / np.where(step > 0, step, np.inf) * tau  # a design without a hold stands still
        steps = zip(np.exp(-step / tau).tolist(), rate.tolist(), push.tolist(), push[1:].tolist(), strict=False)
        for k, (kept, lag, before, after) in enumerate(steps, start=1):
            q = after - lag + (q - before + lag) * kept
            flowed[row, k] = q
        state[touch.place_mm] = (q, float(time[-1]), size)
    return flowed
