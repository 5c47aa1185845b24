"""The inverse step's resultant as the law of a force/torque reading.

    P = R (E/E_0) s (h/h_0)^k (w/w_0)^m (1 + v(w) (u_0 + u_1 x + u_2 P_2(x)))

R is the normal force that the inverse step computed for the frame, with the modulus E_0 and the thickness h_0; w_0
is the depth of that frame and w the same with an error of depth or time. k = d ln R/d ln h comes from the inverse
step at other thicknesses, m = d ln R/d ln w from the press itself: for a rigid body dR/dw is the stiffness of its
present contact, so a deeper press and a zero of the height map act alike. s is the factor of the surroundings, v
the solver's relative std, which all frames of a depth share: u ~ N(0, 1) are errors constant, linear and
quadratic in the depth (x from -1 to 1, P_2 Legendre's). E has the calibration's own std as its prior, at the
calibration's nu. Range: a few tenths of h_0 and of w_0. Source: the definition of k and m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander

from calibration.inputs.observations import Observations
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, Prior, State, amplitude
from tactilevision.errors import InputError
from tactilevision.records.constants import NU_NOMINAL, TINY
from tactilevision.records.measured import Floats

LEAST_STD = 0.002  # relative std of E where the calibration states none or less: half its last usual digit


@dataclass(frozen=True, slots=True)
class Resultant(Composable):
    """Law of readings next to resultants, for contacts of any shape. Parameters: E, nu, which is held, and u."""

    key = "resultant"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return E with the calibration's std, and nu. Raises InputError where no E is stated."""
        modulus, nu = data.gel.youngs_modulus_MPa, data.gel.poisson_ratio or NU_NOMINAL
        if modulus is None:
            raise InputError(
                "resultants of pictures need the E that they were computed with",
                where="[sensor.gel]",
                remedy="State youngs_modulus_MPa and its std, as `force` writes them.",
            )
        std = max(data.gel.youngs_modulus_std_MPa or 0.0, LEAST_STD * modulus)
        prior = Prior(modulus, std, "the calibration")
        E = Parameter("youngs_modulus_MPa", "MPa", modulus, (modulus / 10, modulus * 10), "of the gel", std, prior)
        own = Prior(0.0, 1.0, "the inverse step's own std")
        errors = (
            replace(amplitude(f"step_{k}", "1", 8, "error of the inverse step", 1.0), prior=own) for k in range(3)
        )
        return E, Parameter("poisson_ratio", "1", nu, (nu, nu), "Poisson's ratio, as calibrated", 0.01), *errors

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the resultant as its force. Raises InputError for data without resultants."""
        found = data.resultants
        if found is None:
            raise InputError("these data hold no resultants of pictures", where=self.key)
        deeper = np.maximum(state.depth_mm, 0) / found.depth_mm
        thicker = (state.thickness_mm / data.gel.thickness_mm) ** found.of_thickness
        along = 2 * (found.depth_mm - found.depth_mm.min()) / max(float(np.ptp(found.depth_mm)), TINY) - 1
        table = legvander(along, len(values) - 3).T
        own = 1 + found.std * sum(value * one for value, one in zip(values[2:], table, strict=True))
        scale = values[0] / self.parameters(data)[0].default * state.factor * thicker * own
        force = found.force_N * scale * deeper**found.of_depth
        slope = found.of_depth * force / np.maximum(state.depth_mm, TINY)
        return replace(state, force_N=force, stiffness_N_per_mm=slope)
