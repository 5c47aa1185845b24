"""Estimate Poisson's ratio from the rise of the gel's surface around a flat punch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress

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
from tactilevision.records.constants import TAILS95, Z95
from tactilevision.records.measured import Estimate, Floats, Pair

# One press, its linear unknowns eliminated, in this order: apparent depth u (mm); relative error of the face's
# step; tilt of the face along x and y; zero plane: offset (mm), slopes along x and y; its bowl: curvatures along
# x, across, along y (1/mm), as by an uneven drift of the light; shift of the centre along x and y (mm).

FACE_TILT_STD = 0.02  # slope, prior std of the face's tilt
PLANE_STD = (1.0, 0.1, 0.1)  # nearly free: mm, and mm per mm
FREE_DEPTH_STD = 10  # mm, prior std of an unknown depth: nearly free
MIN_BLOCKS = 12  # blocks outside the punch
DEPTH_STEP = 0.001  # w/h to which certified depths are rounded, so that repeats share one cached profile
SHAPE_END = 1.5  # thicknesses over which the last error of the shape fades


@dataclass(frozen=True, slots=True)
class Press:
    """A view's blocks, whitened to unit variance: W (.), W' W = covariance^-1.

    `depth_mm` of the face on the map's scale; `std` (12,) the prior of each unknown; `whitener` (n, n) is W;
    `goal` (n,) the depths; `plain` (n, 9) the columns that do not depend on the profile; `mean`, `mean_x` and
    `mean_y` (n, m) as in Blocks.
    """

    blocks: Blocks
    depth_mm: float
    std: Floats
    whitener: Floats
    goal: Floats
    plain: Floats
    mean: Floats
    mean_x: Floats
    mean_y: Floats

    @property
    def certified(self) -> Pair:
        """Return 1 over the deviation of the certified depth, and the depth in deviations; 0 if unknown."""
        depth, std = self.blocks.view.certified_depth_mm, self.blocks.view.certified_depth_std_mm
        return (1 / std, depth / std) if np.isfinite(depth) else (0.0, 0.0)

    def columns(self, depth: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the columns (n, ...) of the depth and of the centre's shifts for profiles (m, ...)."""
        slope = self.depth_mm * np.gradient(depth, self.blocks.r_mm[1], axis=0)
        return self.mean @ depth, -(self.mean_x @ slope), -(self.mean_y @ slope)

    def true_depth(self, gain: float = 1.0) -> float:
        """Return the depth of the punch: certified where that is known, else the map's own over its gain."""
        certified = self.blocks.view.certified_depth_mm
        return certified if np.isfinite(certified) else self.depth_mm / gain


def face_depth(blocks: Blocks) -> float:
    """Return the depth of the face on the map's scale; NaN where it shows too little gel outside, or no depth."""
    outside = ~blocks.face
    if outside.sum() < MIN_BLOCKS:
        return np.nan
    if not blocks.face.any():
        return blocks.view.certified_depth_mm
    far = outside & (np.hypot(blocks.x_mm, blocks.y_mm) > np.quantile(blocks.r_mm, 0.6))
    floor = np.median(blocks.depth_mm[far]) if far.any() else 0.0
    return float(np.median(blocks.depth_mm[blocks.face]) - floor)


def whiten(blocks: Blocks, depth_mm: float, noise: NoiseModel, *, bowl_std_per_mm: float) -> Press:
    """Apply the noise model of the block means once, so that each step of the fit is cheap.

    `depth_mm` of the face; `bowl_std_per_mm` of the curvature that the zero plane may have.
    """
    if noise.std_mm == 0:
        inverse = np.diag(np.sqrt(blocks.share) / noise.white_mm)
    else:
        inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance(blocks)))
    face, x, y = blocks.face.astype(float), blocks.x_mm, blocks.y_mm
    plain = [face * depth_mm, face * x, face * y, np.ones(len(face)), x, y, x**2 / 2, x * y, y**2 / 2]
    centre, bowl = max(blocks.view.centre_std_mm, PINNED), max(bowl_std_per_mm, PINNED / 10)
    face_std = (PINNED, FACE_TILT_STD, FACE_TILT_STD)  # the step at the wall is as good as the rest of the map
    std = np.array([FREE_DEPTH_STD, *face_std, *PLANE_STD, bowl, bowl, bowl, centre, centre])
    means = (inverse @ part.toarray() for part in (blocks.mean, blocks.mean_x, blocks.mean_y))
    return Press(
        blocks, depth_mm, std, inverse, inverse @ blocks.depth_mm, inverse @ np.stack(plain, axis=1), *means
    )


@lru_cache(maxsize=256)
def _seen(case: PunchCase, source: ProfileSource, step_over_a: float, count: int) -> Floats:
    """Return seen_profile on the radial grid of a view; cached, since most steps of a fit need the same case."""
    return seen_profile(step_over_a * np.arange(count, dtype=float), case, source=source)


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
AT_BOUND = 10 * AT_END  # distance from the table's lowest nu within which another model is taken
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
    curvature. `start`: values of an earlier fit that is near, from which few steps remain.
    """

    block_mm: float = 1.0
    guard_mm: float = 0.6
    reach: float = 2.2
    gain_std: float = 0.05
    bowl_std_per_mm: float = 0.0
    start: tuple[float, ...] = ()


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
class _Fit:
    """The presses of a fit, and the prior of its k joint unknowns theta, in the order of SurfaceFit's values."""

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

    def profiles(self, theta: Floats, rise_factor: float = 1.0) -> list[Floats]:
        """Return the depth over the face's depth, a ratio, on each press's radial grid (n,).

        `rise_factor` scales the gel outside the face. The error of its shape is linear between the model's places,
        and fades as the profile does.
        """
        nu, log_thickness, friction_share, gain, *shape = (float(value) for value in theta)
        model, thickness = self.model, self.thickness_mm * float(np.exp(log_thickness))
        depths = [min(press.true_depth(gain) / thickness, model.deepest) for press in self.presses]
        for k, press in enumerate(self.presses):
            if np.isfinite(press.blocks.view.certified_depth_mm):  # repeats share a profile, to 1e-4 of the depth
                depths[k] = DEPTH_STEP * round(depths[k] / DEPTH_STEP)
        friction = friction_of_share(friction_share)
        radii = [press.blocks.view.radius_mm for press in self.presses]
        places, found = [place for place, _ in model.shape_error] or [0.0], []
        for press, radius, w_over_h in zip(self.presses, radii, depths, strict=True):
            several = tuple(dict.fromkeys(compress(depths, (one == radius for one in radii))))
            r = press.blocks.r_mm
            # a step of the fit may leave the range
            a_over_h = float(np.clip(radius / thickness, *model.a_over_h_range))
            case = PunchCase(nu, a_over_h, several, friction)
            depth = -_seen(case, model.source, float(r[1] / radius), len(r))[several.index(w_over_h)]
            off = np.interp((r - radius) / thickness, [*places, places[-1] + SHAPE_END], [*(shape or [0.0]), 0.0])
            found.append(np.where(r > radius, rise_factor * depth - off, depth))
        return found

    def system(self, press: Press, profile: Floats, gain: float) -> tuple[Floats, Floats]:
        """Return the linear equations of the press's own unknowns (12,), and their right side.

        Both are in standard deviations; the last 13 rows are priors and the certified depth.
        """
        first, *last = press.columns(profile)
        weight, certified = press.certified
        columns = np.column_stack([first, press.plain, *last])
        matrix = np.concatenate([columns, np.diag(1 / press.std), weight * np.eye(1, len(press.std))])
        return matrix, np.concatenate([press.goal, np.zeros(len(press.std)), [gain * certified]])

    def residuals(self, theta: Floats, rise_factor: float = 1.0) -> list[Floats]:
        """Return each press's residual (n + 13,) after its own unknowns were fitted."""
        found = []
        for press, profile in zip(self.presses, self.profiles(theta, rise_factor), strict=True):
            matrix, goal = self.system(press, profile, theta[3])
            q, _ = np.linalg.qr(matrix)
            found.append(goal - q @ (q.T @ goal))
        return found

    def slopes(self, theta: Floats) -> list[Floats]:
        """Return the derivative of each press's residual by the joint unknowns, (n + 13, k).

        Inwards at a bound, 0 by a known one.
        """
        steps = np.where(theta + STEP <= self.bounds[1], STEP, -STEP) * (self.prior_std > PINNED)
        now = self.profiles(theta)
        moved = [self.profiles(theta + step) if step.any() else now for step in np.diag(steps)]
        scale = np.where(steps, steps, 1.0)[:, None]
        rates = (np.subtract(there, here) / scale for here, *there in zip(now, *moved, strict=True))
        return [self._slopes(*one, theta) for one in zip(self.presses, now, rates, strict=True)]

    def _slopes(self, press: Press, profile: Floats, rates: Floats, theta: Floats) -> Floats:
        """Return the derivative (n + 13, k) of a press's residual r, of its equations A x = g with A = Q R.

        `rates` (k, m) of its profile (m,).
        r' = (1 - Q Q')(g' - A' x) - Q R^-T (A'^T r)        Golub, Pereyra (1973)
        """
        changes = np.stack(press.columns(rates.T))
        matrix, goal = self.system(press, profile, theta[3])
        q, r = np.linalg.qr(matrix)
        own = np.linalg.solve(r, q.T @ goal)
        off, varying, count = goal - matrix @ own, [0, -2, -1], len(press.goal)
        change, pull = np.zeros((len(goal), len(theta))), np.zeros((len(own), len(theta)))
        change[:count] = -np.tensordot(own[varying], changes, axes=1)
        change[-1, 3] = press.certified[1]
        pull[varying] = off[:count] @ changes
        return np.asarray(change - q @ (q.T @ change + np.linalg.solve(r.T, pull)))

    def solved(self, theta: Floats) -> Floats:
        """Return the joint unknowns of the least squares, from a start at theta."""
        from scipy.optimize import least_squares

        def everything(theta: Floats) -> Floats:
            return np.concatenate([*self.residuals(theta), (theta - self.prior) / self.prior_std])

        def slopes(theta: Floats) -> Floats:
            return np.concatenate([*self.slopes(theta), np.diag(1 / self.prior_std)])

        start = np.clip(theta, self.bounds[0] + PINNED, self.bounds[1] - PINNED)
        scale = np.minimum(self.prior_std, 0.1)
        found = least_squares(everything, start, slopes, self.bounds, x_scale=scale, ftol=1e-5, xtol=1e-5)
        return np.asarray(found.x)


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
    fit = _Fit(presses, thickness[0], np.array([START, 0.0, LIKELY_SHARE, 1.0, *np.zeros(len(shape))]), std, model)
    rough = fit.solved(np.array(settings.start) if settings.start else fit.prior)
    fit = replace(fit, presses=_presses(_centred(fit, rough), thickness[0], model, settings))
    blocks = [press.blocks for press in fit.presses]
    misfits = [
        off[: len(press.goal)] * WHITE.white_mm
        for press, off in zip(fit.presses, fit.residuals(rough), strict=True)
    ]
    noise = estimate_noise(blocks, misfits, block_mm=settings.block_mm)
    bowl = settings.bowl_std_per_mm
    again = (whiten(press.blocks, press.depth_mm, noise, bowl_std_per_mm=bowl) for press in fit.presses)
    fit = replace(fit, presses=tuple(again))
    theta, used = fit.solved(rough), {part.view.name for part in blocks}
    left_out = tuple(view.name for view in views if view.name not in used)
    return SurfaceFit(_estimate(fit, theta), theta, model.name, left_out)


def _presses(
    views: Iterable[SurfaceView], thickness_mm: float, model: ProfileModel, settings: SurfaceFitSettings
) -> tuple[Press, ...]:
    """Return the views that show a depth and gel outside the punch, within the model's range."""
    found, (low, high) = [], model.a_over_h_range
    for view in views:
        reach = view.radius_mm + settings.reach * thickness_mm
        blocks = reduce_view(view, block_mm=settings.block_mm, guard_mm=settings.guard_mm, reach_mm=reach)
        if (depth := face_depth(blocks)) > 0 and low <= view.radius_mm / thickness_mm <= high:
            press = whiten(blocks, depth, WHITE, bowl_std_per_mm=settings.bowl_std_per_mm)
            if press.true_depth() <= model.deepest * thickness_mm:
                found.append(press)
    return tuple(found)


def _centred(fit: _Fit, theta: Floats) -> Iterator[SurfaceView]:
    """Move the views to the centre that a first fit gives: near the edge the profile is too curved for one
    step.
    """
    for press, profile in zip(fit.presses, fit.profiles(theta), strict=True):
        view = press.blocks.view
        x, y = np.linalg.lstsq(*fit.system(press, profile, theta[3]), rcond=None)[0][-2:]
        yield replace(view, centre_mm=(view.centre_mm[0] + float(x), view.centre_mm[1] + float(y)))


def _estimate(fit: _Fit, theta: Floats) -> Estimate:
    """Return nu with its interval: the fit's own, widened to the scatter and the model's error."""
    model, now, slopes = fit.model, fit.residuals(theta), fit.slopes(theta)
    information = np.diag(fit.prior_std**-2.0)
    own = [slope.T @ slope for slope in slopes]
    covariance = np.linalg.inv(information + sum(own)).astype(float)
    scores = np.array([slope.T @ part for slope, part in zip(slopes, now, strict=True)])
    other = fit.residuals(theta, 1 + model.relative_error)
    pull = sum(slope.T @ (b - a) for slope, a, b in zip(slopes, now, other, strict=True))
    systematic = float((covariance @ pull)[0])
    depth = np.array([press.true_depth() for press in fit.presses])
    depths = _by_depth(depth, scores)
    groups = (scores, _by_direction(fit.presses, slopes, now), depths)
    shown = max(_clustered(covariance, information, part) for part in groups)
    if len(depths) < MIN_CLUSTERS:  # no scatter shows the model's error at these depths
        systematic = float(np.hypot(systematic, model.single_depth_std / np.sqrt(len(depths))))
    own_nu = np.array([part[0, 0] for part in own])
    systematic = float(np.hypot(systematic, _trend(depth, theta[0] - scores[:, 0] / own_nu, own_nu)))
    value, (least, most) = float(theta[0]), model.poisson_range
    half = float(np.hypot(max(Z95 * np.sqrt(covariance[0, 0]), shown), Z95 * systematic))
    low, high = max(value - half, 0.0), min(value + half, 0.5)
    if high - low > NO_ANSWER_WIDTH:
        return Estimate(None, None, (low, high), "1", "the rise around the punch is below the noise of the maps")
    if not least + AT_END < value < most - AT_END:
        return Estimate(None, None, (low, high), "1", f"the fit lies at the bound of Poisson's ratio, {value:.4f}")
    return Estimate(value, half / Z95, (low, high), "1")


def _by_direction(presses: Sequence[Press], slopes: Sequence[Floats], now: Sequence[Floats]) -> Floats:
    """Return the scores (SECTORS, k) of the blocks that lie in one direction from the punch, over all presses.

    An error of one light is the same in one direction in every press.
    """
    total = np.zeros((SECTORS, slopes[0].shape[1]))
    for press, slope, part in zip(presses, slopes, now, strict=True):
        count, blocks = len(press.goal), press.blocks
        misfit = np.linalg.solve(press.whitener, part[:count])
        scores = (press.whitener.T @ slope[:count]) * misfit[:, None]
        turn = np.arctan2(blocks.y_mm, blocks.x_mm) / (2 * np.pi) % 1.0
        np.add.at(total, np.minimum((SECTORS * turn).astype(int), SECTORS - 1), scores)
    return total


def _trend(depth: Floats, estimates: Floats, weights: Floats) -> float:
    """Return half of nu's change over the depths, as far as it exceeds what noise and scatter give at 95 %.

    The gel has one nu: a change with depth is an error of the profile or the map at unknown depths.
    """
    from scipy.special import stdtrit

    reach = float(np.ptp(depth))
    if len(depth) < MIN_CLUSTERS or reach < SAME_DEPTH * depth.max():
        return 0.0
    away = depth - np.average(depth, weights=weights)
    power = float(weights @ away**2)
    slope = float(weights @ (away * estimates)) / power
    residuals = estimates - np.average(estimates, weights=weights) - slope * away
    scatter = float(weights @ residuals**2) / (len(depth) - 2)  # 1 for noise alone
    chance = float(stdtrit(len(depth) - 2, TAILS95[1])) ** 2 * max(scatter, 1.0) / power
    return 0.5 * reach * float(np.sqrt(max(slope**2 - chance, 0.0)))


def _by_depth(depth: Floats, scores: Floats) -> Floats:
    """Return scores (groups, k) of presses of about one depth: repeats do not reduce a model's error there."""
    order = np.argsort(depth)
    group = np.concatenate([[0], np.cumsum(np.diff(depth[order]) > SAME_DEPTH * depth[order][1:])])
    total = np.zeros((int(group[-1]) + 1, scores.shape[1]))
    np.add.at(total, group, scores[order])
    return total


def _clustered(covariance: Floats, information: Floats, scores: Floats) -> float:
    """Return half of the 95 % interval of nu that the scatter of groups shows; 0 for fewer than four of them."""
    from scipy.special import stdtrit

    count = len(scores)
    if count < MIN_CLUSTERS:
        return 0.0
    meat = scores.T @ scores * count / (count - 1) + information
    spread = covariance @ meat @ covariance
    return float(stdtrit(count - 1, TAILS95[1]) * np.sqrt(spread[0, 0]))
