"""Depth of the punch when its bevel first touches the gel.

A bevel whose nearest edge is a height H behind the punch's face, at the distance d from its axis, meets the gel
when

    w + rise(d, w) = H,     rise = rho(d, w) w at the seen radius,     so  w = H/(1 + rho).

For d beyond about 1.3 a the gel has risen, and the touch is early: w < H, by 9 % at d = 2a, nu = .48, a/h = .83;
close to the punch the gel sinks in and the touch is late. The nearest edge touches first as long as the bevel
falls away faster than the gel does beyond it; the profile's steepest rise is .15 w per mm, a bevel of 10 degrees
.18. Valid for d > a and H below a quarter of the thickness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.mechanics.profile import FULL_FRICTION, LINEAR, ProfileModel, PunchCase, seen_profile
from tactilevision.records.rig import Indenter

STEPS = 50  # of the fixed-point iteration
TOLERANCE = 1e-10  # change of the depth over the height at which the iteration ends
PLACE_STEP_MM = 0.05  # mm, of the derivative by the bevel's distance
FRICTIONS = (0.0, FULL_FRICTION, float("inf"))  # Coulomb's coefficients that span the effect of friction


@dataclass(frozen=True, slots=True)
class Touch:
    """Depth of the punch at first touch, mm, and the gel's rise at the bevel over that depth, each with its
    std.
    """

    depth_mm: float
    depth_std_mm: float
    rise_over_depth: float
    rise_over_depth_std: float


@lru_cache(maxsize=256)  # presses of one indenter ask for the same
def touch_depth(
    indenter: Indenter,
    *,
    thickness_mm: float,
    poisson_ratio: float,
    poisson_ratio_std: float,
    distance_std_mm: float = 0.1,
    model: ProfileModel = LINEAR,
) -> Touch:
    """Solve w (1 + rho) = H for an indenter whose height and bevel distance are known; friction unknown.

    The standard deviations of nu, distance, height and the profile's source, and half the span over friction (if
    the source depends on it), are propagated to the depth. Raises InputError if the indenter has no height or
    bevel distance, or the bevel would be under the face.
    """
    height, distance = _placed(indenter, thickness_mm)

    def rise(nu: float, place_mm: float, friction: float) -> tuple[float, float]:
        return _solve(height, lambda w: _rho(indenter.radius_mm, place_mm, thickness_mm, nu, (w, friction), model))

    middle = FULL_FRICTION if model.frictional else 0.0
    depth, rho = rise(poisson_ratio, distance, middle)
    step = 0.002 * (1 if poisson_ratio < 0.49 else -1)
    by_nu = (rise(poisson_ratio + step, distance, middle)[1] - rho) / step
    by_place = (rise(poisson_ratio, distance + PLACE_STEP_MM, middle)[1] - rho) / PLACE_STEP_MM
    spread = [rise(poisson_ratio, distance, mu)[1] for mu in FRICTIONS] if model.frictional else [rho]
    parts = (
        by_nu * poisson_ratio_std,
        by_place * distance_std_mm,
        model.relative_error * rho,
        (max(spread) - min(spread)) / 2,
    )
    rho_std = float(np.linalg.norm(parts))
    depth_std = float(np.hypot(indenter.height_std_mm, depth * rho_std)) / (1 + rho)
    return Touch(depth, depth_std, rho, rho_std)


def _placed(indenter: Indenter, thickness_mm: float) -> tuple[float, float]:
    """Check and return the height of the face over the bevel and the bevel's distance, mm."""
    height, distance = indenter.height_mm, indenter.bevel_distance_mm
    if height is None or distance is None:
        raise InputError(
            "the touch needs height_mm and bevel_distance_mm",
            where=f"indenter.{indenter.name}",
            remedy="Add them to recording.toml.",
        )
    if not (0 < height < thickness_mm and distance > indenter.radius_mm):
        raise InputError(
            "the height lies between 0 and the gel's thickness, and the bevel outside the face",
            where=f"indenter.{indenter.name}",
            value=(height, distance),
        )
    return height, distance


def _rho(
    radius_mm: float,
    place_mm: float,
    thickness_mm: float,
    nu: float,
    state: tuple[float, float],
    model: ProfileModel,
) -> float:
    depth, friction = state
    case = PunchCase(nu, radius_mm / thickness_mm, depth / thickness_mm, friction)
    return float(seen_profile(np.array([place_mm / radius_mm]), case, source=model.source)[0])


def _solve(height: float, rho: Callable[[float], float]) -> tuple[float, float]:
    """Return the fixed point of w = H/(1 + rho(w)), which converges fast since rho hardly depends on w."""
    depth = height
    for _ in range(STEPS):
        ratio = rho(depth)
        previous, depth = depth, height / (1 + ratio)
        if abs(depth - previous) < TOLERANCE * height:
            return depth, ratio
    raise ConvergenceError(
        f"the touch depth did not settle: {previous:.6g} and {depth:.6g} mm after {STEPS} steps"
    )
