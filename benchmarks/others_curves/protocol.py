"""Presses as somebody might make them: how many, of which radii, how deep, how fast, how often, when and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.others_curves.law import Array

FREE, LOAD, HOLD, UNLOAD = ("free", "load", "hold", "unload")
LEAD_MM = 0.02  # mm of air before the touch
SPOTS = 6  # places that are pressed again and again: what a gel remembers, it remembers there


@dataclass(frozen=True, slots=True)
class Press:
    """One press: its punch, path, place; `time_s` (n,) since the recording began, `depth_mm` (n,) in the gel.

    `corners` (2, k): times since the press began and depths between which it goes at one speed.
    """

    radius_mm: float
    time_s: Array
    depth_mm: Array
    phase: tuple[str, ...]
    corners: Array
    rest_s: float
    speed_mm_s: float
    hold_s: float
    place_mm: tuple[float, float]
    day: int
    temperature_C: float


@dataclass(frozen=True, slots=True)
class Protocol:
    """All presses, in the order in which they are made, on a gel of this thickness."""

    presses: tuple[Press, ...]
    thickness_mm: float


def draw(rng: np.random.Generator, *, rich: bool, count: int = 0, sparse: bool = False) -> Protocol:
    """A protocol; `rich` ones have what every effect needs, the others leave things out; `count` presses.

    A `sparse` one among the rich has two radii, one speed, one wait, two places and two days, each with its own
    temperature: effects can be seen, and some not be told apart.
    """
    thickness = float(rng.choice([2.0, 2.5, 3.0, 4.0]))
    radii = [round(share * thickness, 2) for share in ((0.5, 0.8, 1.1) if rich else (0.8,))]
    drawn = int(rng.choice([36, 51] if rich else [8, 12, 24]))
    count = count or drawn
    speeds = (0.05, 0.5, 5.0) if rich else tuple(rng.choice([(0.5,), (0.1, 1.0)][int(rng.integers(2))], 1))
    holds = (0.0, 1.0, 8.0) if rich else (float(rng.choice([0.0, 1.0])),)
    back = rich or bool(rng.random() < 0.7)
    if sparse:
        radii, speeds, holds = [radii[0], radii[-1]], (float(rng.choice(speeds)),), (float(rng.choice(holds)),)
    samples = int(rng.choice([20, 30, 45]))
    uneven = bool(rng.random() < 0.5)
    depths = thickness * np.array([0.08, 0.11, 0.14] if rich or rng.random() < 0.5 else [0.12])
    days, spots, each_day = _days_and_places(rng, count, rich=rich, sparse=sparse)
    clock, presses = 0.0, []
    for k in range(count):
        rest = float(np.exp(rng.uniform(np.log(3.0), np.log(300.0)))) if rich and not sparse else 20.0
        rest += 86400.0 * float(days[k] - days[k - 1]) if k else 0.0
        clock += rest
        speed, hold = float(rng.choice(speeds)), float(rng.choice(holds))
        place = tuple(spots[int(rng.integers(len(spots))) if rich else 0])
        path = _path(
            rng, float(rng.choice(depths)), speed=speed, hold=hold, back=back, samples=samples, uneven=uneven
        )
        warm = float(np.round(22 + rng.normal(0, 2.5), 1)) if rich and not sparse else float("nan")
        warm = float(each_day[days[k]]) if sparse else warm
        one = Press(
            float(rng.choice(radii)),
            clock + path[0],
            path[1],
            path[2],
            path[3],
            rest,
            speed,
            hold,
            place,
            int(days[k]),
            warm,
        )
        presses.append(one)
        clock = float(one.time_s[-1])
    return Protocol(tuple(presses), thickness)


def _days_and_places(
    rng: np.random.Generator, count: int, *, rich: bool, sparse: bool
) -> tuple[npt.NDArray[np.signedinteger], Array, Array]:
    """Days of presses (count,) since the first, places to choose from (k, 2), mm; each day's temperature (30,)."""
    days = np.sort(rng.integers(0, 30, count)) if rich else np.zeros(count, dtype=int)
    if sparse:
        days = np.where(np.arange(count) < count // 2, days[0], days[-1])
    days -= days[0]  # an age counts from the first press
    spots = np.round(rng.uniform(-6, 6, (2 if sparse else SPOTS, 2)), 2) if rich else np.zeros((1, 2))
    each_day = np.round(22 + rng.normal(0, 2.5, 30), 1) if sparse else np.zeros(30)
    return days, spots, each_day


def _path(
    rng: np.random.Generator,
    deepest_mm: float,
    *,
    speed: float,
    hold: float,
    back: bool,
    samples: int,
    uneven: bool,
) -> tuple[Array, Array, tuple[str, ...], Array]:
    down = (deepest_mm + LEAD_MM) / speed
    ends = np.cumsum([down, hold, down + LEAD_MM / speed if back else 0.0])
    counts = [samples // 2, samples // 4 if hold else 0, samples // 3 if back else 0]
    times, phases = [np.array([0.0])], [FREE]
    for begin, end, n, name in zip([0.0, *ends[:2]], ends, counts, (LOAD, HOLD, UNLOAD), strict=True):
        t = np.linspace(begin, end, n + 1)[1:]
        if uneven and n:
            t = np.sort(begin + (end - begin) * rng.uniform(0.001, 1.0, n))
        times.append(t)
        phases += [name] * n
    time = np.concatenate(times)
    corners = np.array([[0.0, *ends], [-LEAD_MM, deepest_mm, deepest_mm, -LEAD_MM if back else deepest_mm]])
    return time, np.interp(time, *corners), tuple(phases), corners
