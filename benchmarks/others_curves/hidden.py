"""What may be hidden, each by a formula of its own; sizes are drawn log-evenly within a range.

`SINGLE` has a key of the catalogue; `OUTSIDE` nobody's. `Gel` is what the force depends on and `read` what the
rig makes of it; both take a dictionary of sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.others_curves.law import Array, growth, kappa, kappa_between, rounded, slope_N_per_mm
from benchmarks.others_curves.protocol import UNLOAD, Press, Protocol

SINGLE: Mapping[str, tuple[float, float]] = {
    "depth_zero": (0.006, 0.04),
    "force_bias": (0.01, 0.06),
    "force_crosstalk": (0.02, 0.06),
    "clock_offset": (0.01, 0.08),
    "backing_compliance": (2e-3, 15e-3),
    "edge_fillet": (0.08, 0.4),
    "lateral_boundary": (0.05, 0.25),
    "thickness_wedge": (0.004, 0.02),
    "thickness": (0.08, 0.3),
    "adhesion": (0.1, 1.0),
    "viscoelasticity": (0.04, 0.25),
    "recovery": (0.02, 0.08),
    "mullins": (0.04, 0.15),
    "stiffening": (3.0, 10.0),
    "ageing": (0.03, 0.15),
    "temperature": (0.005, 0.02),
}
OUTSIDE: Mapping[str, tuple[float, float]] = {
    "periodic_stage": (0.004, 0.012),
    "creep_of_sensor": (0.01, 0.04),
    "stick_slip": (0.02, 0.08),
    "backlash": (0.008, 0.03),
    "drift_of_zero": (0.02, 0.08),
    "jump_of_zero": (0.02, 0.08),
    "bubble": (0.05, 0.12),
    "vibration": (0.01, 0.03),
}
NAMES: Mapping[str, str] = {  # of those outside that are effects by now
    "periodic_stage": "screw_error",
    "creep_of_sensor": "zero_creep",
    "backlash": "backlash",
    "drift_of_zero": "force_drift",
    "jump_of_zero": "force_jump",
}
FINE = 4  # steps of memory between two samples
CROSS = 0.3  # of the normal force: std of the tangential one


@dataclass(frozen=True, slots=True)
class Gel:
    """A material and its law; `sizes` what is hidden, `tau_s` how long memory lasts, `at` a share of the way."""

    modulus_MPa: float
    nu: float
    bend: float
    curve: float
    sizes: Mapping[str, float]
    tau_s: float
    at: float

    def size(self, key: str) -> float:
        """Zero where it is not hidden."""
        return float(self.sizes.get(key, 0.0))


def forces_N(gel: Gel, protocol: Protocol) -> list[Array]:
    """Normal force of each press (n,), its history included."""
    deepest: dict[tuple[float, float], float] = {}
    healing: dict[tuple[float, float], tuple[float, float]] = {}  # of each place: what is lost there, and when
    found = []
    for press in protocol.presses:
        force = _elastic(gel, protocol, press)
        past = deepest.get(press.place_mm, 0.0)
        softer = 1 - _softened(gel, press, past)
        force = force * softer
        deepest[press.place_mm] = max(past, float(press.depth_mm.max()))
        force = force * _relaxed_share(gel, press, force)
        if gel.size("recovery"):
            state, last = healing.get(press.place_mm, (0.0, 0.0))
            state *= float(np.exp(-(press.time_s[0] - last) / 60.0))
            force = force * (1 - state)
            healing[press.place_mm] = gel.size("recovery") + state / 2, float(press.time_s[-1])
        found.append(force + softer * _pull(gel, protocol, press))  # what is softer pulls less
    return found


def _elastic(gel: Gel, protocol: Protocol, press: Press) -> Array:
    """At once, N."""
    x, y = press.place_mm
    thickness = protocol.thickness_mm * (1 + gel.size("thickness")) * (1 + gel.size("thickness_wedge") * x)
    depth = np.maximum(press.depth_mm, 0.0)
    modulus = gel.modulus_MPa * (1 + gel.size("ageing") * np.log1p(press.day / 3.0))
    if np.isfinite(press.temperature_C):
        modulus *= 1 + gel.size("temperature") * (press.temperature_C - 22)
    k = slope_N_per_mm(modulus, gel.nu, press.radius_mm, thickness)
    strain, bend = depth / thickness, gel.bend * press.radius_mm / thickness
    force = k * depth * growth(strain, bend, curve=gel.curve) + k * depth * gel.size("stiffening") * strain**2
    force = force * (1 - gel.size("lateral_boundary") * (x**2 + y**2) / 100)
    if gel.size("edge_fillet"):
        edge, whole = gel.size("edge_fillet"), press.radius_mm / thickness
        a, share = rounded(depth, press.radius_mm, edge)
        near = kappa_between(round(gel.nu, 6), a / thickness, ends=(whole - edge / thickness, whole))
        force = force * share * near / kappa(round(gel.nu, 6), round(whole, 6))
    return np.asarray(force)


def _softened(gel: Gel, press: Press, past_mm: float) -> Array:
    """Below the deepest that the place has seen so far, in this press too (Ogden and Roxburgh 1999)."""
    so_far = np.maximum(np.maximum.accumulate(press.depth_mm), max(past_mm, 1e-9))
    return np.asarray(gel.size("mullins") * (1 - np.clip(press.depth_mm / so_far, 0.0, 1.0) ** 2))


def _relaxed_share(gel: Gel, press: Press, force_N: Array) -> Array:
    """Of the force at once, in steps of a memory that takes `tau_s`; a gel that lags does not pull."""
    g = gel.size("viscoelasticity")
    if not g:
        return np.ones(force_N.size)
    fine = np.interp(np.arange(0, force_N.size - 1 + 1 / FINE, 1 / FINE), np.arange(force_N.size), press.time_s)
    path = np.interp(fine, press.time_s, force_N)
    held = np.zeros(path.size)
    for k in range(1, path.size):
        fade = np.exp(-(fine[k] - fine[k - 1]) / gel.tau_s)
        held[k] = held[k - 1] * fade + (path[k] - path[k - 1]) * np.sqrt(fade)
    left = np.maximum((1 - g) * path + g * held, 0.0)
    return np.asarray(np.where(force_N > 0, left[::FINE] / np.maximum(force_N, 1e-12), 1.0))


def _pull(gel: Gel, protocol: Protocol, press: Press) -> Array:
    """A face that clings: straight on below the touch on the way out, until it lets go (Kendall 1971)."""
    if not gel.size("adhesion"):
        return np.zeros(press.depth_mm.size)
    k = slope_N_per_mm(gel.modulus_MPa, gel.nu, press.radius_mm, protocol.thickness_mm)
    pull_off = np.sqrt(
        8 * np.pi * press.radius_mm**3 * gel.modulus_MPa / (1 - gel.nu**2) * gel.size("adhesion") * 1e-3
    )
    below = np.minimum(press.depth_mm, 0.0) * k
    back = np.array([name == UNLOAD for name in press.phase])
    return np.where(back & (-below < pull_off), below, 0.0)


def misread(
    gel: Gel, press: Press, force_N: Array, *, row: int, share: float, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    """What a rig with its faults reads of a depth and a force (n,), noise apart, and the tangential force's share.

    `row` of the press, `share` of the recording that has passed.
    """
    depth, time = press.depth_mm - gel.size("depth_zero"), press.time_s - press.time_s[0]
    if gel.size("clock_offset"):
        depth = np.interp(time + gel.size("clock_offset"), *press.corners)
    depth = depth + gel.size("backing_compliance") * force_N
    depth = depth + gel.size("periodic_stage") * np.sin(2 * np.pi * press.depth_mm / 0.12 + 1.0)
    back = np.array([name == UNLOAD for name in press.phase])
    depth = depth + gel.size("backlash") * back
    cross = float(rng.normal(0, CROSS)) if gel.size("force_crosstalk") else 0.0
    late, since = float(share > gel.at), np.maximum(time - time[int(np.argmax(press.depth_mm > 0))], 0.0)
    force = force_N * (1 + gel.size("force_crosstalk") * cross) + gel.size("force_bias")
    force = force - gel.size("creep_of_sensor") * (1 - np.exp(-since / 2.0))
    force = force + gel.size("drift_of_zero") * share + gel.size("jump_of_zero") * late
    force = force + gel.size("vibration") * np.sin(2 * np.pi * 0.9 * time + row)
    if gel.size("stick_slip"):
        slips = rng.uniform(0.3, 0.9) * press.depth_mm.max()
        force = (
            force - gel.size("stick_slip") * force_N.max() * np.exp(-np.abs(press.depth_mm - slips) / 0.02) * ~back
        )
    if gel.size("bubble") and row == 4:
        force = force * (1 - gel.size("bubble") * 3)
    return np.asarray(depth), np.asarray(force), cross
