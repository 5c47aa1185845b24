"""Noise of depth readings: its size, and fits corrected for the bias that it causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit, Minimum, Problem, finish, linearise
from calibration.inputs.checks import clear_of_touch
from calibration.inputs.denoised_depth import nominal_depth, ways
from calibration.inputs.observations import Observations
from calibration.noise.model import Linear, Whitener, depth_share
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats

TURNS = 2  # iterations: the second changes E by a hundredth of the first


def with_errors_in_depth(fitted: Fit) -> Fit:
    """Return the fit with its parameters corrected for the bias by noise of depth readings (errors in variables).

        minimise |W (y - f(d*) - f'(d*) (d - d*))|^2,    d* = d + share e/f',    share = (f' std_w)^2 / b^2

    e is the samples' part of the residual, b its std, d the depth as read and d* the likeliest true depth given
    the force. At depths as read model and residual share noise, which flattens slopes and biases curvature.
    Effects of history still use depths as read. Unbiased up to second order in the noise times the curvature. A
    fit to points, or one whose depth has no part in the noise, is returned unchanged. Sources: Britt, Luecke,
    Technometrics 15 (1973) 233; Fuller, Measurement Error Models, 1987, 3.2.
    """
    if not (fitted.data.is_curves and depth_share(fitted.data, fitted.about.slope_N_per_mm).any()):
        return fitted
    problem, values = _at_depths(fitted, fitted.data, fitted.values), fitted.values
    for _ in range(TURNS):
        problem = _at_depths(fitted, _true_depth(fitted, problem.data, values), values)
        found = problem.solve(values[None])
        values = problem.full(found.values)
    return _as_read(fitted, values, found.jacobian)


def _true_depth(fitted: Fit, data: Observations, values: Floats) -> Observations:
    """Return the readings at their likeliest depths, given those of the iteration before."""
    about, _ = linearise(fitted.model, values, data=data)
    slope = about.slope_N_per_mm
    residual = fitted.data.normal_N - about.force_N + slope * data.off_mm
    own = Whitener(data, fitted.noise, about).of_samples(residual)
    return replace(fitted.data, off_mm=depth_share(data, slope) * own / np.where(slope == 0, np.inf, slope))


def _at_depths(fitted: Fit, data: Observations, values: Floats) -> Problem:
    """Return the problem at these depths, with forces shifted there along the slope."""
    about, _ = linearise(fitted.model, values, data=data)
    whitener = Whitener(data, fitted.noise, about)
    return Problem(fitted.model, data, fitted.parameters, whitener, about.slope_N_per_mm * data.off_mm)


def _as_read(fitted: Fit, values: Floats, jacobian: Floats) -> Fit:
    """Return the fit with these values and its residual at depths as read; `jacobian` (n, f) of the minimum."""
    about, _ = linearise(fitted.model, values, data=fitted.data)
    problem = _at_depths(fitted, fitted.data, values)
    free_values = values[problem.free]
    there = Minimum(free_values, problem.residual(free_values), jacobian, fitted.at_bound[problem.free])
    return replace(finish(problem, there, fitted.noise, about), warnings=fitted.warnings)


RATIOS = np.geomspace(0.1, 30, 30)  # depth's over force's std, tried, in units of 1 over the median slope
TIMES = np.geomspace(1, 100, 40)  # depth's std over the stated one, tried
FAR_MORE = 2.0  # times the stated one: below, correlation and heavy tails explain as much
MIN_SAMPLES = 60  # differences that determine a ratio


def with_sample_noise(fitted: Fit) -> Observations:
    """Return the data with the depth's share of the noise, where it was not stated and is significant."""
    data = fitted.data
    if np.isfinite(data.depth_std_mm).all() or not data.is_curves:
        return data
    ratio = depth_over_force(fitted)
    if not np.isfinite(data.force_std_N).all():
        return replace(data, depth_over_force_noise=ratio)
    return replace(data, depth_std_mm=ratio * data.force_std_N) if ratio else data


def clear_of_own_touch(fitted: Fit, data: Observations) -> Observations:
    """Return `data` without samples that the fit's zeros and noise put on neither side of the touch.

    The depth's noise is the fit's at the median slope, with the share of `data`.
    """
    ratio, slopes = data.depth_over_force_noise, np.abs(fitted.about.slope_N_per_mm)
    share = fitted.noise.scale / np.hypot(1.0, ratio * float(np.median(slopes)))
    steepest = np.maximum.reduceat(slopes, fitted.data.first)[fitted.data.press]
    return clear_of_touch(
        data,
        zero_mm=fitted.noise.zero_mm,
        noise_mm=float(ratio * share),
        force_noise_mm=share * np.min(fitted.about.base_N) / np.maximum(steepest, TINY),
    )


def depth_over_force(fitted: Fit) -> float:
    """Return a depth's std over a force's, t in mm/N, from differences of neighbours; 0 where not significant.

        q_i = (r_{i-1} - 2 r_i + r_{i+1})^2 / 6,    E q_i = v (1 + (t s_i)^2),    s = df/dw

    r is the residual of neighbours in one press and branch; (r - r')^2 / 2 of the first samples of successive
    presses is added where they begin in air, since the slopes of few presses do not determine the force's noise. t
    is the likeliest of a grid, by the Schwarz criterion. A law that curves over three samples would add to q.
    Sources: von Neumann, Ann. Math. Stat. 12 (1941) 367; Schwarz, Ann. Stat. 6 (1978) 461.
    """
    squares, slope = _differences(fitted)
    if squares.size < MIN_SAMPLES or not np.median(slope) > 0:
        return 0.0
    ratios = np.concatenate([[0.0], RATIOS / float(np.median(slope))])
    shapes = 1 + np.outer(ratios, slope) ** 2
    costs = squares.size * np.log(np.mean(squares / shapes, axis=1)) + np.sum(np.log(shapes), axis=1)
    best = int(np.argmin(costs))
    return float(ratios[best]) if costs[0] - costs[best] > 2 * np.log(squares.size) else 0.0


def depth_beyond_stated(fitted: Fit) -> float | None:
    """Return the depth's std over the stated one, from the same differences; None unless significant and above 2.

    -2 ln L = sum [ln(v + (d s_i)^2) + q_i/(v + (d s_i)^2)],    d the depth's std, v the force's variance, free
    """
    data = fitted.data
    if not (data.is_curves and np.isfinite(data.depth_std_mm).all() and (data.depth_std_mm > 0).all()):
        return None
    squares, slope = _differences(fitted)
    if squares.size < MIN_SAMPLES:
        return None
    variances = np.mean(squares) * np.geomspace(1e-3, 2.0, 40)[:, None]

    def cost(times: float) -> float:
        expected = variances + (times * float(np.median(data.depth_std_mm)) * slope) ** 2
        return float(np.min(np.sum(np.log(expected) + squares / expected, axis=1)))

    best = min(TIMES, key=cost)
    return float(best) if best > FAR_MORE and cost(1.0) - cost(best) > 2 * np.log(squares.size) else None


def _differences(fitted: Fit) -> tuple[Floats, Floats]:
    """Return q (n,) and the slope (n,) at its middle."""
    data, residual = fitted.data, fitted.residual_N
    kind = ways(data) + 10 * data.press
    alike = (kind[:-2] == kind[1:-1]) & (kind[2:] == kind[1:-1])
    squares = (residual[:-2] - 2 * residual[1:-1] + residual[2:]) ** 2 / 6
    slope = np.abs(fitted.about.slope_N_per_mm[1:-1])
    in_air = np.diff(_begun_in_air(fitted)) ** 2 / 2
    return np.concatenate([squares[alike], in_air]), np.concatenate([slope[alike], np.zeros(in_air.size)])


def _begun_in_air(fitted: Fit) -> Floats:
    """Return the residual of the first sample of each press that begins clear of the gel, in order of time."""
    data, first = fitted.data, fitted.data.first
    clear = first[(fitted.about.slope_N_per_mm[first] == 0) & (data.depth_mm[first] < 0)]
    return np.asarray(fitted.residual_N[clear[np.argsort(data.time_s[clear])]])


def at_denoised_depth(fitted: Fit) -> Fit:
    """Return the fit with its model, derivatives and forces at depths without noise; same values, same residual.

    At depths as read the derivatives share their noise with the residual that they are compared with.
    """
    data = fitted.data.shifted(nominal_depth(fitted.data) - fitted.data.depth_mm)
    force = fitted.model.predict(fitted.values, data)
    about = Linear(force, fitted.model.slope(fitted.values, data), fitted.about.base_N)
    data = data.with_force(force + fitted.residual_N)
    moved = replace(fitted, data=data, force_N=force, about=about)
    return replace(moved, jacobian=moved.problem.jacobian(fitted.values))
