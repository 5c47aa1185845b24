"""Sphere and cone on a bonded layer: exact for small strain, with a free term for large strain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import NOMINAL_NU, poisson_parameter
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, Prior, State
from tactilevision.errors import InputError
from tactilevision.mechanics.round_contact import Ball, Cone as ConeBody, contact_curve
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

# A ball or a cone on a bonded layer: exact for small strain, with a free rest for what large strain adds.
#
#     P = E F(w; nu, body, h) (1 + beta w/h)
#
# F from the integral equation of mechanics/round_contact.py (Hertz and Sneddon in the limit of a thick gel).
# Frictionless, small strain, a layer far wider than the contact; what a gel that sticks adds: round_sticking.py.
# beta is held near 0 by BETA_STD. Several thicknesses at once (a wedge) are interpolated between NODES of them. No
# force where w <= 0. Range: contact radius up to ten thicknesses and, for a ball, .95 of its radius; InputError
# beyond. Source: see round_contact.py.

BETA_STD = 0.5  # finite elements of flat punches lie between 0 and 1.3
NODES = 4  # thicknesses of a wedge that are solved; those between are interpolated
MIN_SHARE = 1e-3  # of the largest depth, below which the force counts as that of a power law
TABLE = 60  # depths of a force curve, spaced by a constant factor
NU_STEP = 0.01  # of nu between curves that a parabola joins
RADIUS_STEP = 0.02  # of the logarithm of a ball's radius over thickness, between curves that a parabola joins
STIFFNESS_STEP = 1e-4  # of the depth

Body = Ball | ConeBody


def round_parameters(data: Observations, body_of: Callable[[Indenter], Body]) -> tuple[Parameter, ...]:
    """E, nu, beta."""
    deep = int(np.argmax(data.depth_mm))
    unit = _force_over_E(
        body_of(_indenter_of(data, deep)), data.gel.thickness_mm, NOMINAL_NU, data.depth_mm[[deep]]
    )
    start = max(float(data.normal_N[deep] / unit[0]), 1e-4)
    modulus = Parameter("youngs_modulus_MPa", "MPa", start, (1e-5, 1e4), "Young's modulus of the gel", start)
    beta = Parameter(
        "beta",
        "1",
        0.0,
        (-3.0, 3.0),
        "what large strain adds",
        1.0,
        Prior(0.0, BETA_STD, "round contacts have no printed value"),
    )
    return (modulus, poisson_parameter(data.gel, free=False), beta)


def apply_round(state: State, values: Floats, *, data: Observations, body_of: Callable[[Indenter], Body]) -> State:
    """The state with force (N,) in N and slope (N,) in N/mm, on its own radius and thickness."""
    force = _force(state, values, data, body_of)
    step = STIFFNESS_STEP * np.maximum(state.depth_mm, 1e-3)
    more = _force(replace(state, depth_mm=state.depth_mm + step), values, data, body_of)
    return replace(state, force_N=force, stiffness_N_per_mm=(more - force) / step)


def _force(state: State, values: Floats, data: Observations, body_of: Callable[[Indenter], Body]) -> Floats:
    modulus, nu, beta = values
    force = np.zeros(data.size)
    number = data.presses.indenter[data.press]
    for k in np.unique(number):
        rows = (number == k) & (state.depth_mm > 0)
        if not rows.any():
            continue
        radius = float(np.median(state.radius_mm[rows]))
        body = body_of(replace(data.indenters[k], radius_mm=radius))
        force[rows] = _on_layers(body, state.thickness_mm[rows], float(nu), state.depth_mm[rows])
    strain = np.maximum(state.depth_mm, 0) / state.thickness_mm
    return np.asarray(modulus * state.factor * force * (1 + beta * strain))


def _on_layers(body: Body, thickness_mm: Floats, nu: float, depth_mm: Floats) -> Floats:
    """F (n,) where each sample has its own thickness: linear between a few of them."""
    places = np.unique(thickness_mm)
    if len(places) > NODES:
        places = np.linspace(places[0], places[-1], NODES)
    found = np.stack([_force_over_E(body, float(h), nu, depth_mm) for h in places])
    if len(places) == 1:
        return np.asarray(found[0])
    low = np.clip(np.searchsorted(places, thickness_mm) - 1, 0, len(places) - 2)
    part = (thickness_mm - places[low]) / (places[low + 1] - places[low])
    columns = np.arange(depth_mm.size)
    return np.asarray((1 - part) * found[low, columns] + part * found[low + 1, columns])


def _force_over_E(body: Body, thickness_mm: float, nu: float, depth_mm: Floats) -> Floats:
    """F (n,) at depths > 0, by logarithms of tables at three nu about this one, which all steps of a fit share.

    Of a ball also at three radii over thickness. Lengths count in thicknesses, so that all the balls and gels that
    a fit tries lie between few tables.
    """
    from scipy.interpolate import CubicSpline

    share = depth_mm / thickness_mm
    deepest = float(1.3 ** np.ceil(np.log(float(share.max())) / np.log(1.3)))
    middle = min(max(round(nu / NU_STEP), 1) * NU_STEP, 0.5 - NU_STEP)
    columns = [(middle + k * NU_STEP, w) for k, w in enumerate(_parabola((nu - middle) / NU_STEP), start=-1)]
    rows = _bodies(body, thickness_mm)
    tables = [(w * v, _table(one, nearby, deepest)) for one, w in rows for nearby, v in columns]
    depth = tables[0][1][0]
    force = np.exp(sum(weight * np.log(table[1]) for weight, table in tables))
    inside = np.maximum(share, depth[0])
    curve = CubicSpline(np.log(depth), np.log(force / depth**1.5))
    value = np.exp(curve(np.log(inside))) * inside**1.5
    return np.asarray(thickness_mm**2 * value * (share / inside) ** (1.5 if isinstance(body, Ball) else 2.0))


def _bodies(body: Body, thickness_mm: float) -> list[tuple[Body, float]]:
    """Bodies on a layer of thickness 1 about this one, and their weights: balls in steps of their radius."""
    if isinstance(body, ConeBody):
        return [(body, 1.0)]
    place = np.log(body.radius_mm / thickness_mm) / RADIUS_STEP
    middle = round(place)
    weights = _parabola(place - middle)
    return [(Ball(float(np.exp((middle + k) * RADIUS_STEP))), w) for k, w in enumerate(weights, start=-1)]


def _parabola(t: float) -> tuple[float, float, float]:
    """Weights of values at -1, 0 and 1, for the value at t."""
    return t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2


@lru_cache(maxsize=512)
def _table(body: Body, nu: float, deepest: float) -> tuple[Floats, Floats]:
    """Depths and forces over E of a layer of thickness 1."""
    depth = np.geomspace(MIN_SHARE * deepest, deepest, TABLE)
    return depth, contact_curve(body, depth, thickness_mm=1.0, poisson_ratio=nu).force_over_E_mm2


def _indenter_of(data: Observations, sample: int) -> Indenter:
    return data.indenters[int(data.presses.indenter[data.press[sample]])]


# A ball on a bonded layer: P = E F(w; nu, R, h) (1 + beta w/h), Hertz' 4/3 E* sqrt(R) w^1.5 where h is large.
#
# Equation, range and sources: round_body.py.


@dataclass(frozen=True, slots=True)
class Sphere(Composable):
    """The law for indenters of shape "sphere"; `radius_mm` is the ball's."""

    shape = "sphere"

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "sphere"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """E, nu, beta."""
        return round_parameters(data, _ball)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Force, and its slope over depth."""
        return apply_round(state, values, data=data, body_of=_ball)


def _ball(indenter: Indenter) -> Ball:
    return Ball(indenter.radius_mm)


# A cone on a bonded layer: P = E F(w; nu, angle, h) (1 + beta w/h), Sneddon's 2/pi E* tan(angle) w^2 for large h.
#
# `half_angle_deg` of the indenter is between its axis and its side; InputError where it is not stated. A tip that
# is rounded over more than a small part of the depth is a ball's, not a cone's. Equation, range and sources:
# round_body.py.


@dataclass(frozen=True, slots=True)
class Cone(Composable):
    """The law for indenters of shape "cone"."""

    shape = "cone"

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "cone"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """E, nu, beta."""
        return round_parameters(data, _cone)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Force, and its slope over depth."""
        return apply_round(state, values, data=data, body_of=_cone)


def _cone(indenter: Indenter) -> ConeBody:
    if indenter.half_angle_deg is None:
        raise InputError(
            "a cone needs its angle",
            where=f"[indenter.{indenter.name}]",
            remedy="State half_angle_deg, between its axis and its side.",
        )
    return ConeBody(indenter.half_angle_deg)
