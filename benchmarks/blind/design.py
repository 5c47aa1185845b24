"""What is measured: three designs, from one punch and six presses to all that a diagnosis could wish for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.records.measured import Floats

AIR_MM = -0.04


@dataclass(frozen=True, slots=True)
class Touch:
    """One press: place and shear (x, y), day since the first, rest before it, temperature of the gel."""

    radius_mm: float
    target_mm: float
    speed_mm_s: float
    hold_s: float = 0.0
    rest_s: float = 30.0
    place_mm: tuple[float, float] = (0.0, 0.0)
    shear: tuple[float, float] = (0.0, 0.0)
    temperature_C: float = 23.0
    day: int = 0


@dataclass(frozen=True, slots=True)
class Design:
    """Presses in order; samples of each: in air, at shares of the target while loading, of the hold, while
    unloading.
    """

    name: str
    touches: tuple[Touch, ...]
    air: bool
    load: tuple[float, ...]
    hold: tuple[float, ...]
    unload: tuple[float, ...]


def plain(rng: np.random.Generator) -> Design:
    """One punch, six presses, loading only."""
    touches = [Touch(2.5, target, 0.3) for target in (0.6, 0.6, 0.45, 0.45, 0.6, 0.45)]
    return Design("plain", tuple(touches), False, _even(0.08, 1.0, 12), (), ())


def medium(rng: np.random.Generator) -> Design:
    """Two punches, two speeds, four of each, with a short hold and the way back."""
    kinds = [(a, v) for a in (2.0, 3.0) for v in (0.1, 1.0)] * 4
    order = rng.permutation(len(kinds))
    touches = [Touch(a, 0.6 if a < 2.5 else 0.5, v, 3.0, rest_s=_rest(rng)) for a, v in (kinds[k] for k in order)]
    return Design("medium", tuple(touches), True, _even(0.06, 0.97, 9), (0.3, 1.0), (0.6, 0.25, -1.0))


def rich(rng: np.random.Generator) -> Design:
    """Three radii by three speeds by three repeats, four places twice, four long holds; varied waits, three
    days.
    """
    depth = {1.5: 0.45, 2.5: 0.6, 3.5: 0.5}
    kinds = [Touch(a, depth[a], v, 2.0) for a in depth for v in (0.05, 0.5, 5.0)] * 3
    places = [(6.0, 0.0), (-6.0, 0.0), (0.0, 6.0), (0.0, -6.0)]
    kinds += [Touch(2.5, 0.6, 0.5, 2.0, place_mm=place) for place in places] * 2
    kinds += [Touch(a, depth[a], 0.5, 30.0) for a in (1.5, 2.5, 2.5, 3.5)]
    days = np.sort(rng.integers(0, 3, len(kinds))) * 9
    order = [kinds[k] for k in rng.permutation(len(kinds))]
    touches = [
        replace(
            touch,
            rest_s=_rest(rng),
            shear=_pair(rng),
            day=int(day),
            temperature_C=round(float(rng.uniform(19, 27)), 1),
        )
        for touch, day in zip(order, days, strict=True)
    ]
    return Design("rich", tuple(touches), True, _even(0.05, 0.97, 9), (0.1, 0.45, 1.0), (0.75, 0.4, 0.1, -1.0))


DESIGNS = {"plain": plain, "medium": medium, "rich": rich}


@dataclass(frozen=True, slots=True)
class Motion:
    """Every press finely, (M, F) each: time on the one clock, depth, and how far it is; `sample_s` (M, T),
    `phase` (T,).

    `stage` 0 approach and loading, 1 hold, 2 unloading.
    """

    time_s: Floats
    depth_mm: Floats
    stage: Floats
    sample_s: Floats
    phase: tuple[str, ...]


def move(design: Design) -> Motion:
    """Straight ramps between air and target; the gel's own depth is what is driven."""
    rows = []
    clock, days = 0.0, 0
    for touch in design.touches:
        if touch.day != days:
            clock, days = 86400.0 * touch.day + 600.0, touch.day
        clock += touch.rest_s
        rows.append(_one(design, touch, clock))
        clock = float(rows[-1][0][-1])
    time, depth, stage, samples = (np.array([row[k] for row in rows]) for k in range(4))
    words = ["free"] * design.air + ["load"] * len(design.load) + ["hold"] * len(design.hold)
    return Motion(time, depth, stage, samples, (*words, *["unload"] * len(design.unload)))


def _one(design: Design, touch: Touch, start: float) -> tuple[Floats, Floats, Floats, Floats]:
    ramp = (touch.target_mm - AIR_MM) / touch.speed_mm_s
    down = np.linspace(0, ramp, 140)
    still = ramp + touch.hold_s * np.linspace(0, 1, 61)[1:] ** 2
    up = ramp + touch.hold_s + np.linspace(0, ramp, 100)[1:]
    depth = np.concatenate(
        [
            AIR_MM + down * touch.speed_mm_s,
            np.full(60, touch.target_mm),
            touch.target_mm - (up - ramp - touch.hold_s) * touch.speed_mm_s,
        ]
    )
    samples = [0.0] * design.air
    samples += [(share * touch.target_mm - AIR_MM) / touch.speed_mm_s for share in design.load]
    samples += [ramp + share * touch.hold_s for share in design.hold]
    for share in design.unload:
        depth_there = share * touch.target_mm if share > 0 else AIR_MM
        samples.append(ramp + touch.hold_s + (touch.target_mm - depth_there) / touch.speed_mm_s)
    stage = np.repeat([0.0, 1.0, 2.0], [140, 60, 99])
    return start + np.concatenate([down, still, up]), depth, stage, start + np.array(samples)


def _even(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.linspace(low, high, count))


def _rest(rng: np.random.Generator) -> float:
    return round(float(np.exp(rng.uniform(np.log(10), np.log(150)))), 1)


def _pair(rng: np.random.Generator) -> tuple[float, float]:
    x, y = rng.uniform(-0.12, 0.12, 2)
    return float(x), float(y)
