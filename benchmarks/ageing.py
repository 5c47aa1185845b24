"""Passports of gels over 12 weeks: how often a change is reported, of gels that age by 8 % and of steady ones.

Each week a gel is pressed 12 times to 4 depths. The truth is written down here: a line P/w over w/h with each
press's own errors of depth and force, no code of `calibration`. Many more histories are drawn at the level of
results. A change is due at the first week at which the true one exceeds four standard deviations of the estimated
one; it counts if it was reported by then.

python -m benchmarks.ageing [histories] [seed]
"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.inputs.observations import Measured
from calibration.tasks.ageing import FIRST, Ageing, ageing
from calibration.tasks.calibrate import calibrate, own_stiffness
from tactilevision.recording.model import Recording
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter, Sensor

WEEKS, AGED, DUE = 12, 0.08, 4.0  # recordings; loss of stiffness; deviations at which a change is due
DEPTHS_MM, REPEATS = (0.2, 0.35, 0.5, 0.65), 3
THICKNESS_MM, RADIUS_MM, STIFFNESS, BEND = 3.0, 2.5, 3.6, 0.9  # c in N/mm; beta
DEPTH_STD_MM, FORCE_STD_N, GAIN = 0.002, 0.004, 0.005  # errors of each press
BEGIN = datetime.date(2026, 1, 5)
SHAPES = {
    "steady": lambda share: 0 * share,
    "in proportion to time": lambda share: share,
    "levelling off": lambda share: (1 - np.exp(-3 * share)) / (1 - np.exp(-3)),
}
Own = tuple[float, float, float]  # ln c, its std, its degrees of freedom


def week(rng: np.random.Generator, stiffness: float) -> Own:
    """Return what one recording of 12 presses says of ln c by itself."""
    points, indenters = [], {}
    for place, depth in enumerate(np.repeat(DEPTHS_MM, REPEATS).tolist()):
        true = depth + DEPTH_STD_MM * rng.standard_normal()
        force = stiffness * true * (1 + BEND * true / THICKNESS_MM) * (1 + GAIN * rng.standard_normal())
        name = f"A{depth:g}"
        indenters[name] = Indenter(name, radius_mm=RADIUS_MM, height_mm=depth, edge_radius_mm=0.0)
        read = float(force + FORCE_STD_N * rng.standard_normal())
        points.append(CertifiedPoint(f"{place}", name, depth, read))
    gel = Gel(THICKNESS_MM, shape="disc", radius_mm=15.0)
    sensor = Sensor("gelslim3", 427, 320, (0.0634, 0.0634), gel=gel, serial="07")
    recording = Recording(Path("week"), "week", sensor, indenters=indenters, depth_source="gauge")
    result = calibrate(Measured(recording, tuple(points)), test=False)
    c, dof = own_stiffness(result.fitted, RADIUS_MM)
    assert c.value is not None
    return float(np.log(c.value)), (c.std or 0.0) / c.value, dof


def drawn(rng: np.random.Generator, log_c: float, std: float, dof: float) -> Own:
    """Return what a recording would say whose true deviation of ln c is `std`."""
    return log_c + std * rng.standard_normal(), std * np.sqrt(rng.chisquare(dof) / dof), dof


def followed(series: Sequence[Own]) -> list[Ageing]:
    """Return the ageing as seen after each recording from the third on."""
    dates = [BEGIN + datetime.timedelta(7 * k) for k in range(len(series))]
    columns = list(zip(*series, strict=True))
    return [
        ageing(dates[:n], *(one[:n] for one in columns), tolerance=0.05) for n in range(FIRST, len(series) + 1)
    ]


def reported_when_due(seen: Sequence[Ageing], true: Floats) -> bool | None:
    """Return whether a change was reported when it became due; None where it never did. `true` (n,) of ln c."""
    for place, one in enumerate(seen):
        assert one.line is not None
        week = place + FIRST - 1
        if abs(true[week]) > DUE * one.line.std * 7 * week:
            return any(before.reported is not None for before in seen[: place + 1])
    return None


def tally(name: str, histories: Sequence[tuple[Sequence[Own], Floats]]) -> tuple[int, int, int]:
    """Print and return how many histories report a change, had one due, and reported it by then."""
    seen = [(followed(series), true) for series, true in histories]
    ever = sum(any(one.reported is not None for one in each) for each, _ in seen)
    due = [found for each, true in seen if (found := reported_when_due(each, true)) is not None]
    last = [each[-1].change for each, _ in seen]
    inside = sum(
        one.interval95[0] <= np.expm1(true[-1]) <= one.interval95[1]
        for one, (_, true) in zip(last, seen, strict=True)
        if one.interval95 is not None
    )
    share = f"{sum(due)} of {len(due)} when due" if due else "none was due"
    print(f"{name:<52} reported {ever} of {len(seen)}; {share}; 95 % intervals hold {inside}", flush=True)
    return ever, len(due), sum(due)


def main(arguments: Sequence[str]) -> None:
    """Print the tables."""
    histories, seed = [*map(int, arguments), *(60, 7)[len(arguments) :]]
    rng, weeks = np.random.default_rng(seed), np.arange(WEEKS) / (WEEKS - 1)
    many = 10 * histories
    for std, beyond in ((0.004, 0.0), (0.01, 0.0), (0.016, 0.0), (0.01, 0.01)):
        more = f", {100 * beyond:g} % beyond it" if beyond else ""
        for name, shape in SHAPES.items():
            aged = np.log1p(-AGED * shape(weeks))
            made = [
                ([drawn(rng, one + beyond * rng.standard_normal(), std, 9.0) for one in aged], aged)
                for _ in range(many)
            ]
            tally(f"results of {100 * std:g} % each{more}, {name}", made)
    for name, shape in list(SHAPES.items())[:2]:
        aged = np.log1p(-AGED * shape(weeks))
        made = [([week(rng, STIFFNESS * np.exp(one)) for one in aged], aged) for _ in range(histories)]
        tally(f"presses, {name}", made)


def quick() -> None:
    """One history."""
    main(["1"])


if __name__ == "__main__":
    main(sys.argv[1:])
