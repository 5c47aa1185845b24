"""Published route, kept as a reproduction: one a/h for every gel, and nu from the curvature.

    P/w = c (1 + beta w/h),    nu = 0.0813 ln beta + 0.4464,    E = c (1 - nu^2) / (2 a kappa(nu, 0.8))

The logarithmic law rests on five points (R^2 = 0.98), and beta depends more on friction, the edge and large strain
than on nu: E reproduces the publication but is no measurement of nu. kappa is taken at a/h = 0.8 for every gel.
Source: eqs. 1-5 there; Zhang, Zheng, Mak, Med. Eng. Phys. 19 (1997) 57.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import betas, on_its_edge, radius_number, starting_modulus
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, State
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records.constants import NU_NOMINAL
from tactilevision.records.measured import Floats

A_OVER_H = 0.8  # at which the publication takes kappa, whatever the gel
SLOPE = 0.0813  # of nu over ln beta, as published
OFFSET = 0.4464  # nu at beta = 1, as published


@dataclass(frozen=True, slots=True)
class Paper(Composable):
    """Law that fits c and beta; nu and E follow from them."""

    key = "paper"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return c of the smallest radius (others scale with a), then beta for each radius."""
        stiffness = starting_modulus(data) * 15
        c = Parameter("c_N_per_mm", "N/mm", stiffness, (1e-5, 100_000), "P/w as the depth goes to 0", stiffness)
        return (c, *betas(data))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with P = c w (1 + beta w/h), c in proportion to the radius."""
        met = on_its_edge(state, NU_NOMINAL, sticking=state.sticking)
        stiffness = values[0] * met.factor * met.radius_mm / np.min(data.presses.radius_mm)
        beta = values[1:][radius_number(data)]
        depth = np.maximum(state.depth_mm, 0)
        force = stiffness * depth * (1 + beta * depth / state.thickness_mm)
        return replace(state, stiffness_N_per_mm=stiffness, force_N=force)


def poisson_from_beta(beta: float) -> float:
    """Return nu by the logarithmic law; NaN for beta <= 0."""
    return SLOPE * float(np.log(beta)) + OFFSET if beta > 0 else float("nan")


def modulus_from(c_N_per_mm: float, beta: float, *, radius_mm: float) -> float:
    """Return E in MPa by the published route; NaN where its nu lies outside [0, 0.5)."""
    nu = poisson_from_beta(beta)
    return modulus_at(c_N_per_mm, nu, radius_mm=radius_mm) if 0 <= nu < 0.5 else float("nan")


def modulus_at(c_N_per_mm: float, poisson_ratio: float, *, radius_mm: float) -> float:
    """Return E in MPa at a given nu, with kappa at a/h = 0.8."""
    kappa = float(fast_kappa(poisson_ratio, A_OVER_H))
    return c_N_per_mm * (1 - poisson_ratio**2) / (2 * radius_mm * kappa)
