"""The gel remembers the presses before: it is softer by what the wait has not healed.

    P -> P (1 - A s_p),    s_p = (1 + s_(p-1)) exp(-rest_p/tau),    s of the first press 0

One slow Prony state, filled by each press and emptied by each wait. A gel can lose all its stiffness, not more:
the bracket is >= 0. Vanishes at A = 0.
Source: the state equation of a Maxwell element, e.g. Christensen, Theory of Viscoelasticity (1982), sec. 1.5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.data import Observations
from calibration.parameters import Parameter
from calibration.stages import EffectBase, Stage, State
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Recovery(EffectBase):
    """A share right after a press, and the time it takes to heal."""

    key = "recovery"
    title = "the gel has not recovered from the press before"
    stage = Stage.HISTORY
    seen_in = ("wait", "order")
    confused_with = ("mullins",)
    separated_by = ("varied waits",)
    source = "Christensen, Theory of Viscoelasticity (1982)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A and tau."""
        return (
            Parameter("share", "1", 0.0, (0.0, 0.3), "how much softer right after a press", 0.03),
            Parameter("time_s", "s", 40.0, (2.0, 2000.0), "time constant of healing", 40.0),
        )

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        rest = data.presses.rest_s[1:]
        known = rest[np.isfinite(rest) & (rest > 0)]
        if known.size < 3 or np.ptp(np.log(known)) < 0.2:
            return "needs waits between the presses that vary (rest_s)"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[0.03, tau] for tau in (8.0, 30.0, 100.0, 400.0)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Soften by what is left."""
        kept = np.maximum(1 - values[0] * memory(data, values[1]), 0)
        return replace(state, force_N=state.force_N * kept[data.press])


def memory(data: Observations, time_s: float) -> Floats:
    """s of each press (M,); an unknown wait heals all."""
    rest = np.where(np.isfinite(data.presses.rest_s), data.presses.rest_s, np.inf)
    left = np.exp(-np.maximum(rest, 0) / time_s)
    state = np.zeros(data.count)
    for k in range(1, data.count):
        state[k] = (1 + state[k - 1]) * left[k]
    return state
