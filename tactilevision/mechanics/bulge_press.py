"""One press in the fit of bulge.py: its linear unknowns are eliminated, so that only the joint ones are left.

Unknowns of a press, in this order: apparent depth u (mm); relative error of the face's step; tilt of the face
along x and y; zero plane: offset (mm), slopes along x and y; shift of the centre along x and y (mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.mechanics.correlated import NoiseModel
from tactilevision.mechanics.profile import ProfileModel, PunchCase, friction_of_share, seen_profile
from tactilevision.mechanics.surface_view import Blocks
from tactilevision.records import Floats

FACE_TILT_STD = 0.02
PLANE_STD = (1.0, 0.1, 0.1)  # as good as free: mm, and mm per mm
FREE_DEPTH_STD = 10.0
FEWEST_BLOCKS = 12


@dataclass(frozen=True, slots=True)
class Joint:
    """The unknowns that all presses share. `friction_share`: see friction_share of profile.py."""

    poisson_ratio: float
    thickness_mm: float
    friction_share: float
    gain: float


@dataclass(frozen=True, slots=True)
class Press:
    """A view's blocks, with the face's `depth_mm` on the map's scale, the blur, and `step_std` of that depth."""

    blocks: Blocks
    depth_mm: float
    blur_mm: float
    step_std: float


def prepare(blocks: Blocks, *, blur_mm: float, step_std: float) -> Press | None:
    """None where the view shows too little of the face, too little of the gel beside it, or no depth at all."""
    beside = ~blocks.face
    if not blocks.face.any() or beside.sum() < FEWEST_BLOCKS:
        return None
    far = beside & (np.hypot(blocks.x_mm, blocks.y_mm) > np.quantile(blocks.r_mm, 0.6))
    floor = np.median(blocks.depth_mm[far]) if far.any() else 0.0
    depth = float(np.median(blocks.depth_mm[blocks.face]) - floor)
    return Press(blocks, depth, blur_mm, max(step_std, 1e-6)) if depth > 0 else None


def true_depth(press: Press, gain: float) -> float:
    """Depth of the punch: certified where that is known, else the map's own over its gain."""
    certified = press.blocks.view.certified_depth_mm
    return certified if np.isfinite(certified) else press.depth_mm / gain


def profile(press: Press, joint: Joint, model: ProfileModel, *, rise_factor: float = 1.0) -> Floats:
    """Depth over the face's depth on the press's radial grid, blurred; `rise_factor` scales the gel beside it."""
    radius, r = press.blocks.view.radius_mm, press.blocks.r_mm
    a_over_h = float(np.clip(radius / joint.thickness_mm, *model.a_over_h_range))  # a step of the fit may stray
    w_over_h = min(true_depth(press, joint.gain) / joint.thickness_mm, model.deepest)
    case = PunchCase(joint.poisson_ratio, a_over_h, w_over_h, friction_of_share(joint.friction_share))
    depth = -seen_profile(r / radius, case, source=model.source)
    depth = np.where(r > radius, rise_factor * depth, depth)
    if press.blur_mm == 0:
        return np.asarray(depth)
    step = r[1] - r[0]
    slope = np.gradient(depth, step)
    curvature = np.gradient(slope, step) + slope / np.maximum(r, step)
    return np.asarray(
        depth + press.blur_mm**2 / 2 * curvature
    )  # to second order in the blur, outside the guard band


@dataclass(frozen=True, slots=True)
class WhitePress:
    """A press whose blocks have been made independent, of unit variance: W (.), W' W = covariance^-1.

    `goal` (n,) the depths; `plain` (n, 6) the columns that do not depend on the profile; `mean`, `mean_x`,
    `mean_y` (n, m) as in Blocks; `std` (9,) the prior of each unknown.
    """

    press: Press
    goal: Floats
    plain: Floats
    mean: Floats
    mean_x: Floats
    mean_y: Floats
    std: Floats


def whiten(press: Press, noise: NoiseModel) -> WhitePress:
    """Apply the noise model of the block means once, so that each step of the fit is cheap."""
    blocks = press.blocks
    inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance(blocks)))
    face = blocks.face.astype(float)
    turning = [face * blocks.x_mm, face * blocks.y_mm]
    plain = [face * press.depth_mm, *turning, np.ones(len(face)), blocks.x_mm, blocks.y_mm]
    centre = max(blocks.view.centre_std_mm, 1e-6)
    std = np.array([FREE_DEPTH_STD, press.step_std, FACE_TILT_STD, FACE_TILT_STD, *PLANE_STD, centre, centre])
    mean, mean_x, mean_y = (inverse @ part.toarray() for part in (blocks.mean, blocks.mean_x, blocks.mean_y))
    return WhitePress(
        press, inverse @ blocks.depth_mm, inverse @ np.stack(plain, axis=1), mean, mean_x, mean_y, std
    )


def residual(white: WhitePress, joint: Joint, model: ProfileModel, *, rise_factor: float = 1.0) -> Floats:
    """What is left after the press's own unknowns have been fitted, (n + 10,), in standard deviations.

    The last ten are what the priors of the unknowns and the certified depth add.
    """
    matrix, goal = _system(white, joint, model, rise_factor)
    return np.asarray(goal - matrix @ np.linalg.lstsq(matrix, goal, rcond=None)[0])


def unknowns(white: WhitePress, joint: Joint, model: ProfileModel) -> Floats:
    """The press's own unknowns (9,), in the order given above."""
    return np.asarray(np.linalg.lstsq(*_system(white, joint, model, 1.0), rcond=None)[0])


def _system(white: WhitePress, joint: Joint, model: ProfileModel, rise_factor: float) -> tuple[Floats, Floats]:
    view, depth = white.press.blocks.view, profile(white.press, joint, model, rise_factor=rise_factor)
    slope = white.press.depth_mm * np.gradient(depth, white.press.blocks.r_mm[1])
    profiled = [white.mean @ depth, -(white.mean_x @ slope), -(white.mean_y @ slope)]
    columns = np.column_stack([profiled[0], white.plain, profiled[1], profiled[2]])
    known = np.isfinite(view.certified_depth_mm)
    weight = 1 / view.certified_depth_std_mm if known else 0.0
    matrix = np.concatenate([columns, np.diag(1 / white.std), weight * np.eye(1, len(white.std))])
    certified = weight * joint.gain * view.certified_depth_mm if known else 0.0
    return matrix, np.concatenate([white.goal, np.zeros(len(white.std)), [certified]])
