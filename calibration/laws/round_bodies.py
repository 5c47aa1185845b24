"""Sphere and cone on a bonded layer: exact for small strain, with a free term for large strain.

    P = E F(w; nu, body, h) (1 + beta w/h)

F solves the integral equation of mechanics/round_contact.py; for a thick gel it tends to Hertz' 4/3 E* sqrt(R)
w^1.5 and Sneddon's 2/pi E* tan(angle) w^2. No friction (`theory.py` gives what a gel that sticks adds), a
layer far wider than the contact, no force where w <= 0; beta has a prior about 0 of std BETA_STD. The thicknesses
of a wedge are interpolated between NODES of them. Range: contact radius up to ten thicknesses and, for a ball, .95
of its radius; InputError beyond. A tip that is rounded over more than a small part of the depth is a ball, not a
cone. Source: see round_contact.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import modulus_parameter, poisson_parameter
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, Prior, State, amplitude
from tactilevision.errors import InputError
from tactilevision.mechanics.round_contact import Ball, Cone, contact_curve
from tactilevision.records.constants import NU_NOMINAL
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

BETA_STD = 0.5  # finite elements of flat punches lie between 0 and 1.3
HERTZ = 1.5  # power of the depth in a ball's force on a thick gel
NODES = 4  # thicknesses of a wedge that are solved
MIN_SHARE = 1e-3  # of the largest depth, below which the force is taken as a power law
TABLE = 60  # depths of a force curve, spaced by a constant factor
GROWTH = 1.3  # factor between the largest depths of tables
NU_STEP = 0.01  # of nu between curves that a parabola joins
RADIUS_STEP = 0.02  # of the logarithm of a ball's radius over thickness, between curves that a parabola joins
STIFFNESS_STEP = 1e-4  # of the depth

Body = Ball | Cone


@dataclass(frozen=True, slots=True)
class RoundBody(Composable):
    """Law of balls of `radius_mm`, or of cones with `half_angle_deg` between axis and side."""

    shape: Literal["sphere", "cone"]

    analytic = False

    @property
    def key(self) -> str:
        """The shape."""
        return self.shape

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return E, nu, beta."""
        deep = int(np.argmax(data.depth_mm))
        indenter = data.indenters[int(data.presses.indenter[data.press[deep]])]
        body = _body(indenter, indenter.radius_mm)
        unit = _force_over_E(body, data.gel.thickness_mm, NU_NOMINAL, data.depth_mm[[deep]])
        prior = Prior(0.0, BETA_STD, "round contacts have no printed value")
        return (
            modulus_parameter(float(data.normal_N[deep] / unit[0])),
            poisson_parameter(data.gel, free=False),
            replace(amplitude("beta", "1", 3, "what large strain adds", 1.0), prior=prior),
        )

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with force (N,) in N and its slope (N,) in N/mm, on its own radius and thickness."""
        force = self._force(state, values, data)
        step = STIFFNESS_STEP * np.maximum(state.depth_mm, 1e-3)
        more = self._force(replace(state, depth_mm=state.depth_mm + step), values, data)
        return replace(state, force_N=force, stiffness_N_per_mm=(more - force) / step)

    def _force(self, state: State, values: Floats, data: Observations) -> Floats:
        modulus, nu, beta = values
        force = np.zeros(data.size)
        number = data.presses.indenter[data.press]
        for k in np.unique(number):
            rows = (number == k) & (state.depth_mm > 0)
            if rows.any():
                body = _body(data.indenters[k], float(np.median(state.radius_mm[rows])))
                force[rows] = _on_layers(body, state.thickness_mm[rows], float(nu), state.depth_mm[rows])
        strain = np.maximum(state.depth_mm, 0) / state.thickness_mm
        return np.asarray(modulus * state.factor * force * (1 + beta * strain))


def _body(indenter: Indenter, radius_mm: float) -> Body:
    """Return the ball of this radius, or the cone. Raises InputError for a cone whose angle is not stated."""
    if indenter.shape == "sphere":
        return Ball(radius_mm)
    if indenter.half_angle_deg is None:
        raise InputError(
            "a cone needs its angle",
            where=f"[indenter.{indenter.name}]",
            remedy="State half_angle_deg, between its axis and its side.",
        )
    return Cone(indenter.half_angle_deg)


def _on_layers(body: Body, thickness_mm: Floats, nu: float, depth_mm: Floats) -> Floats:
    """Return F (n,) where each sample has its own thickness: linear between a few of them."""
    places = np.unique(thickness_mm)
    if len(places) > NODES:
        places = np.linspace(places[0], places[-1], NODES)
    table = np.stack([_force_over_E(body, float(h), nu, depth_mm) for h in places])
    weights = [np.interp(thickness_mm, places, one) for one in np.eye(len(places))]
    return np.asarray(np.sum(weights * table, axis=0))


def _force_over_E(body: Body, thickness_mm: float, nu: float, depth_mm: Floats) -> Floats:
    """Return F (n,) at depths > 0, interpolated in its logarithm between tables that all steps of a fit share.

    The tables stand at three nu and, for a ball, three radii over thickness; lengths count in thicknesses.
    """
    from scipy.interpolate import CubicSpline

    share = depth_mm / thickness_mm
    deepest = float(GROWTH ** np.ceil(np.log(float(share.max())) / np.log(GROWTH)))
    middle = min(max(round(nu / NU_STEP), 1) * NU_STEP, 0.5 - NU_STEP)
    columns = [(middle + k * NU_STEP, w) for k, w in enumerate(_parabola((nu - middle) / NU_STEP), start=-1)]
    rows = _bodies(body, thickness_mm)
    tables = [(w * v, _table(one, nearby, deepest)) for one, w in rows for nearby, v in columns]
    depth = tables[0][1][0]
    force = np.exp(sum(weight * np.log(table[1]) for weight, table in tables))
    inside = np.maximum(share, depth[0])
    curve = CubicSpline(np.log(depth), np.log(force / depth**HERTZ))
    value = np.exp(curve(np.log(inside))) * inside**HERTZ
    return np.asarray(thickness_mm**2 * value * (share / inside) ** (HERTZ if isinstance(body, Ball) else 2.0))


def _bodies(body: Body, thickness_mm: float) -> list[tuple[Body, float]]:
    """Return bodies on a layer of thickness 1 about this one, with weights: balls in steps of their radius."""
    if isinstance(body, Cone):
        return [(body, 1.0)]
    place = np.log(body.radius_mm / thickness_mm) / RADIUS_STEP
    middle = round(place)
    weights = _parabola(place - middle)
    return [(Ball(float(np.exp((middle + k) * RADIUS_STEP))), w) for k, w in enumerate(weights, start=-1)]


def _parabola(t: float) -> tuple[float, float, float]:
    """Return the weights of values at -1, 0 and 1 for the value at t."""
    return t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2


@lru_cache(maxsize=512)
def _table(body: Body, nu: float, deepest: float) -> tuple[Floats, Floats]:
    """Return depths and forces over E on a layer of thickness 1."""
    depth = np.geomspace(MIN_SHARE * deepest, deepest, TABLE)
    return depth, contact_curve(body, depth, thickness_mm=1.0, poisson_ratio=nu).force_over_E_mm2
