"""What a fit absorbs of a change of the force, linear about it, beside what is known of its parameters.

d theta = (J^T V^-1 J + P)^-1 J^T V^-1 d f,    P the parameters' priors
"""

from __future__ import annotations

import numpy as np

from calibration.fit.least_squares import Fit, inverse_information
from calibration.noise.model import Whitener
from tactilevision.records import Bools, Floats


class Absorbed:
    """About a fit whose parameters `free` (p,) may move: `white` makes forces (N,) in N white, `rows` are J and
    priors, white (N + q, q), and `inverse` is (J^T V^-1 J + P)^-1.
    """

    def __init__(self, fitted: Fit, free: Bools) -> None:
        self._free = free
        self.white = Whitener(fitted.data, fitted.noise, fitted.about).apply
        known = np.array([0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters])
        self.known = known[free]
        self.rows = np.vstack([self.white(fitted.jacobian[:, free]), np.diag(self.known)])
        self.inverse = inverse_information(self.rows)

    def row_of(self, parameter: int) -> int:
        """Where a parameter that is free stands among the free ones."""
        return int(np.flatnonzero(np.flatnonzero(self._free) == parameter)[0])

    def padded(self, change_N: Floats) -> Floats:
        """A change (N,), N, white (N + q,), beside priors that ask for none."""
        return np.concatenate([self.white(change_N), np.zeros(self.known.size)])

    def moved(self, padded: Floats) -> Floats:
        """By how much the free parameters (q,), each in its unit, follow a padded change (N + q,)."""
        return np.asarray(self.inverse @ (self.rows.T @ padded))
