"""Incomplete recovery: the gel is softer by what it has not recovered of the presses before.

    P -> P - A q,    q' = (P - q)/tau during a press,    q -> q exp(-rest/tau) (P_max new / P_max old) between two

A is a share, tau the recovery time in s. q is a slow Maxwell branch at each place, filled by each press and
emptied by each rest; a different punch finds it in proportion to its own force. Strain also breaks the network
down within one press, however short, and rest rebuilds it: for a share b each press leaves all of its force, q ->
q + P_max, and the next finds it as its force grows, q P/P_max. Where a press is one point b is 1: P -> P (1 - A
s_p) with s_p = (1 + s_(p-1)) exp(-rest_p/tau). The force stays at or above 0.

Range: A up to .3, tau 10 to 2000 s; vanishes at A = 0. Confused with the Mullins effect; varied waits distinguish
it. Sources: Christensen, Theory of Viscoelasticity (1982), sec. 1.5 (a Maxwell element); Mewis, Wagner, Adv.
Colloid Interface Sci. 147 (2009) 214 (breakdown by strain, build-up at rest).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import exp

import numpy as np

from calibration.effects.mullins import KEPT, spots
from calibration.effects.viscoelasticity import relaxed
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats


class Recovery(EffectBase):
    """A share right after a press, and the time it takes to recover."""

    key = "recovery"
    title = "the gel has not recovered from the press before"
    stage = Stage.HISTORY
    analytic = False
    seen_in = ("wait", "order")
    confused_with = ("mullins",)
    separated_by = ("varied waits",)
    source = "Christensen, Theory of Viscoelasticity (1982); Mewis, Wagner (2009)"
    order = 170
    largest = 0.1
    check = ManualCheck("vary the waits from 3 s to 10 min", 25)
    parameters = (
        Parameter("share", "1", 0.0, (0, 0.3), "how much softer right after a press", 0.03),
        Parameter("time_s", "s", 40, (10, 2000), "time constant of healing", 40),
        Parameter("at_once", "1", 0.0, (0, 1), "0: a press fills it in its own time; 1: at once", 0.3),
    )

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters; for points b is fixed at 1."""
        share, time, at_once = self.parameters
        return share, time, at_once if data.is_curves else at_once.held_at(1)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show recovery; empty where they can."""
        rest = data.presses.rest_s[1:]
        known = rest[np.isfinite(rest) & (rest > 0)]
        if known.size < 3 or np.ptp(np.log(known)) < 0.2:
            return "needs waits between the presses that vary (rest_s)"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Return starts over the recovery times."""
        shares = (0.0, 1.0) if data.is_curves else (1.0,)
        return np.array([[0.03, tau, at_once] for tau in (15, 40, 120, 400) for at_once in shares])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state softened by what has not recovered."""
        elastic = state.force_N
        if data.is_curves:
            lost = values[0] * carried(elastic, values[1], data=data, at_once=values[2])
        else:
            lost = values[0] * elastic * memory(data, values[1])[data.press]
        return replace(state, force_N=np.where(elastic > 0, np.maximum(elastic - lost, 0), elastic))


def carried(force_N: Floats, time_s: float, *, data: Observations, at_once: float = 0.0) -> Floats:
    """Return q (N,), N, of a branch that each place keeps from press to press; `at_once` is b."""
    fresh = (1 - at_once) * relaxed(force_N, time_s, data=data)
    since_s, earlier = _course(data)
    highest = np.maximum(np.maximum.reduceat(force_N, data.first), TINY)
    largest = highest.tolist()
    ends = np.append(data.first[1:], data.size) - 1
    decay = np.exp(-since_s / time_s)
    whole, kept = (fresh[ends] + at_once * highest).tolist(), decay[ends].tolist()  # at the end of each press
    memory_N = [0.0] * data.count
    for k, (before, rest_s) in enumerate(earlier):
        if before >= 0:
            memory_N[k] = whole[before] * exp(-rest_s / time_s) * largest[k] / largest[before]
            whole[k] += memory_N[k] * kept[k]
    grown = 1 - at_once + at_once * force_N / highest[data.press]
    return np.asarray(fresh + np.array(memory_N)[data.press] * decay * grown)


@lru_cache(maxsize=KEPT)
def _course(data: Observations) -> tuple[Floats, list[tuple[int, float]]]:
    """Return the time of each sample since its press began (N,), s, and for each press the last one at its place
    (-1 for none) with the seconds of rest since.
    """
    since = data.time_s - data.time_s[data.first][data.press]
    last: dict[tuple[float, float], int] = {}
    earlier = []
    for k, spot in enumerate(spots(data)):
        before = last.get(spot, -1)
        earlier.append((before, _rest(data, before, k) if before >= 0 else 0.0))
        last[spot] = k
    return np.where(np.isfinite(since), np.maximum(since, 0), 0), earlier


def _rest(data: Observations, before: int, now: int) -> float:
    """Return the seconds from the end of one press to the beginning of another: as stated, or by the clock."""
    gap = float(data.time_s[data.first[now]] - data.time_s[data.first[before + 1] - 1])
    stated = float(data.presses.rest_s[now])
    rest = stated if not np.isfinite(gap) or (now == before + 1 and np.isfinite(stated)) else gap
    return max(rest, 0.0) if np.isfinite(rest) else np.inf


def memory(data: Observations, time_s: float) -> Floats:
    """Return s of each press (M,); after an unknown wait the gel has recovered."""
    rest = np.where(np.isfinite(data.presses.rest_s), data.presses.rest_s, np.inf)
    kept = np.exp(-np.maximum(rest, 0) / time_s)
    state = np.zeros(data.count)
    for k in range(1, data.count):
        state[k] = (1 + state[k - 1]) * kept[k]
    return state
