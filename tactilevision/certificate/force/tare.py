"""The zero of the force: what the F/T sensor reads on the free gel before and after a press, linear in between.

    zero(t) = mean before + (mean after - mean before) (t - t_before)/(t_after - t_before)

Times on the F/T sensor's clock, forces in N.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.records import Bools, Floats, ForceSeries, Pair

_MIN_COUNT = 5  # readings of the free gel for a zero; tests.certificate.test_force_readings
_LONGEST_S = 2.0  # s nearest to the press: the zero wanders over longer times


@dataclass(frozen=True, slots=True)
class Tare:
    """The zero before and after a press: force (3,) at its mean time; None where there were no free readings.

    `std_N` (3,) of the zero during the press.
    """

    before_N: Floats | None
    before_s: float
    after_N: Floats | None
    after_s: float
    std_N: Floats

    def at(self, time_s: Floats) -> Floats:
        """Zero (T, 3) at times (T,)."""
        if self.before_N is None and self.after_N is None:
            return np.zeros((len(time_s), 3))
        first = self.before_N if self.before_N is not None else self.after_N
        last = self.after_N if self.after_N is not None else self.before_N
        assert first is not None
        assert last is not None
        length = self.after_s - self.before_s
        part = np.clip((time_s - self.before_s) / length, 0, 1) if length > 0 else np.zeros(len(time_s))
        return np.asarray(first + part[:, None] * (last - first), dtype=np.float64)

    @property
    def known(self) -> bool:
        return self.before_N is not None or self.after_N is not None

    @property
    def drift_N(self) -> Floats | None:
        """After less before (3,)."""
        return None if self.before_N is None or self.after_N is None else self.after_N - self.before_N


def find_tare(forces: ForceSeries, contact_s: Pair, *, free_s: Pair) -> Tare:
    """Zero of a press that is in contact during `contact_s`, the gel being free in the rest of `free_s`."""
    time = forces.time_s
    before = (time < contact_s[0]) & (time >= max(free_s[0], contact_s[0] - _LONGEST_S))
    after = (time > contact_s[1]) & (time <= min(free_s[1], contact_s[1] + _LONGEST_S))
    first, first_s, first_std = _mean(forces, before)
    last, last_s, last_std = _mean(forces, after)
    known = [std for std in (first_std, last_std) if std is not None]
    if not known:
        return Tare(None, np.nan, None, np.nan, np.full(3, np.nan))
    std = np.sqrt(np.mean(np.square(known), axis=0) / len(known))
    if first is not None and last is not None:  # half of what it has moved is not known to be linear in time
        std = np.hypot(std, np.abs(last - first) / np.sqrt(12))
    return Tare(first, first_s, last, last_s, np.asarray(std))


def subtract_tares(forces: ForceSeries, tares: Iterable[Tare]) -> ForceSeries:
    """The readings less the zeros that these tares found, linear in time between them; as they are without any.

    A zero that drifts by a few millinewtons while a press lasts makes its unloading look milliseconds late.
    """
    knots = [
        (time, zero)
        for tare in tares
        for time, zero in ((tare.before_s, tare.before_N), (tare.after_s, tare.after_N))
        if zero is not None
    ]
    if not knots:
        return forces
    knots.sort(key=lambda knot: knot[0])
    times, zeros = np.array([time for time, _ in knots]), np.array([zero for _, zero in knots])
    level = np.stack([np.interp(forces.time_s, times, axis) for axis in zeros.T], axis=1)
    return replace(forces, force_N=forces.force_N - level)


def _mean(forces: ForceSeries, where: Bools) -> tuple[Floats | None, float, Floats | None]:
    readings = forces.force_N[where]
    readings = readings[np.isfinite(readings).all(axis=1)]
    if len(readings) >= _MIN_COUNT:  # the end of a jolt is no part of the zero
        apart = np.abs(readings - np.median(readings, axis=0))
        readings = readings[(apart <= 6 * np.asarray(forces.std_N) + 3 * np.median(apart, axis=0)).all(axis=1)]
    if len(readings) < _MIN_COUNT:
        return None, float("nan"), None
    spread = np.maximum(readings.std(axis=0), 0.3 * np.asarray(forces.std_N))
    return readings.mean(axis=0), float(forces.time_s[where].mean()), spread / np.sqrt(len(readings))
