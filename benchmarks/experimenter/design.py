"""Draw the gel and the presses of one recording: how many, which radii, rates, holds, places and waits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.others_curves.law import BEND, Array, growth, slope_N_per_mm
from benchmarks.others_curves.protocol import FREE, HOLD, LOAD, UNLOAD, Press, Protocol

PRESSES = (8, 40)  # fewest and most
GAP_MM = 0.05  # from a press's begin to the surface
AIR_S = 1.0  # before a press begins to move
AIR = 4  # readings of air before the touch
LEVELS = (0.5, 0.75, 1.0)  # of the deepest
TOLERANCE_MM = (0.02, 0.005)  # std of the thickness and of a radius, where they are stated
SEVERAL_RADII = ("wrong_thickness",)  # kinds that are of several radii by definition
ON_A_STAGE = ("backlash", "slip_stick", "tilt_soft_frame", "swelling", "depth_steps", "clock_rate")


@dataclass(frozen=True, slots=True)
class Gel:
    """What is true of a gel and its punches; `radius_mm` the true radius of each stated one."""

    modulus_MPa: float
    nu: float
    bend: float
    thickness_mm: float
    radius_mm: Mapping[float, float]

    def force_N(self, press: Press, depth_mm: Array, *, thickness_mm: float = 0.0) -> Array:
        """Force of a flat punch at these depths (n,), N; 0 in air. `thickness_mm` where it is not the gel's."""
        h, a = thickness_mm or self.thickness_mm, self.radius_mm[press.radius_mm]
        deep = np.maximum(depth_mm, 0.0)
        k = slope_N_per_mm(self.modulus_MPa, self.nu, round(a, 6), h)
        return np.asarray(k * deep * growth(deep / h, self.bend * a / h, curve=0.0))

    def slope_N_per_mm(self, press: Press, depth_mm: Array) -> Array:
        """dP/dw at these depths (n,), N/mm; 0 in air."""
        step = 1e-4
        rise = self.force_N(press, depth_mm + step) - self.force_N(press, depth_mm)
        return np.where(depth_mm > 0, rise / step, 0.0)


@dataclass(frozen=True, slots=True)
class Statement:
    """What the recording states: `nu` None where it does not; std of 0 are left out."""

    nu: float | None
    depth_source: str
    thickness_std_mm: float
    radius_std_mm: float


def draw(rng: np.random.Generator, kind: str, *, nu_std: float) -> tuple[Gel, Protocol, Statement]:
    """Return gel, presses and what is stated of them."""
    thickness = float(rng.choice([2.0, 2.5, 3.0, 4.0]))
    count = int(rng.integers(PRESSES[0], PRESSES[1] + 1))
    several = 1 + int(rng.integers(3)) if kind not in SEVERAL_RADII else 2 + int(rng.integers(2))
    radii = np.round(thickness * np.sort(rng.choice([0.4, 0.55, 0.7, 0.85, 1.0, 1.15], several, replace=False)), 2)
    speeds = np.exp(rng.uniform(np.log(0.05), np.log(1.0), 1 + int(rng.integers(3)))).round(3)
    holds = rng.choice([0.0, 1.0, 2.0, 8.0], 1 + int(rng.integers(2)), replace=False)
    deepest = thickness * float(rng.uniform(0.12, 0.2))
    back = kind in ("adhesion", "backlash") or bool(rng.random() < 0.8)
    samples = int(rng.integers(20, 41))
    spread = kind == "debonded_zone" or bool(rng.random() < 0.5)
    longest = float(np.exp(rng.uniform(np.log(20), np.log(120))))
    presses, clock = list[Press](), 20.0
    for k in range(count):
        a = float(radii[k] if k < several else rng.choice(radii))
        speed, hold = float(rng.choice(speeds)), float(rng.choice(holds))
        depth = deepest * float(LEVELS[k % 3] if k < 3 else rng.choice(LEVELS))
        time, path, phase, corners = _path(depth, speed, hold, back=back, samples=samples)
        x, y = np.round(rng.uniform(-7, 7, 2), 1) if spread else (0.0, 0.0)
        rest = float(rng.uniform(0.3, 1.0)) * longest
        clock += rest
        place = (float(x), float(y))
        one = Press(a, clock + time, path, phase, corners, rest, speed, hold, place, 0, float("nan"))
        presses.append(one)
        clock = float(one.time_s[-1])
    tolerances = TOLERANCE_MM if rng.random() < 0.5 else (0.0, 0.0)
    nu = float(rng.uniform(0.46, 0.494))
    gel = Gel(
        modulus_MPa=float(np.round(np.exp(rng.uniform(np.log(0.08), np.log(0.8))), 4)),
        nu=round(nu, 4),
        bend=BEND * float(rng.uniform(0.92, 1.1)),
        thickness_mm=round(thickness + tolerances[0] * rng.standard_normal(), 4),
        radius_mm={float(a): round(float(a) + tolerances[1] * rng.standard_normal(), 4) for a in radii},
    )
    stated_nu = round(min(nu + nu_std * rng.standard_normal(), 0.4995), 4)
    source = "stage" if kind in ON_A_STAGE or rng.random() < 0.5 else "vision"
    stated = Statement(stated_nu if rng.random() < 0.8 else None, source, *tolerances)
    return gel, Protocol(tuple(presses), thickness), stated


def _path(
    deepest_mm: float, speed: float, hold: float, *, back: bool, samples: int
) -> tuple[Array, Array, tuple[str, ...], Array]:
    """Return times since the begin, depths, phases, and the corners of the way."""
    way_s = (deepest_mm + GAP_MM) / speed
    ends = np.cumsum([AIR_S, way_s, hold, way_s if back else 0.0])
    counts = (samples // 2, samples // 4 if hold else 0, samples // 3 if back else 0)
    times, phases = [np.linspace(0, 0.9 * AIR_S, AIR)], [FREE] * AIR
    for begin, end, n, name in zip(ends[:3], ends[1:], counts, (LOAD, HOLD, UNLOAD), strict=True):
        times.append(np.linspace(begin, end, n + 1)[1:])
        phases += [name] * n
    time = np.concatenate(times)
    up = -GAP_MM if back else deepest_mm
    corners = np.array([[0.0, *ends], [-GAP_MM, -GAP_MM, deepest_mm, deepest_mm, up]])
    depth = np.interp(time, *corners)
    named = tuple(FREE if w < 0 and p == LOAD else p for w, p in zip(depth, phases, strict=True))
    return time, depth, named, corners
