"""Viscoelastic relaxation: a Prony series on the elastic force, by the hereditary integral.

    P(t) = Int G(t - s) dP_e(s),    G(t) = 1 - sum_i g_i (1 - exp(-t/tau_i))

P_e is the elastic force with the instantaneous modulus, g_i the fraction of the force that relaxes with the time
constant tau_i in s; each press begins with a relaxed gel. For small g the law's nonlinearity and the relaxation
separate (quasi-linear viscoelasticity). A punch retracted faster than the gel follows loses contact: P >= 0 where
P_e > 0; elsewhere (air, tension by adhesion) P_e is kept. Range: g up to .6, tau .05 to 100 s, up to three terms;
vanishes at g_i = 0. Confused with drainage, stiffening, a clock offset and a tilt; a hold of 25 s, rates
over two decades and several radii distinguish it. Source: Fung, Biomechanics (1993), sec. 7.6, eqs. 7.6:1-5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np

from calibration.inputs.conditions import missing_course
from calibration.inputs.observations import Observations
from calibration.model.dual import Dual, moves, value_of
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.constants import NONZERO
from tactilevision.records.measured import Floats

TAU_S = (0.05, 100)  # s, from a few samples to a long hold: what a press can show
TAUS = (0.2, 1.0, 5, 25)  # s, where fits begin, one to each factor of five
MAX_TERMS = 3  # of the Prony series: three decades of time
RATIO = 8  # of time constants, where another term begins
ROOT = 6e-6  # cube root of the machine epsilon: relative step of the recursion over tau
KEPT = 16  # cached steps of time: a fit asks for them again and again


@dataclass(frozen=True, slots=True)
class Viscoelasticity(EffectBase):
    """`terms` Prony terms, each a fraction g and a time constant."""

    terms: int = 1

    key = "viscoelasticity"
    title = "the gel relaxes under load"
    stage = Stage.HISTORY
    seen_in = ("t", "log rate", "load/unload")
    confused_with = ("poroelasticity", "stiffening", "clock_offset", "tilt")
    separated_by = ("a hold of 25 s", "two decades of rate", "holds with several radii")
    source = "Fung, Biomechanics (1993), sec. 7.6"
    same_over = ("a", "log rate", "order")
    order = 160
    largest = 0.3
    check = ManualCheck("hold a press for 25 s", 3)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """g and tau of each term."""
        table: list[Parameter] = []
        for k in range(self.terms):
            tail = "" if self.terms == 1 else f"_{k + 1}"
            tau = 3 * 10 ** (k - (self.terms - 1) / 2)
            table += [
                Parameter(f"g{tail}", "1", 0.0, (0, 0.6), "fraction of the force that relaxes", 0.1),
                Parameter(f"tau{tail}_s", "s", tau, TAU_S, "time constant", tau),
            ]
        return tuple(table)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show relaxation; empty where they can."""
        return missing_course(data)

    def starts(self, data: Observations) -> Floats:
        """Return starts in which a tenth relaxes, with time constants over the decades."""
        shorter, terms = np.array(TAUS)[:, None], range(self.terms)
        table = np.full((len(TAUS), 2 * self.terms), 0.1 / self.terms)
        table[:, 1::2] = np.clip(shorter * [5**k for k in terms], *TAU_S)
        return table

    def richer(self) -> Viscoelasticity | None:
        """Return the effect with another term; None beyond MAX_TERMS."""
        return replace(self, terms=self.terms + 1) if self.terms < MAX_TERMS else None

    def richer_starts(self, values: Floats) -> Floats:
        """Return these values with another term of a third of the largest, slower or faster."""
        g, tau = values.reshape(-1, 2)[np.argmax(values[0::2])]
        return np.array([[*values, g / 3, float(np.clip(tau * ratio, *TAU_S))] for ratio in (1 / RATIO, RATIO)])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the relaxed part subtracted, down to 0, from a force in contact."""
        lost = sum(
            (g * relaxed(state.force_N, tau, data=data) for g, tau in zip(values[::2], values[1::2], strict=True)),
            np.zeros(data.size),
        )
        elastic = state.force_N
        return replace(state, force_N=np.where(elastic > 0, np.maximum(elastic - lost, 0), elastic))


def relaxed(force_N: Any, tau_s: Any, *, data: Observations) -> Floats:
    """Return the part q (N,), N, of the elastic force that a Prony term of this time constant has relaxed.

        q(t) = P_e(t) - Int_0^t exp(-(t - s)/tau) dP_e(s)

    P_e is linear between samples, so each step is exact, h_new = h exp(-dt/tau) + dP tau/dt (1 - exp(-dt/tau)),
    and each press starts at 0. Between a sample in air and one in contact it is linear from the touch on. Source:
    Taylor, Pister, Goudreau, Int. J. Numer. Meth. Eng. 2 (1970) 45 (the recursion).
    """
    from scipy.linalg.lapack import dtbtrs

    force, tau = value_of(force_N), float(value_of(tau_s))
    decay, gain = _step(data, tau)
    columns = np.column_stack([force, force_N.whole.T]) if moves(force_N) else force[:, None]
    innovation = np.diff(columns, axis=0, prepend=0.0) * gain[:, None]
    innovation[data.first] = columns[data.first]
    held, _ = dtbtrs(np.array([np.ones(data.size), np.append(-decay[1:], 0)]), innovation, uplo="L", diag="U")
    lost: Floats = force - held[:, 0]
    if not moves(force_N, tau_s):
        return lost
    slopes: Any = force_N.whole - held[:, 1:].T if moves(force_N) else 0.0
    if moves(tau_s):  # two more recursions cost less than the derivative's own
        step = ROOT * tau
        ends = [relaxed(force, tau + side * step, data=data) for side in (-1, 1)]
        slopes = slopes + (ends[1] - ends[0]) / (2 * step) * tau_s.slopes
    return cast(Floats, Dual(lost, slopes))


@lru_cache(maxsize=KEPT)
def _step(data: Observations, tau_s: float) -> tuple[Floats, Floats]:
    """Return exp(-dt/tau) and tau/dt (1 - exp(-dt/tau)), (N,) each; the decay is 0 from press to press.

    Where the press touches or leaves between two samples, dt of the second is the time in contact.
    """
    ratio = np.maximum(np.diff(data.time_s, prepend=data.time_s[0]), 0) / tau_s
    now, before = data.depth_mm, np.roll(data.depth_mm, 1)
    deeper = np.maximum(now, before)
    share = np.where(now * before < 0, deeper / np.maximum(np.abs(now - before), NONZERO), 1.0)
    decay, loaded = np.exp(-ratio), share * ratio
    gain = np.where(loaded > 1e-8, -np.expm1(-loaded) / np.maximum(loaded, NONZERO), 1.0)
    gain *= np.where(now < 0, np.exp(loaded - ratio), 1.0)  # it fades in air
    decay[data.first] = 0
    return decay, gain
