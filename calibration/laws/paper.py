"""The published route, kept as a reproduction: one a/h for every gel, and nu read from the curvature.

    P/w = c (1 + beta w/h),    nu = 0.0813 ln beta + 0.4464,    E = c (1 - nu^2) / (2 a kappa(nu, 0.8))

Its logarithmic law rests on five points (R^2 = 0.98), and beta says more about friction, the edge and large
strain than about nu: a modulus from it reproduces the publication and is no measurement of nu. kappa is taken
at a/h = 0.8 whatever the gel. Source: eqs. 1-5 there; Zhang, Zheng, Mak, Med. Eng. Phys. 19 (1997) 57.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import NOMINAL_NU, betas, on_its_edge, radius_number, starting_modulus
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, State
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.records.measured import Floats

A_OVER_H = 0.8  # at which the publication takes kappa, whatever the gel
SLOPE = 0.0813  # of nu over ln beta, as published
OFFSET = 0.4464  # nu at beta = 1, as published


@dataclass(frozen=True, slots=True)
class Paper(Composable):
    """c and beta are fitted; nu and E follow from them."""

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "paper"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """c of the first radius (others scale with a), then beta for each radius."""
        stiffness = starting_modulus(data) * 15
        c = Parameter("c_N_per_mm", "N/mm", stiffness, (1e-5, 1e5), "P/w as the depth goes to 0", stiffness)
        return (c, *betas(data))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """P = c w (1 + beta w/h), c in proportion to the radius."""
        met = on_its_edge(state, NOMINAL_NU, sticking=state.sticking)
        stiffness = values[0] * met.factor * met.radius_mm / np.min(data.presses.radius_mm)
        beta = values[1:][radius_number(data)]
        depth = np.maximum(state.depth_mm, 0)
        force = stiffness * depth * (1 + beta * depth / state.thickness_mm)
        return replace(state, stiffness_N_per_mm=stiffness, force_N=force)


def poisson_from_beta(beta: float) -> float:
    """The log law; NaN for beta <= 0."""
    return SLOPE * float(np.log(beta)) + OFFSET if beta > 0 else float("nan")


def modulus_from(c_N_per_mm: float, beta: float, *, radius_mm: float) -> float:
    """E in MPa by the published route; NaN where its nu leaves [0, 0.5)."""
    nu = poisson_from_beta(beta)
    return modulus_at(c_N_per_mm, nu, radius_mm=radius_mm) if 0 <= nu < 0.5 else float("nan")


def modulus_at(c_N_per_mm: float, poisson_ratio: float, *, radius_mm: float) -> float:
    """E in MPa at a given nu, with kappa at a/h = 0.8."""
    kappa = float(fast_kappa(poisson_ratio, A_OVER_H))
    return c_N_per_mm * (1 - poisson_ratio**2) / (2 * radius_mm * kappa)
