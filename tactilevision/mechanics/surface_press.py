"""One press in the fit of poisson_from_surface.py, its linear unknowns eliminated: only the joint ones are left.

Unknowns of a press, in this order: apparent depth u (mm); relative error of the face's step; tilt of the face
along x and y; zero plane: offset (mm), slopes along x and y; its bowl: curvatures along x, across, along y (1/mm),
as a light that has drifted unevenly makes it; shift of the centre along x and y (mm).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tactilevision.mechanics.correlated import NoiseModel
from tactilevision.mechanics.profile import ProfileModel, ProfileSource, PunchCase, friction_of_share, seen_profile
from tactilevision.mechanics.surface_view import Blocks
from tactilevision.records import Floats

FACE_TILT_STD = 0.02  # slope, one sigma of the face's tilt
PLANE_STD = (1.0, 0.1, 0.1)  # as good as free: mm, and mm per mm
FREE_DEPTH_STD = 10.0  # mm, one sigma of a depth that is not known: as good as free
MIN_BLOCKS = 12  # blocks beside the punch
UNKNOWNS = 12  # columns of the linear part of the fit
DEPTH_STEP = 0.001  # w/h that certified depths are rounded to, so that repeats share one cached profile
SHAPE_END = 1.5  # thicknesses over which the last error of the shape fades


@dataclass(frozen=True, slots=True)
class Joint:
    """The unknowns that all presses share. `friction_share`: see friction_share of profile.py; `shape` (k,): error
    of the profile's rise over the depth at the places of the model's shape_error."""

    poisson_ratio: float
    thickness_mm: float
    friction_share: float
    gain: float
    shape: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Press:
    """A view's blocks, with the face's `depth_mm` on the map's scale, the blur, `step_std` of that depth, and the
    curvature that the zero plane may have."""

    blocks: Blocks
    depth_mm: float
    blur_mm: float
    step_std: float
    bowl_std_per_mm: float


def prepare(blocks: Blocks, *, blur_mm: float, step_std: float, bowl_std_per_mm: float) -> Press | None:
    """None where the view shows too little of the gel beside the punch, or neither the face nor a known depth."""
    beside = ~blocks.face
    if beside.sum() < MIN_BLOCKS:
        return None
    step_std, bowl_std_per_mm = max(step_std, 1e-6), max(bowl_std_per_mm, 1e-7)
    if not blocks.face.any():
        depth = blocks.view.certified_depth_mm
        return Press(blocks, depth, blur_mm, step_std, bowl_std_per_mm) if depth > 0 else None
    far = beside & (np.hypot(blocks.x_mm, blocks.y_mm) > np.quantile(blocks.r_mm, 0.6))
    floor = np.median(blocks.depth_mm[far]) if far.any() else 0.0
    depth = float(np.median(blocks.depth_mm[blocks.face]) - floor)
    return Press(blocks, depth, blur_mm, step_std, bowl_std_per_mm) if depth > 0 else None


def true_depth(press: Press, gain: float) -> float:
    """Depth of the punch: certified where that is known, else the map's own over its gain."""
    certified = press.blocks.view.certified_depth_mm
    return certified if np.isfinite(certified) else press.depth_mm / gain


def profile(press: Press, joint: Joint, *, model: ProfileModel, rise_factor: float = 1.0) -> Floats:
    """Depth over the face's depth, a ratio, on the press's radial grid (n,), blurred.

    `rise_factor` scales the gel beside it.
    """
    radius, r = press.blocks.view.radius_mm, press.blocks.r_mm
    a_over_h = float(np.clip(radius / joint.thickness_mm, *model.a_over_h_range))  # a step of the fit may stray
    w_over_h = min(true_depth(press, joint.gain) / joint.thickness_mm, model.deepest)
    if np.isfinite(press.blocks.view.certified_depth_mm):  # then repeats share a profile, to 1e-4 of the depth
        w_over_h = DEPTH_STEP * round(w_over_h / DEPTH_STEP)
    case = PunchCase(joint.poisson_ratio, a_over_h, w_over_h, friction_of_share(joint.friction_share))
    depth = -_seen(case, model.source, float(r[1] / radius), len(r))
    depth = np.where(r > radius, rise_factor * depth - _shape(r, press, joint, model), depth)
    if press.blur_mm == 0:
        return np.asarray(depth)
    step = r[1] - r[0]
    slope = np.gradient(depth, step)
    curvature = np.gradient(slope, step) + slope / np.maximum(r, step)
    return np.asarray(
        depth + press.blur_mm**2 / 2 * curvature
    )  # to second order in the blur, outside the guard band


@lru_cache(maxsize=256)
def _seen(case: PunchCase, source: ProfileSource, step_over_a: float, count: int) -> Floats:
    """seen_profile on the radial grid of a view: most steps of a fit ask for the same case again."""
    return seen_profile(step_over_a * np.arange(count, dtype=float), case, source=source)


def _shape(r_mm: Floats, press: Press, joint: Joint, model: ProfileModel) -> Floats:
    """Error of the rise over the depth, linear between the model's places, fading as the profile does."""
    if not joint.shape:
        return np.zeros(len(r_mm))
    beside = (r_mm - press.blocks.view.radius_mm) / joint.thickness_mm
    places = [place for place, _ in model.shape_error]
    return np.interp(beside, [*places, places[-1] + SHAPE_END], [*joint.shape, 0.0])


@dataclass(frozen=True, slots=True)
class WhitePress:
    """A press whose blocks have been made independent, of unit variance: W (.), W' W = covariance^-1.

    `whitener` (n, n) is W; `goal` (n,) the depths; `plain` (n, 9) the columns that do not depend on the
    profile; `mean`, `mean_x`, `mean_y` (n, m) as in Blocks; `std` (UNKNOWNS,) the prior of each unknown.
    """

    press: Press
    whitener: Floats
    goal: Floats
    plain: Floats
    mean: Floats
    mean_x: Floats
    mean_y: Floats
    std: Floats


def whiten(press: Press, noise: NoiseModel) -> WhitePress:
    """Apply the noise model of the block means once, so that each step of the fit is cheap."""
    blocks = press.blocks
    if noise.std_mm == 0:
        inverse = np.diag(np.sqrt(blocks.share) / noise.white_mm)
    else:
        inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance(blocks)))
    face = blocks.face.astype(float)
    turning = [face * blocks.x_mm, face * blocks.y_mm]
    x, y = blocks.x_mm, blocks.y_mm
    plain = [face * press.depth_mm, *turning, np.ones(len(face)), x, y, x**2 / 2, x * y, y**2 / 2]
    centre, bowl = max(blocks.view.centre_std_mm, 1e-6), press.bowl_std_per_mm
    face_std = (press.step_std, FACE_TILT_STD, FACE_TILT_STD)
    std = np.array([FREE_DEPTH_STD, *face_std, *PLANE_STD, bowl, bowl, bowl, centre, centre])
    mean, mean_x, mean_y = (inverse @ part.toarray() for part in (blocks.mean, blocks.mean_x, blocks.mean_y))
    return WhitePress(
        press, inverse, inverse @ blocks.depth_mm, inverse @ np.stack(plain, axis=1), mean, mean_x, mean_y, std
    )


def residual(white: WhitePress, joint: Joint, *, model: ProfileModel, rise_factor: float = 1.0) -> Floats:
    """What is left after the press's own unknowns have been fitted, (n + UNKNOWNS + 1,), in standard deviations.

    The last ones are what the priors of the unknowns and the certified depth add.
    """
    matrix, goal = _system(white, joint, model, rise_factor)
    return np.asarray(goal - matrix @ np.linalg.lstsq(matrix, goal, rcond=None)[0])


def unknowns(white: WhitePress, joint: Joint, *, model: ProfileModel) -> Floats:
    """The press's own unknowns (UNKNOWNS,), in the order given above."""
    return np.asarray(np.linalg.lstsq(*_system(white, joint, model, 1.0), rcond=None)[0])


def _system(white: WhitePress, joint: Joint, model: ProfileModel, rise_factor: float) -> tuple[Floats, Floats]:
    view, depth = white.press.blocks.view, profile(white.press, joint, model=model, rise_factor=rise_factor)
    slope = white.press.depth_mm * np.gradient(depth, white.press.blocks.r_mm[1])
    profiled = [white.mean @ depth, -(white.mean_x @ slope), -(white.mean_y @ slope)]
    columns = np.column_stack([profiled[0], white.plain, profiled[1], profiled[2]])
    known = np.isfinite(view.certified_depth_mm)
    weight = 1 / view.certified_depth_std_mm if known else 0.0
    matrix = np.concatenate([columns, np.diag(1 / white.std), weight * np.eye(1, len(white.std))])
    certified = weight * joint.gain * view.certified_depth_mm if known else 0.0
    return matrix, np.concatenate([white.goal, np.zeros(len(white.std)), [certified]])
