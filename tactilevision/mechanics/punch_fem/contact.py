"""A rigid flat punch with a rounded edge in unilateral contact with the gel's surface, point by point.

Signorini's condition by a penalty at the surface's quadrature points, Coulomb's law by a return map from an
elastic trial: with gap g, outward normal n and tangent t of the punch, nominal pressure q = k <-g> and tangential
traction T = T0 - (k/10) (dy . t), |T| <= mu q, dy being the motion relative to the punch since the last converged
step. mu = inf never slips. Per reference area, so all is total Lagrangian. Stiffer sticking makes slip fronts
chatter from point to point; its elastic slip is that of one step only, since the traction carries over.
Source: Wriggers, Computational Contact Mechanics (2006), 6.3 and 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.discretisation import Surface
from tactilevision.records.measured import Bools, Floats

TANGENTIAL = 0.1  # stiffness of sticking over the penalty
# the corner between stick and slip is rounded within this part of mu q, so that the tangent is continuous
ROUND = 0.1


@dataclass(frozen=True, slots=True)
class RoundedPunch:
    """Flat for r <= radius_mm - edge_radius_mm, then a quarter circle, then the cylinder's side at radius_mm.

    `friction` is Coulomb's coefficient: 0 frictionless, inf no slip.
    """

    radius_mm: float
    edge_radius_mm: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.edge_radius_mm < self.radius_mm < np.inf:
            raise InputError(
                "the edge radius lies between 0 and the punch's radius",
                where="RoundedPunch",
                value=(self.edge_radius_mm, self.radius_mm),
                remedy="A sharp edge is GluedFace, or the limit of small radii.",
            )
        if not self.friction >= 0:
            raise InputError("friction is 0 or more, inf for no slip", where="RoundedPunch", value=self.friction)


@dataclass(frozen=True, slots=True)
class ContactHistory:
    """At the last converged step: places relative to the punch (K, Q, 2), gaps and tangential tractions (K, Q).

    `trial_MPa` (K, Q) is the elastic trial of the iteration before, where there was one.
    """

    place_mm: Floats
    gap_mm: Floats
    shear_MPa: Floats
    trial_MPa: Floats | None = None


@dataclass(frozen=True, slots=True)
class ContactState:
    """`force` (K, 7) on the unknowns (internal minus external), `stiffness` (K, 7, 7); nominal `pressure_MPa` and
    `shear_MPa` (K, Q), shear positive along the tangent, and its elastic `trial_MPa`; `history` for the next step;
    penalty `energy` (N mm)."""

    force: Floats
    stiffness: Floats
    pressure_MPa: Floats
    shear_MPa: Floats
    trial_MPa: Floats
    history: ContactHistory
    energy: float


def signed_gap(punch: RoundedPunch, place: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the distance from the punch (negative inside), outward normal (..., 2) and curvature, at `place`
    (..., 2).

    `place` is relative to the punch: r, and z from its face, up.
    """
    rho = punch.edge_radius_mm
    across = place[..., 0] - (punch.radius_mm - rho)
    below = rho - place[..., 1]
    corner = (across > 0) & (below > 0)
    distance = np.where(corner, np.hypot(across, below), 1.0)
    face = ~corner & (below >= across)
    gap = np.where(corner, distance, np.where(face, below, across)) - rho
    normal_r = np.where(corner, across / distance, np.where(face, 0.0, 1.0))
    normal_z = np.where(corner, -below / distance, np.where(face, -1.0, 0.0))
    return gap, np.stack([normal_r, normal_z], axis=-1), np.where(corner, 1 / distance, 0.0)


def places(surface: Surface, u: Floats) -> Floats:
    """Return the surface points relative to the punch (K, Q, 2): r, and z from the face; `u` all unknowns."""
    local = u[surface.dofs]
    r = surface.r_mm + np.einsum("kqn,kn->kq", surface.shape, local[:, :3])
    z = np.einsum("kqn,kn->kq", surface.shape, local[:, 3:6]) - local[:, 6:7]
    return np.stack([r, z], axis=-1)


def untouched(surface: Surface, punch: RoundedPunch) -> ContactHistory:
    """Return the history before any load."""
    place = np.stack([surface.r_mm, np.zeros_like(surface.r_mm)], axis=-1)
    gap = signed_gap(punch, place)[0]
    return ContactHistory(place, gap, np.zeros_like(gap))


def touch(
    surface: Surface,
    punch: RoundedPunch,
    *,
    stiffness: float,
    u: Floats,
    history: ContactHistory,
    keep: bool = False,
) -> ContactState:
    """Return the contact forces and their exact tangent at `u` (U,) mm; `stiffness` is the penalty k in MPa/mm.

    With `keep`, points that touched at the last step still do, in tension if need be: where sliding material is
    extrapolated along its tangent it leaves the round edge, and Newton's method must not release it at once.
    """
    place = places(surface, u)
    gap, normal, curvature = signed_gap(punch, place)
    tangent = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
    active = (gap <= 0) | (keep & (history.gap_mm <= 0))
    k = np.where(active, stiffness, 0.0)
    pressure = -k * gap
    trial, along = _elastic_shear(history, place, active, k, (normal, tangent, curvature))
    shear, by_trial, by_pressure = slip(punch.friction, trial, pressure=pressure)
    if history.trial_MPa is not None:
        by_trial = turned_back(by_trial, shear, trial=trial, before=history.trial_MPa)

    # df/dy of f = q n + T t, with dq = -k n.dy, dn = c t (t.dy), dt = -c n (t.dy), d trial = along t.dy
    slope = _dyads(
        (-k, normal, normal),
        (pressure * curvature + along * by_trial, tangent, tangent),
        (-k * by_pressure, tangent, normal),
        (-shear * curvature, normal, tangent),
    )
    force, matrix = _gathered(surface, pressure[..., None] * normal + shear[..., None] * tangent, slope)
    return ContactState(
        force=force,
        stiffness=matrix,
        pressure_MPa=pressure,
        shear_MPa=shear,
        trial_MPa=trial,
        history=ContactHistory(place, gap, shear),
        energy=float((surface.weight_mm2 * pressure**2).sum() / (2 * stiffness)),
    )


def _elastic_shear(
    history: ContactHistory, place: Floats, active: Bools, k: Floats, frame: tuple[Floats, Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return the shear traction (K, Q) MPa of points that stick, and its derivative along the tangent, MPa/mm.

    `place` (K, Q, 2) mm, `active` and stiffness `k` (K, Q), `frame`: normal, tangent (K, Q, 2) and curvature.
    """
    normal, tangent, curvature = frame
    moved = place - history.place_mm
    trial = history.shear_MPa - TANGENTIAL * k * np.einsum("kqi,kqi->kq", moved, tangent)
    along = -TANGENTIAL * k * (1 - curvature * np.einsum("kqi,kqi->kq", moved, normal))
    return np.where(active, trial, 0.0), along


def _dyads(*terms: tuple[Floats, Floats, Floats]) -> Floats:
    """Return the sum (K, Q, 2, 2) of weight times left times right over terms of shapes (K, Q), (K, Q, 2), (K, Q,
    2).
    """
    total = np.zeros((*terms[0][0].shape, 2, 2))
    for weight, left, right in terms:
        total += weight[..., None, None] * left[..., :, None] * right[..., None, :]
    return total


def slip(friction: float, trial: Floats, *, pressure: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the tangential traction for an elastic `trial`, and its derivatives by trial and by pressure.

    T = L phi(|trial|/L) with L = mu q and phi(x) = min(x, 1), its corner replaced by a parabola.
    """
    if friction == 0:
        zero = np.zeros_like(trial)
        return zero, zero, zero
    if np.isinf(friction):
        return trial, np.ones_like(trial), np.zeros_like(trial)
    limit = friction * np.maximum(pressure, 0)
    pressed = limit > 0
    # Without pressure all slips, but at rest, with no trial either, it sticks until it has reason not to.
    x = np.where(pressed, np.abs(trial) / np.where(pressed, limit, 1.0), np.where(trial == 0, 0.0, 2.0))
    near = np.clip((x - (1 - ROUND)) / (2 * ROUND), 0, 1)
    phi = np.where(x < 1 + ROUND, x - ROUND * near**2, 1.0)
    sign = np.sign(trial)
    by_pressure = np.where(pressure > 0, sign * friction * (phi - x * (1 - near)), 0.0)
    return sign * limit * phi, 1 - near, by_pressure


def turned_back(by_trial: Floats, shear: Floats, *, trial: Floats, before: Floats) -> Floats:
    """Return the tangent's slopes (K, Q), a secant where a point slips the other way than in the iteration
    `before`.

    Such a point sticks: between the two its traction has gone from -mu q to mu q. The slope at either end is 0 and
    would send Newton's method back and forth for ever, most of all at first touch, where shortening the step
    changes nothing.
    """
    turned = (trial * before < 0) & (by_trial < 1)
    return np.where(turned, 2 * np.abs(shear) / np.where(turned, np.abs(trial - before), 1.0), by_trial)


def _gathered(surface: Surface, traction: Floats, slope: Floats) -> tuple[Floats, Floats]:
    """Return the force (K, 7) and stiffness (K, 7, 7) on an edge's unknowns, of traction (K, Q, 2) and slope (K,
    Q, 2, 2).
    """
    spread, area = _spread(surface), -surface.weight_mm2[..., None]
    flat = spread.reshape(len(spread), -1, 7)
    force = ((area * traction).reshape(len(flat), 1, -1) @ flat)[:, 0]
    return force, flat.transpose(0, 2, 1) @ (area[..., None] * slope @ spread).reshape(flat.shape)


def _spread(surface: Surface) -> Floats:
    """Return (K, Q, 2, 7), which takes the seven unknowns of an edge to the motion of its points relative to the
    punch.
    """
    spread = np.zeros((*surface.r_mm.shape, 2, 7))
    spread[..., 0, :3] = surface.shape
    spread[..., 1, 3:6] = surface.shape
    spread[..., 1, 6] = -1.0
    return spread
