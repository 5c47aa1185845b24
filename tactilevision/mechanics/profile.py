"""The gel's surface around a flat punch in linear theory: exact up to quadrature.

With phi and Phi(xi) = Int_0^1 phi cos(xi x) dx of punch_equation.py, lengths in punch radii, alpha = a/h, r > 1:

    u_z/w = (2/pi) [Int_0^1 phi(x)/sqrt(r^2 - x^2) dx - alpha Int (1 - K(u)) Phi(alpha u) J0(alpha u r) du],
    u_r/w = -(2/pi) [L_inf kappa/r - alpha Int (L_inf - L(u)) Phi(alpha u) J1(alpha u r) du],
    L(u) = [2k (1 - 2 nu)(cosh 2u - 1) - 4u^2] / [2 (1 - nu) D(u)],   L_inf = (1 - 2 nu)/(2 (1 - nu)).

u_z is into the gel: the *rise* around the punch is -u_z. Frictionless, sharp edge, small strain, a wide layer; the
rise at r = 2a is .097 w at nu = .48, a/h = .83, and .011 w more for each .01 of nu. Depth enters only as a factor;
at w/h = .13 finite deformation and friction change the rise by some .005 w, which is .005 of nu: finite element
tables replace this source there (see ProfileSource).

Source: Hayes et al., J. Biomech. 5 (1972) 541, eqs. 13-20; layer.py for L; Sneddon, Mixed Boundary Value Problems
(1966), section 3.4, for the integrals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.mechanics.punch_equation import (
    A_OVER_H_RANGE,
    KERNEL_END,
    PunchSolution,
    gauss,
    layer_defect,
    solve_punch,
)
from tactilevision.records.constants import NU_MAX
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FULL_FRICTION = 0.3  # Coulomb's coefficient of full friction
SATURATION = 0.4  # how much the effect of friction saturates below that
LIKELY_SHARE = 0.7  # prior mean of the share of friction's full effect: silicone sticks to most things
SHARE_STD = 0.3  # prior standard deviation of that share
REACH = 20  # thicknesses: the spline ends at r = a + 20 h, where the rise is below 1e-6 w
SHAPE_PLACES = (0.1, 0.25, 0.5, 0.9, 1.6)  # (r - a)/h at which a model states the error of its shape
SPLINE_NODES = 100  # of the profile's spline


@dataclass(frozen=True, slots=True)
class PunchCase:
    """Dimensionless parameters of the surface around a flat punch.

    `w_over_h` is the depth over the thickness, or several of them, for which radii (depths, ...) and results have
    one more, first axis; `friction` is Coulomb's coefficient; infinity: the gel sticks.
    """

    poisson_ratio: float
    a_over_h: float
    w_over_h: float | tuple[float, ...] = 0.0
    friction: float = 0.0


# The surface around the punch: `linear_profile`, finite element tables, or another. Takes material radii r/a >= 1
# (any shape) and a case; returns (rise, u_r) of the same shape, both per unit of depth: rise positive out of the
# gel, u_r away from the axis. Law and edge radius belong to the source. It is hashable: its results are cached.
ProfileSource = Callable[[Floats, PunchCase], tuple[Floats, Floats]]


def exact_profile(r_over_a: npt.ArrayLike, poisson_ratio: float, *, a_over_h: float) -> tuple[Floats, Floats]:
    """Return (rise, u_r) per unit of depth at r/a >= 1 (any shape), by quadrature.

    Some ten microseconds a point.
    """
    from scipy.special import j0, j1

    r = np.asarray(r_over_a, dtype=float)
    if not (r >= 1).all():
        raise InputError(
            "the profile around the punch begins at r = a", where="exact_profile", value=float(r.min())
        )
    punch = solve_punch(poisson_ratio, a_over_h)
    u, weights = gauss(_kernel_nodes((float(r.max(initial=1.0)) + 1) * a_over_h), KERNEL_END)
    source = a_over_h * weights * punch.transform(a_over_h * u)
    waves = np.multiply.outer(r, a_over_h * u)
    sink = _half_space(punch, r) - j0(waves) @ (source * layer_defect(u, poisson_ratio))
    coupling_inf = (1 - 2 * poisson_ratio) / (2 * (1 - poisson_ratio))
    outward = j1(waves) @ (source * _coupling_defect(u, poisson_ratio)) - coupling_inf * punch.kappa / r
    return np.asarray(-2 / np.pi * sink), np.asarray(2 / np.pi * outward)


def linear_profile(r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
    """Return exact_profile from a spline in r (error below 3e-6 of the depth for a/h above .2, 1e-4 below).

    Rise and u_r over w, dimensionless, of the shape of `r_over_a`; beyond r = a + 20 h both are 0. A ProfileSource
    that does not depend on depth and friction.
    """
    s = np.sqrt((np.asarray(r_over_a, dtype=float) - 1) * case.a_over_h)
    if not (s >= 0).all():
        raise InputError("the profile around the punch begins at r = a", where="linear_profile")
    values = _profile_spline(case.poisson_ratio, case.a_over_h)(np.minimum(s, np.sqrt(REACH)))
    values = np.where((s < np.sqrt(REACH))[..., None], values, 0.0)
    return values[..., 0], values[..., 1]


@dataclass(frozen=True, slots=True)
class ProfileModel:
    """Source of the profile, its errors and its range.

    `relative_error` is the standard deviation of the rise over the rise, common to all presses; `shape_error`
    pairs ((r - a)/h, std of the rise over the depth there): error of its shape by edge, law and solver;
    `single_depth_std` is that of nu from presses of one depth, where no other depth shows the profile's error;
    `frictional`: whether the source depends on friction; `deepest` is in thicknesses.
    """

    source: ProfileSource
    name: str
    relative_error: float
    frictional: bool = False
    poisson_range: tuple[float, float] = (0.0, NU_MAX)
    a_over_h_range: tuple[float, float] = A_OVER_H_RANGE
    deepest: float = 0.3
    shape_error: tuple[tuple[float, float], ...] = ()
    single_depth_std: float = 0.0


LINEAR = ProfileModel(
    linear_profile,
    "linear layer theory, frictionless",
    relative_error=0.06,
    shape_error=tuple(zip(SHAPE_PLACES, (0.03, 0.025, 0.015, 0.006, 0.004), strict=True)),
    single_depth_std=0.01,
)


def friction_of_share(share: float) -> float:
    """Return the least coefficient of friction mu that has this share, in [0, 1], of the full effect.

    With x = mu/.3 the share is x (1 + s - s x) up to x = 1, s = SATURATION, which agrees with finite elements at
    mu = .15 (.5 to .7); beyond, more friction changes the profile by less than a few parts in ten thousand of the
    depth.
    """
    most = 1 + SATURATION
    return FULL_FRICTION * (most - float(np.sqrt(most**2 - 4 * SATURATION * min(share, 1.0)))) / (2 * SATURATION)


def seen_profile(r_over_a: Floats, case: PunchCase, *, source: ProfileSource = linear_profile) -> Floats:
    """Return the rise per unit of depth at the *deformed* radius, (r + u_r)/a (any shape); -1 under the face.

    The map r -> r + u_r is inverted on a fine grid of material radii; its slope is near 1 at depths below a fifth
    of the thickness.
    """
    from scipy.interpolate import PchipInterpolator

    depths = np.reshape(case.w_over_h, (-1, 1)) / case.a_over_h
    farthest = np.maximum(float(r_over_a.max(initial=0.0)) + 2 * depths, 1 + 1 / case.a_over_h)
    material, found = 1 + (farthest - 1) * np.linspace(0, 1, 400) ** 2, []
    rise, outward = source(material, case)
    for up, seen in zip(rise, material + depths * outward, strict=True):
        forward = np.concatenate([[True], np.diff(np.maximum.accumulate(seen)) > 0])
        place = PchipInterpolator(seen[forward], up[forward])
        found.append(np.where(r_over_a > 1, place(np.maximum(r_over_a, seen[0])), -1.0))
    return np.reshape(found, (*np.shape(case.w_over_h), *r_over_a.shape))


def _kernel_nodes(reach_over_h: float) -> int:
    """Return enough Gauss nodes to follow cos(alpha u) J0(u r/h): half a node a radian, and 64 for the kernel."""
    return int(0.5 * KERNEL_END * reach_over_h) + 64


def _half_space(punch: PunchSolution, r: Floats) -> Floats:
    """Return Int_0^1 phi(x)/sqrt(r^2 - x^2) dx, by x = r sin(theta), which takes the singular edge away."""
    share, weights = gauss(48)
    end = np.arcsin(1 / r)
    return np.asarray(end * (punch.series(r[..., None] * np.sin(end[..., None] * share)) @ weights))


def _coupling_defect(u: Floats, poisson_ratio: float) -> Floats:
    """Return L_inf - L(u), written so that nothing cancels."""
    k, fall = 3 - 4 * poisson_ratio, np.exp(-2 * u)
    below = k * (1 + fall**2) + (4 * u**2 + 1 + k**2) * fall
    above = fall * ((1 - 2 * poisson_ratio) * (4 * u**2 + (1 + k) ** 2) + 4 * u**2)
    return np.asarray(above / (2 * (1 - poisson_ratio) * below))


@lru_cache(maxsize=64)
def _profile_spline(poisson_ratio: float, a_over_h: float) -> BSpline:
    """Return both profiles over s = sqrt((r - a)/h), in which the square root at the punch's edge is smooth."""
    from scipy.interpolate import make_interp_spline

    s = np.linspace(0, np.sqrt(REACH), SPLINE_NODES)
    rise, outward = exact_profile(1 + s**2 / a_over_h, poisson_ratio, a_over_h=a_over_h)
    return make_interp_spline(s, np.stack([rise, outward], axis=-1), k=5)


# Depth of the punch when its bevel first touches the gel.
#
# A bevel whose nearest edge is a height H behind the punch's face, at the distance d from its axis, meets the gel
# when
#
#     w + rise(d, w) = H,     rise = rho(d, w) w at the seen radius,     so  w = H/(1 + rho).
#
# For d beyond about 1.3 a the gel has risen, and the touch is early: w < H, by 9 % at d = 2a, nu = .48, a/h = .83;
# close to the punch the gel sinks in and the touch is late. The nearest edge touches first as long as the bevel
# falls away faster than the gel does beyond it; the profile's steepest rise is .15 w per mm, a bevel of 10 degrees
# .18. Valid for d > a and H below a quarter of the thickness.

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
        """Return w and rho, the fixed point of w = H/(1 + rho(w)): fast, since rho hardly depends on w."""
        from scipy.optimize import fixed_point

        place, a_over_h = np.array([place_mm / indenter.radius_mm]), indenter.radius_mm / thickness_mm

        def rho(w: float) -> float:
            case = PunchCase(nu, a_over_h, float(w) / thickness_mm, friction)
            return float(seen_profile(place, case, source=model.source)[0])

        try:
            depth = fixed_point(lambda w: height / (1 + rho(w)), height, (), TOLERANCE, STEPS, method="iteration")
        except RuntimeError as fault:
            raise ConvergenceError(f"the touch depth did not settle in {STEPS} steps") from fault
        return float(depth), rho(depth)

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
