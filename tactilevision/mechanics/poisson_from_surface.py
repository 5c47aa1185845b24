"""Estimate Poisson's ratio from the rise of the gel's surface around a flat punch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.profile import (
    LIKELY_SHARE,
    LINEAR,
    SHARE_STD,
    ProfileModel,
    ProfileSource,
    PunchCase,
    friction_of_share,
    seen_profile,
)
from tactilevision.mechanics.surface_view import (
    WHITE,
    Blocks,
    NoiseModel,
    SurfaceView,
    estimate_noise,
    reduce_view,
)
from tactilevision.mechanics.tables.punch import TABULATED
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Estimate, Floats

# One press, its linear unknowns eliminated, in this order: apparent depth u (mm); relative error of the face's
# step; tilt of the face along x and y; zero plane: offset (mm), slopes along x and y; its bowl: curvatures along
# x, across, along y (1/mm), as by an uneven drift of the light; shift of the centre along x and y (mm).

FACE_TILT_STD = 0.02  # slope, prior std of the face's tilt
PLANE_STD = (1.0, 0.1, 0.1)  # nearly free: mm, and mm per mm
FREE_DEPTH_STD = 10  # mm, prior std of an unknown depth: nearly free
MIN_BLOCKS = 12  # blocks outside the punch
UNKNOWNS = 12  # columns of the linear part of the fit
DEPTH_STEP = 0.001  # w/h to which certified depths are rounded, so that repeats share one cached profile
SHAPE_END = 1.5  # thicknesses over which the last error of the shape fades


@dataclass(frozen=True, slots=True)
class Joint:
    """The shared unknowns. `friction_share`: see friction_share of profile.py; `shape` (k,): error of the
    profile's rise over the depth at the places of the model's shape_error.
    """

    poisson_ratio: float
    thickness_mm: float
    friction_share: float
    gain: float
    shape: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Press:
    """A view's blocks, with the face's `depth_mm` on the map's scale, and the curvature that the zero plane may
    have."""

    blocks: Blocks
    depth_mm: float
    bowl_std_per_mm: float


def prepare(blocks: Blocks, bowl_std_per_mm: float) -> Press | None:
    """Return the view, or None if it shows too little gel outside the punch, or neither the face nor a known
    depth.
    """
    outside, depth = ~blocks.face, blocks.view.certified_depth_mm
    if outside.sum() < MIN_BLOCKS:
        return None
    if blocks.face.any():
        far = outside & (np.hypot(blocks.x_mm, blocks.y_mm) > np.quantile(blocks.r_mm, 0.6))
        floor = np.median(blocks.depth_mm[far]) if far.any() else 0.0
        depth = float(np.median(blocks.depth_mm[blocks.face]) - floor)
    return Press(blocks, depth, max(bowl_std_per_mm, PINNED / 10)) if depth > 0 else None


def true_depth(press: Press, gain: float) -> float:
    """Return the depth of the punch: certified where that is known, else the map's own over its gain."""
    certified = press.blocks.view.certified_depth_mm
    return certified if np.isfinite(certified) else press.depth_mm / gain


def profile(press: Press, joint: Joint, *, model: ProfileModel, rise_factor: float = 1.0) -> Floats:
    """Return the depth over the face's depth, a ratio, on the press's radial grid (n,).

    `rise_factor` scales the gel outside the face.
    """
    radius, r = press.blocks.view.radius_mm, press.blocks.r_mm
    a_over_h = float(np.clip(radius / joint.thickness_mm, *model.a_over_h_range))  # a step of the fit may leave it
    w_over_h = min(true_depth(press, joint.gain) / joint.thickness_mm, model.deepest)
    if np.isfinite(press.blocks.view.certified_depth_mm):  # repeats share a profile, to 1e-4 of the depth
        w_over_h = DEPTH_STEP * round(w_over_h / DEPTH_STEP)
    case = PunchCase(joint.poisson_ratio, a_over_h, w_over_h, friction_of_share(joint.friction_share))
    depth = -_seen(case, model.source, float(r[1] / radius), len(r))
    return np.where(r > radius, rise_factor * depth - _shape(r, press, joint, model), depth)


@lru_cache(maxsize=256)
def _seen(case: PunchCase, source: ProfileSource, step_over_a: float, count: int) -> Floats:
    """Return seen_profile on the radial grid of a view; cached, since most steps of a fit need the same case."""
    return seen_profile(step_over_a * np.arange(count, dtype=float), case, source=source)


def _shape(r_mm: Floats, press: Press, joint: Joint, model: ProfileModel) -> Floats:
    """Return the error of the rise over the depth, linear between the model's places, fading as the profile
    does.
    """
    if not joint.shape:
        return np.zeros(len(r_mm))
    beyond = (r_mm - press.blocks.view.radius_mm) / joint.thickness_mm
    places = [place for place, _ in model.shape_error]
    return np.interp(beyond, [*places, places[-1] + SHAPE_END], [*joint.shape, 0.0])


@dataclass(frozen=True, slots=True)
class WhitePress:
    """A press whose blocks were whitened to unit variance: W (.), W' W = covariance^-1.

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
    centre, bowl = max(blocks.view.centre_std_mm, PINNED), press.bowl_std_per_mm
    face_std = (PINNED, FACE_TILT_STD, FACE_TILT_STD)  # the step at the wall is as good as the rest of the map
    std = np.array([FREE_DEPTH_STD, *face_std, *PLANE_STD, bowl, bowl, bowl, centre, centre])
    mean, mean_x, mean_y = (inverse @ part.toarray() for part in (blocks.mean, blocks.mean_x, blocks.mean_y))
    return WhitePress(
        press, inverse, inverse @ blocks.depth_mm, inverse @ np.stack(plain, axis=1), mean, mean_x, mean_y, std
    )


def residual(white: WhitePress, joint: Joint, *, model: ProfileModel, rise_factor: float = 1.0) -> Floats:
    """Return the residual after the press's own unknowns were fitted, (n + UNKNOWNS + 1,), in standard deviations.

    The last UNKNOWNS + 1 are those of the priors and the certified depth.
    """
    matrix, goal = _system(white, joint, model, rise_factor)
    return np.asarray(goal - matrix @ np.linalg.lstsq(matrix, goal, rcond=None)[0])


def unknowns(white: WhitePress, joint: Joint, *, model: ProfileModel) -> Floats:
    """Return the press's own unknowns (UNKNOWNS,), in the order given above."""
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


# Poisson's ratio from the picture: the less compressible the gel, the more it rises around a flat punch.
#
# For every press i and block of the height map (surface_view.py)
#
#     depth = g_i + (t_i, s_i).(x, y) + u_i D(r; nu, a/h, w_i/h, mu) + noise,
#     D = 1 (+ e_i) under the face, -rise/depth at the *seen* radius outside it,
#
# u_i the depth on the map's own scale (only the ratio of rise to depth matters, not the gain), g, t, s its zero
# plane (and its bowl, where the light may drift), e_i the error of the step at the punch's wall, and small shifts
# of the centre. These are linear and eliminated for each press; nu, h, mu, the map's gain and the errors of the
# profile's shape are fitted, with their priors, by a few steps of least squares. A view without the face needs a
# certified depth, which the gain links to it. The noise of the block means is estimated from the residuals
# (variance, correlation length, a white part), and the interval is widened to the scatter between presses, between
# depths (rise over depth is one function of them), and between directions from the punch (an error of the light is
# common to all presses). It holds for a wide gel, a punch that is straight within a few hundredths, and depths
# within the range of the profile's source.
#
# Source: elimination of linear parameters: Golub, Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; clustered
# covariance: White, Econometrica 48 (1980) 817.

START = 0.45  # Poisson's ratio at the start of the fit
AT_END = 1e-4  # of nu: distance from a bound at which a solver stops
AT_BOUND = 1e-3  # distance from the table's lowest nu within which another model is taken
PINNED = 1e-6  # standard deviation of a known quantity
STEP = 1e-4  # of a joint unknown, for derivatives
MIN_CLUSTERS = 4  # least number of clusters of a robust covariance
SECTORS = 8  # of directions from the punch
SAME_DEPTH = 0.1  # relative difference of depths within a cluster
NO_ANSWER_WIDTH = 0.25  # width of an interval, half the range of nu, beyond which there is no estimate


@dataclass(frozen=True, slots=True)
class SurfaceFitSettings:
    """Settings of the fit. Lengths in mm.

    `guard_mm` on either side of the punch's edge is excluded; the profile is used to `reach` thicknesses beyond
    it. `gain_std` is the standard deviation of the map's gain, `bowl_std_per_mm` that of the zero plane's
    curvature.
    """

    block_mm: float = 1.0
    guard_mm: float = 0.6
    reach: float = 2.2
    gain_std: float = 0.05
    bowl_std_per_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class SurfaceFit:
    """nu from the picture.

    `values` of the joint parameters: Poisson's ratio, logarithm of the thickness over the stated one, share of
    friction's full effect, gain, then the model's errors of shape. `left_out` names the unused views.
    """

    poisson_ratio: Estimate
    values: Floats
    model: str
    left_out: tuple[str, ...] = ()


LOWER = (-0.5, 0.0, 0.5)  # of all but nu, whose bounds are the model's
UPPER = (0.5, 1.0, 2.0)  # of all but nu, whose bounds are the model's


@dataclass(frozen=True, slots=True)
class _Task:
    presses: tuple[Press, ...]
    thickness_mm: float
    prior: Floats
    prior_std: Floats
    model: ProfileModel

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        low, high = self.model.poisson_range
        free = np.ones(len(self.model.shape_error))
        return np.array([low, *LOWER, *-free]), np.array([high, *UPPER, *free])


def fit_poisson_ratio(
    views: Sequence[SurfaceView],
    *,
    thickness_mm: float,
    thickness_std_mm: float = 0.0,
    model: ProfileModel | None = None,
    settings: SurfaceFitSettings | None = None,
) -> SurfaceFit:
    """Fit nu to the surfaces of any number of presses, of any depths and punch radii, together.

    The default model is the table of finite elements for gels in its range, else linear theory. Views outside the
    model's range (of depth or a/h) are excluded and named. Raises InputError if no view shows both the face and
    the gel outside it, or a length is not above 0.
    """
    settings = settings or SurfaceFitSettings()
    if not (thickness_mm > 0 and thickness_std_mm >= 0):
        raise InputError("the gel's thickness must be above 0 mm", where="fit_poisson_ratio", value=thickness_mm)
    thickness = (thickness_mm, thickness_std_mm)
    if model is not None:
        return _fit(views, thickness, model, settings)
    low, high = TABULATED.a_over_h_range
    if all(low <= view.radius_mm / thickness_mm <= high for view in views):
        fit = _fit(views, thickness, TABULATED, settings)
        if fit.values[0] > TABULATED.poisson_range[0] + AT_BOUND:
            return fit
    return _fit(views, thickness, LINEAR, settings)


def _fit(
    views: Sequence[SurfaceView], thickness: tuple[float, float], model: ProfileModel, settings: SurfaceFitSettings
) -> SurfaceFit:
    task = _task(views, thickness, model, settings)
    rough = _solve(task, task.prior, [whiten(press, WHITE) for press in task.presses])
    task = replace(task, presses=_presses(_centred(task, rough), thickness[0], model, settings))
    white = [whiten(press, WHITE) for press in task.presses]
    misfits = [residual(w, _joint(task, rough), model=model)[: len(w.goal)] * WHITE.white_mm for w in white]
    noise = estimate_noise([press.blocks for press in task.presses], misfits, block_mm=settings.block_mm)
    white = [whiten(press, noise) for press in task.presses]
    fit = _report(task, _solve(task, rough, white), white)
    used = {press.blocks.view.name for press in task.presses}
    return replace(fit, left_out=tuple(view.name for view in views if view.name not in used))


def _presses(
    views: Sequence[SurfaceView], thickness_mm: float, model: ProfileModel, settings: SurfaceFitSettings
) -> tuple[Press, ...]:
    found = []
    for view in views:
        reach = view.radius_mm + settings.reach * thickness_mm
        blocks = reduce_view(view, block_mm=settings.block_mm, guard_mm=settings.guard_mm, reach_mm=reach)
        press = prepare(blocks, settings.bowl_std_per_mm)
        low, high = model.a_over_h_range
        if press is None or not low <= view.radius_mm / thickness_mm <= high:
            continue
        if true_depth(press, 1.0) <= model.deepest * thickness_mm:
            found.append(press)
    return tuple(found)


def _centred(task: _Task, theta: Floats) -> list[SurfaceView]:
    """Move the views to the centre that a first fit gives: near the edge the profile is too curved for one
    step.
    """
    moved = []
    for press in task.presses:
        view = press.blocks.view
        x, y = unknowns(whiten(press, WHITE), _joint(task, theta), model=task.model)[-2:]
        moved.append(replace(view, centre_mm=(view.centre_mm[0] + float(x), view.centre_mm[1] + float(y))))
    return moved


def _task(
    views: Sequence[SurfaceView], thickness: tuple[float, float], model: ProfileModel, settings: SurfaceFitSettings
) -> _Task:
    presses = _presses(views, thickness[0], model, settings)
    if not presses:
        raise InputError(
            "no height map within the profile's range shows both the face and the gel outside it",
            where="fit_poisson_ratio",
            value=len(views),
            remedy="Take a wider view, other depths, or the linear model.",
        )
    friction_std = SHARE_STD if model.frictional else PINNED
    shape = [std for _, std in model.shape_error]
    std = np.array([np.inf, max(thickness[1] / thickness[0], PINNED), friction_std, settings.gain_std, *shape])
    start = np.array([START, 0.0, LIKELY_SHARE, 1.0, *np.zeros(len(shape))])
    return _Task(presses, thickness[0], start, std, model)


def _joint(task: _Task, theta: Floats) -> Joint:
    nu, log_thickness, friction, gain, *shape = (float(value) for value in theta)
    return Joint(nu, task.thickness_mm * float(np.exp(log_thickness)), friction, gain, tuple(shape))


def _residuals(
    task: _Task, theta: Floats, white: Sequence[WhitePress], *, rise_factor: float = 1.0
) -> list[Floats]:
    joint = _joint(task, theta)
    return [residual(press, joint, model=task.model, rise_factor=rise_factor) for press in white]


def _solve(task: _Task, theta: Floats, white: Sequence[WhitePress]) -> Floats:
    from scipy.optimize import least_squares

    def everything(values: Floats) -> Floats:
        parts = _residuals(task, values, white)
        return np.concatenate([*parts, (values - task.prior) / task.prior_std])

    def slopes(values: Floats) -> Floats:
        return np.concatenate([*_slopes(task, values, white), np.diag(1 / task.prior_std)])

    start = np.clip(theta, task.bounds[0] + PINNED, task.bounds[1] - PINNED)
    scale = np.minimum(task.prior_std, 0.1)
    found = least_squares(everything, start, jac=slopes, bounds=task.bounds, x_scale=scale, ftol=1e-5, xtol=1e-5)
    return np.asarray(found.x)


def _report(task: _Task, theta: Floats, white: Sequence[WhitePress]) -> SurfaceFit:
    now = _residuals(task, theta, white)
    slopes = _slopes(task, theta, white)
    information = np.diag(task.prior_std**-2.0)
    own = [slope.T @ slope for slope in slopes]
    covariance = np.linalg.inv(information + sum(own)).astype(float)
    scores = np.array([slope.T @ part for slope, part in zip(slopes, now, strict=True)])
    other = _residuals(task, theta, white, rise_factor=1 + task.model.relative_error)
    pull = sum(slope.T @ (b - a) for slope, a, b in zip(slopes, now, other, strict=True))
    systematic = float((covariance @ pull)[0])
    depths = _by_depth(white, scores)
    groups = (scores, _by_direction(white, slopes, now), depths)
    shown = max(_clustered(covariance, information, part) for part in groups)
    if len(depths) < MIN_CLUSTERS:  # no scatter shows the model's error at these depths
        systematic = float(np.hypot(systematic, task.model.single_depth_std / np.sqrt(len(depths))))
    own_nu = np.array([part[0, 0] for part in own])
    alone = theta[0] - scores[:, 0] / own_nu
    systematic = float(np.hypot(systematic, _trend(task.presses, alone, own_nu)))
    std = np.sqrt(covariance[0, 0])
    nu = _estimate(theta[0], std, shown, systematic, task.model.poisson_range)
    return SurfaceFit(nu, theta, task.model.name)


def _slopes(task: _Task, theta: Floats, white: Sequence[WhitePress]) -> list[Floats]:
    """Return the derivative of each press's residual by the k joint unknowns, (n + UNKNOWNS + 1, k).

    Inwards at a bound.
    """
    base = _residuals(task, theta, white)
    columns = []
    for index in range(len(theta)):
        step = np.zeros(len(theta))
        step[index] = STEP if theta[index] + STEP <= task.bounds[1][index] else -STEP
        moved = _residuals(task, theta + step, white)
        columns.append([(b - a) / step[index] for a, b in zip(base, moved, strict=True)])
    return [np.stack(parts, axis=1) for parts in zip(*columns, strict=True)]


def _by_direction(white: Sequence[WhitePress], slopes: Sequence[Floats], now: Sequence[Floats]) -> Floats:
    """Return the scores (SECTORS, k) of the blocks that lie in one direction from the punch, over all presses.

    An error of one light is the same in one direction in every press.
    """
    total = np.zeros((SECTORS, slopes[0].shape[1]))
    for press, slope, part in zip(white, slopes, now, strict=True):
        count, blocks = len(press.goal), press.press.blocks
        misfit = np.linalg.solve(press.whitener, part[:count])
        scores = (press.whitener.T @ slope[:count]) * misfit[:, None]
        turn = np.arctan2(blocks.y_mm, blocks.x_mm) / (2 * np.pi) % 1.0
        np.add.at(total, np.minimum((SECTORS * turn).astype(int), SECTORS - 1), scores)
    return total


def _trend(presses: Sequence[Press], estimates: Floats, weights: Floats) -> float:
    """Return half of nu's change over the depths, as far as it exceeds what noise and scatter give at 95 %.

    The gel has one nu: a change with depth is an error of the profile or the map at unknown depths.
    """
    from scipy.stats import t

    depth = np.array([true_depth(press, 1.0) for press in presses])
    reach = float(np.ptp(depth))
    if len(depth) < MIN_CLUSTERS or reach < SAME_DEPTH * depth.max():
        return 0.0
    away = depth - np.average(depth, weights=weights)
    power = float(weights @ away**2)
    slope = float(weights @ (away * estimates)) / power
    residuals = estimates - np.average(estimates, weights=weights) - slope * away
    scatter = float(weights @ residuals**2) / (len(depth) - 2)  # 1 for noise alone
    chance = float(t.ppf(0.975, len(depth) - 2)) ** 2 * max(scatter, 1.0) / power
    return 0.5 * reach * float(np.sqrt(max(slope**2 - chance, 0.0)))


def _by_depth(white: Sequence[WhitePress], scores: Floats) -> Floats:
    """Return scores (groups, k) of presses of about one depth: repeats do not reduce a model's error there."""
    depth = np.array([true_depth(press.press, 1.0) for press in white])
    order = np.argsort(depth)
    group = np.concatenate([[0], np.cumsum(np.diff(depth[order]) > SAME_DEPTH * depth[order][1:])])
    total = np.zeros((int(group[-1]) + 1, scores.shape[1]))
    np.add.at(total, group, scores[order])
    return total


def _clustered(covariance: Floats, information: Floats, scores: Floats) -> float:
    """Return half of the 95 % interval of nu that the scatter of groups shows; 0 for fewer than four of them."""
    from scipy.stats import t

    count = len(scores)
    if count < MIN_CLUSTERS:
        return 0.0
    meat = scores.T @ scores * count / (count - 1) + information * np.isfinite(information)
    spread = covariance @ meat @ covariance
    return float(t.ppf(0.975, count - 1) * np.sqrt(spread[0, 0]))


def _estimate(value: float, std: float, shown: float, systematic: float, bounds: tuple[float, float]) -> Estimate:
    half = float(np.hypot(max(Z95 * std, shown), Z95 * systematic))
    low, high = max(value - half, 0.0), min(value + half, 0.5)
    if high - low > NO_ANSWER_WIDTH:
        return Estimate(None, None, (low, high), "1", "the rise around the punch is below the noise of the maps")
    if not bounds[0] + AT_END < value < bounds[1] - AT_END:
        return Estimate(None, None, (low, high), "1", f"the fit lies at the bound of Poisson's ratio, {value:.4f}")
    return Estimate(float(value), half / Z95, (low, high), "1")
