"""Relaxation of the gel: a Prony series on the elastic force, by the hereditary integral."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

# The hereditary integral of linear viscoelasticity over many presses at once.
#
#     q(t) = P_e(t) - Int_0^t exp(-(t - s)/tau) dP_e(s),    so that P = P_e - sum_i g_i q_i
#
# P_e elastic force (instantaneous modulus), taken as straight between samples, so each step is exact:
# h_new = h exp(-dt/tau) + dP tau/dt (1 - exp(-dt/tau)). A press starts from 0 at its
# first sample.
# Source: Fung, Biomechanics (1993), sec. 7.6 (quasi-linear viscoelasticity); Taylor, Pister, Goudreau,
# Int. J. Numer. Meth. Eng. 2 (1970) 45 (the recursion).

KEPT = 8  # steps of time that are kept: a fit asks for them again and again


def relaxed(force_N: Floats, tau_s: float, *, data: Observations) -> Floats:
    """q (N,): the part of the elastic force that a Prony term of this time constant has let go of."""
    from scipy.linalg.lapack import dtbtrs

    decay, gain = _step(data, tau_s)
    innovation = np.diff(force_N, prepend=0.0) * gain
    innovation[data.first] = force_N[data.first]
    held, _ = dtbtrs(
        np.array([np.ones(data.size), np.append(-decay[1:], 0)]), innovation[:, None], uplo="L", diag="U"
    )
    return np.asarray(force_N - held[:, 0])


@lru_cache(maxsize=KEPT)
def _step(data: Observations, tau_s: float) -> tuple[Floats, Floats]:
    """What is left of the memory over each step, and of a force that rises straight over it; (N,) each.

    Nothing is left from one press to the next.
    """
    ratio = np.maximum(np.diff(data.time_s, prepend=data.time_s[0]), 0) / tau_s
    gain = np.where(ratio > 1e-8, -np.expm1(-ratio) / np.maximum(ratio, 1e-300), 1.0)
    decay = np.exp(-ratio)
    decay[data.first] = 0
    return decay, gain


# The gel relaxes: a Prony series on the elastic force.
#
#     P(t) = Int G(t - s) dP_e(s),    G(t) = 1 - sum_i g_i (1 - exp(-t/tau_i))
#
# P_e is the elastic force with the instantaneous modulus; each press begins from a gel at rest. Small g: the law's
# nonlinearity and the relaxation separate (quasi-linear). A punch drawn back faster than the gel follows leaves it
# and bears nothing: P >= 0 where P_e > 0, and what P_e is elsewhere (0 in air, tension where the gel clings)
# stays. Vanishes at g_i = 0.
# Source: Fung, Biomechanics (1993), sec. 7.6, eqs. 7.6:1-5.

TAU_S = (0.05, 100.0)  # s, from a few samples to a long hold: what a press can show
MAX_TERMS = 3  # of the Prony series: three decades of time
FASTER = 8.0  # times faster or slower, where another term begins


@dataclass(frozen=True, slots=True)
class Viscoelasticity(EffectBase):
    """`terms` Prony terms, each a fraction g and a time constant."""

    terms: int = 1

    key = "viscoelasticity"
    title = "the gel relaxes under load"
    stage = Stage.HISTORY
    seen_in = ("t", "log rate", "load/unload")
    confused_with = ("stiffening", "clock_offset", "tilt")
    separated_by = ("a hold of 25 s", "two decades of rate")
    source = "Fung, Biomechanics (1993), sec. 7.6"
    order = 160
    largest = 0.3
    check = ManualCheck("hold a press for 25 s", 3.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """g and tau of each term."""
        table: list[Parameter] = []
        for k in range(self.terms):
            tail = "" if self.terms == 1 else f"_{k + 1}"
            tau = 3.0 * 10.0 ** (k - (self.terms - 1) / 2)
            table += [
                Parameter(f"g{tail}", "1", 0.0, (0.0, 0.6), "fraction of the force that relaxes", 0.1),
                Parameter(f"tau{tail}_s", "s", tau, TAU_S, "time constant", tau),
            ]
        return tuple(table)

    def missing(self, data: Observations) -> str:
        """Needs several samples in time of at least one press."""
        if not data.is_curves or not np.isfinite(data.time_s).all():
            return "needs the force over time within a press (curves)"
        return ""

    def starts(self, data: Observations) -> Floats:
        """A tenth relaxes, at time constants spread over what the presses last."""
        defaults = [p.default for p in self.parameters]
        table = []
        for tau in (0.2, 1.0, 5.0, 25.0):
            row = list(defaults)
            row[0::2] = [0.1 / self.terms] * self.terms
            row[1::2] = [float(np.clip(tau * 5.0**k, *TAU_S)) for k in range(self.terms)]
            table.append(row)
        return np.array(table)

    def richer(self) -> Viscoelasticity | None:
        """One with another term, for gels relax over decades of time; None beyond the most."""
        return replace(self, terms=self.terms + 1) if self.terms < MAX_TERMS else None

    def richer_starts(self, values: Floats) -> Floats:
        """Where a fit with another term begins: from these values, a third of them slower or faster besides."""
        g, tau = values.reshape(-1, 2)[np.argmax(values[0::2])]
        new = [(g / 3, float(np.clip(tau * ratio, *TAU_S))) for ratio in (1 / FASTER, FASTER)]
        return np.array([[*values, *one] for one in new])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Take the relaxed part off the force of a punch that is in contact, down to nothing."""
        lost = sum(
            (g * relaxed(state.force_N, tau, data=data) for g, tau in values.reshape(-1, 2)), np.zeros(data.size)
        )
        elastic = state.force_N
        return replace(state, force_N=np.where(elastic > 0, np.maximum(elastic - lost, 0), elastic))
