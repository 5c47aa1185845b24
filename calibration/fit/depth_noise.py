"""Noise of depth readings: its size, and fits corrected for the bias that it causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit, Problem, inverse_information, linearise
from calibration.inputs.checks import clear_of_touch
from calibration.inputs.denoised_depth import nominal_depth, ways
from calibration.inputs.observations import Observations
from calibration.noise.model import Linear, Whitener, depth_share
from tactilevision.records.measured import Floats

# Parameters free of the bias that the noise of depth readings brings: errors in both variables.
#
#     minimise |W (y - f(d*) - f'(d*) (d - d*))|^2,    d* = d + share e/f',    share = (f' std_w)^2 / b^2
#
# e is what the samples' own noise leaves of the residual, b its std, d the depth as read. At depths as read, model
# and residual hold the same noise: slopes come out too flat, and what bends a curve too strong or too weak. d* is
# the depth to which a reading belongs, given its force; effects remember depths as read. Unbiased but for terms of
# second order in the noise of a reading, times the curve's curvature.
# Sources: Britt, Luecke, Technometrics 15 (1973) 233; Fuller, Measurement Error Models, 1987, 3.2.

TURNS = 2  # the second moves E by a hundredth of what the first does


def with_errors_in_depth(fitted: Fit) -> Fit:
    """The same model, data and noise, with the values (p,) and covariance (p, p) of such a fit.

    Of curves whose depth has a part in the noise; any other fit is returned as it is.
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
    """The readings at the depths that they and their forces show, from those of the turn before."""
    given = fitted.data
    about, _ = linearise(fitted.model, values, data=data)
    slope = about.slope_N_per_mm
    left = given.normal_N - about.force_N + slope * data.off_mm
    own = Whitener(data, fitted.noise, about).of_samples(left)
    moving = np.where(slope == 0, np.inf, slope)
    return replace(given, off_mm=depth_share(data, slope) * own / moving)


def _at_depths(fitted: Fit, data: Observations, values: Floats) -> Problem:
    """The problem at these depths; forces carried there along the slope."""
    about, _ = linearise(fitted.model, values, data=data)
    whitener = Whitener(data, fitted.noise, about)
    return Problem(fitted.model, data, fitted.parameters, whitener, about.slope_N_per_mm * data.off_mm)


def _as_read(fitted: Fit, values: Floats, jacobian: Floats) -> Fit:
    """The fit with these values, its residual at depths as read; `jacobian` (n, f) of what was minimised."""
    about, _ = linearise(fitted.model, values, data=fitted.data)
    problem = _at_depths(fitted, fitted.data, values)
    rows = problem.residual(values[problem.free])
    covariance = np.zeros((values.size,) * 2)
    covariance[np.ix_(problem.free, problem.free)] = inverse_information(jacobian)
    residual = fitted.data.normal_N - about.force_N
    found = replace(fitted, values=values, covariance=covariance, jacobian=problem.jacobian(values), about=about)
    white, chi2 = -rows[: fitted.data.size], float(rows @ rows)
    return replace(found, force_N=about.force_N, residual_N=residual, white=white, chi2=chi2)


# How much of a sample's noise is the depth's, where nobody stated it: from neighbours that differ.
#
#     q_i = (r_{i-1} - 2 r_i + r_{i+1})^2 / 6,    E q_i = v (1 + (t s_i)^2),    s = df/dw
#
# r the residual, neighbours of one press and one way; and (r - r')^2 / 2 of the first samples of presses that
# follow each other, where they begin in air: from few presses' slopes in the gel alone a force's noise is an
# extrapolation. A force's noise is as large on a soft punch as on a stiff one, a depth's is carried over by the
# slope. t (mm/N), a depth's std over a force's, is the likeliest on a grid, and 0 unless it brings what a number
# costs. Linear in the noise; a law that bends over three samples would add to q. Source: von Neumann, Ann. Math.
# Stat. 12 (1941) 367; Schwarz, Ann. Stat. 6 (1978) 461.

RATIOS = np.geomspace(0.1, 30.0, 30)  # times 1 over the median slope: which of the two is the larger
TIMES = np.geomspace(1.0, 100.0, 40)  # a stated depth's std, that are tried
FAR_MORE = 2.0  # times it: below, neighbours that are alike and heavy tails do as much
MIN_SAMPLES = 60  # differences; fewer cannot tell the two


def with_sample_noise(fitted: Fit) -> Observations:
    """The data with the depth's share of the noise, where that was not stated and shows."""
    data = fitted.data
    stated_depth, stated_force = (np.isfinite(one).all() for one in (data.depth_std_mm, data.force_std_N))
    if stated_depth or not data.is_curves:
        return data
    ratio = depth_over_force(fitted)
    if not stated_force:
        return replace(data, depth_over_force_noise=ratio)
    return replace(data, depth_std_mm=ratio * data.force_std_N) if ratio else data


def clear_of_own_touch(fitted: Fit, data: Observations) -> Observations:
    """`data` of a fit without samples that its own zeros and readings' noise leave on neither side of the touch.

    A depth's own noise is that of the fit at its middle slope, shared as in `data`.
    """
    ratio, slopes = data.depth_over_force_noise, np.abs(fitted.about.slope_N_per_mm)
    share = fitted.noise.scale / np.hypot(1.0, ratio * float(np.median(slopes)))
    steepest = np.maximum.reduceat(slopes, fitted.data.first)[fitted.data.press]
    return clear_of_touch(
        data,
        zero_mm=fitted.noise.zero_mm,
        noise_mm=float(ratio * share),
        force_noise_mm=share * np.min(fitted.about.base_N) / np.maximum(steepest, 1e-12),
    )


def depth_over_force(fitted: Fit) -> float:
    """t of the equation above, mm/N; 0 where it does not show."""
    squares, slope = _differences(fitted)
    if squares.size < MIN_SAMPLES or not np.median(slope) > 0:
        return 0.0
    ratios = np.concatenate([[0.0], RATIOS / float(np.median(slope))])
    shapes = 1 + np.outer(ratios, slope) ** 2
    costs = squares.size * np.log(np.mean(squares / shapes, axis=1)) + np.sum(np.log(shapes), axis=1)
    best = int(np.argmin(costs))
    return float(ratios[best]) if costs[0] - costs[best] > 2 * np.log(squares.size) else 0.0


def depth_beyond_stated(fitted: Fit) -> float | None:
    """How many times as much depths scatter as was stated of them, from the same differences; None below twice,
    and where slopes that are alike, or few samples, leave it open.

    -2 ln L = sum [ln(v + (d s_i)^2) + q_i/(v + (d s_i)^2)], the force's variance v free, of depths' std d.
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
    """q (n,) and the slope (n,) at its middle."""
    data, residual = fitted.data, fitted.residual_N
    kind = ways(data) + 10 * data.press
    alike = (kind[:-2] == kind[1:-1]) & (kind[2:] == kind[1:-1])
    squares = (residual[:-2] - 2 * residual[1:-1] + residual[2:]) ** 2 / 6
    slope = np.abs(fitted.about.slope_N_per_mm[1:-1])
    in_air = np.diff(_begun_in_air(fitted)) ** 2 / 2
    return np.concatenate([squares[alike], in_air]), np.concatenate([slope[alike], np.zeros(in_air.size)])


def _begun_in_air(fitted: Fit) -> Floats:
    """Residual of the first sample of each press that begins clear of the gel, in the order of time."""
    data, first = fitted.data, fitted.data.first
    clear = first[(fitted.about.slope_N_per_mm[first] == 0) & (data.depth_mm[first] < 0)]
    return np.asarray(fitted.residual_N[clear[np.argsort(data.time_s[clear])]])


# A fit as it would stand at depths without their readings' noise.
#
# A direction, or a press's own gain, at depths as read is off by just the noise that the residual holds: what it
# is compared with. Seen from steady depths the two have nothing in common.


def at_denoised_depth(fitted: Fit) -> Fit:
    """The same values and the same residual; model, derivatives and forces at the nominal depths."""
    data = fitted.data.shifted(nominal_depth(fitted.data) - fitted.data.depth_mm)
    force = fitted.model.predict(fitted.values, data)
    about = Linear(force, fitted.model.slope(fitted.values, data), fitted.about.base_N)
    data = data.with_force(force + fitted.residual_N)
    problem = Problem(fitted.model, data, fitted.parameters, Whitener(data, fitted.noise, about))
    return replace(fitted, data=data, force_N=force, about=about, jacobian=problem.jacobian(fitted.values))
