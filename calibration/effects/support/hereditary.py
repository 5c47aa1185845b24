"""The hereditary integral of linear viscoelasticity over many presses at once.

    q(t) = P_e(t) - Int_0^t exp(-(t - s)/tau) dP_e(s),    so that P = P_e - sum_i g_i q_i

P_e elastic force (instantaneous modulus), taken as straight between samples, so each step is exact:
h_new = h exp(-dt/tau) + dP tau/dt (1 - exp(-dt/tau)). A press starts from 0 at its
first sample.
Source: Fung, Biomechanics (1993), sec. 7.6 (quasi-linear viscoelasticity); Taylor, Pister, Goudreau,
Int. J. Numer. Meth. Eng. 2 (1970) 45 (the recursion).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Observations
from tactilevision.records import Floats

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
