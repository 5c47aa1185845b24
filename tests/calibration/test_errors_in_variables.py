"""Noise of depth readings bends a curve; a fit of both variables is free of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from scipy.optimize import least_squares

from calibration.effects import EFFECTS
from calibration.fit.depth_noise import with_errors_in_depth
from calibration.fit.least_squares import Fit, fit, linearise
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.noise.model import Noise, Whitener
from tactilevision.records.measured import Floats

TRUTH = np.array([0.2, 0.48, 0.85])
MODEL = Model(FlatPunch())
DEPTH_MM, FORCE_N = 0.012, 0.01  # std of a reading
WHITE = Noise(1.0)


def presses(count: int) -> Observations:
    return stated(observations([np.linspace(0.04, 0.5, 24)] * count, [indenter()] * count))


def stated(data: Observations) -> Observations:
    """The same with its noise stated."""
    std = np.ones(data.size)
    return replace(data, depth_std_mm=DEPTH_MM * std, force_std_N=FORCE_N * std)


def read(true: Observations, rng: np.random.Generator) -> Observations:
    force = MODEL.predict(TRUTH, true) + FORCE_N * rng.standard_normal(true.size)
    return true.shifted(DEPTH_MM * rng.standard_normal(true.size)).with_force(force)


def plain(data: Observations, noise: Noise = WHITE) -> Fit:
    return fit(MODEL, data, noise=noise, tolerances=False)


def test_it_is_the_fit_of_all_true_depths_at_once() -> None:
    """The same minimum with every true depth an unknown of its own, by a solver that knows of no slope."""
    data = read(presses(4), np.random.default_rng(0))
    found = with_errors_in_depth(plain(data))
    mean, std = (getattr(found.parameters[1].prior, name) for name in ("mean", "std"))

    def rows(unknown: Floats) -> Floats:
        values, depth = unknown[:3], unknown[3:]
        force = MODEL.predict(values, data.shifted(depth - data.depth_mm))
        of_depth, of_force = (depth - data.depth_mm) / DEPTH_MM, (force - data.normal_N) / FORCE_N
        return np.concatenate([of_depth, of_force, [(values[1] - mean) / std]])

    begin = np.concatenate([plain(data).values, data.depth_mm])
    whole = least_squares(rows, begin, x_scale=np.concatenate([[0.1, 0.1, 1], np.full(data.size, DEPTH_MM)]))
    moved = np.abs(whole.x[:3] - plain(data).values) / np.sqrt(np.diag(found.covariance))
    apart = np.abs(whole.x[:3] - found.values) / np.sqrt(np.diag(found.covariance))
    assert moved[0] > 0.2  # of a std: there is something to be found
    assert apart.max() < 0.02


def test_it_is_free_of_the_bias_of_the_curves_form() -> None:
    true, rng = presses(12), np.random.default_rng(1)
    off: dict[str, list[Floats]] = {"plain": [], "both": []}
    for _ in range(12):
        one = plain(read(true, rng))
        off["plain"].append((one.values - TRUTH) / TRUTH)
        off["both"].append((with_errors_in_depth(one).values - TRUTH) / TRUTH)
    mean = {name: np.mean(rows, axis=0) for name, rows in off.items()}
    error = {name: np.std(rows, axis=0) / np.sqrt(len(rows)) for name, rows in off.items()}
    assert abs(mean["plain"][0]) > 4 * error["plain"][0]
    assert abs(mean["both"][0]) < 2.5 * error["both"][0]


def test_a_press_of_its_own_is_no_noise_of_a_reading() -> None:
    """What samples bring of an error, as Gauss's rule has it with all covariances written out."""
    data, noise = presses(3), Noise(1.2, gain=0.02, zero_mm=0.01, correlation=0.6, white=0.2)
    about, _ = linearise(MODEL, TRUTH, data=data)
    errors = np.random.default_rng(2).standard_normal(data.size)
    alike = data.press[:, None] == data.press
    lag = np.abs(np.subtract.outer(np.arange(data.size), np.arange(data.size)))
    std = 1.2 * np.hypot(FORCE_N, DEPTH_MM * about.slope_N_per_mm)
    own = np.outer(std, std) * (0.8 * 0.6**lag + 0.2 * (lag == 0)) * alike
    force, slope = about.force_N, about.slope_N_per_mm
    shared = (0.02**2 * np.outer(force, force) + 0.01**2 * np.outer(slope, slope)) * alike
    expected = own @ np.linalg.solve(own + shared, errors)
    assert Whitener(data, noise, about).of_samples(errors) == pytest.approx(expected, abs=1e-9)


def test_the_way_that_a_clock_goes_by_stays_as_it_was_read() -> None:
    """Fast and slow presses with a hold, forces 20 ms late: what a reading is off by moves no neighbour."""
    clock, count, rng = EFFECTS["clock_offset"], 8, np.random.default_rng(2)
    depth = np.concatenate([np.linspace(0.03, 0.4, 15), np.full(6, 0.4), np.linspace(0.38, 0.03, 12)])
    gap = np.where(np.abs(np.diff(depth, prepend=0.0)) > 0, 0.03, 0.1)
    times = [300.0 * k + np.cumsum(gap * (1 + 9 * (k % 2))) for k in range(count)]
    phase = [["load"] * 15 + ["hold"] * 6 + ["unload"] * 12] * count
    true = stated(observations([depth] * count, [indenter()] * count, time_s=times, phase=phase))
    late = (MODEL + clock).predict(np.array([*TRUTH, 0.02]), true)
    read_mm = DEPTH_MM * rng.standard_normal(true.size)
    data = true.shifted(read_mm).with_force(late + FORCE_N * rng.standard_normal(true.size))
    one = fit(MODEL + clock, data, noise=WHITE, tolerances=False)
    both = with_errors_in_depth(one)
    assert both.chi2 < one.chi2 + 1
    assert np.all(np.abs(both.values[:3] - TRUTH) < 2 * np.sqrt(np.diag(both.covariance)[:3]))


def test_points_and_depths_without_a_noise_stay() -> None:
    data = read(presses(4), np.random.default_rng(3))
    exact = replace(data, depth_std_mm=np.zeros(data.size))
    unknown = replace(data, depth_std_mm=np.full(data.size, np.nan), force_std_N=np.full(data.size, np.nan))
    points = data.samples(np.isin(np.arange(data.size), data.first + 20))
    for one in map(plain, (exact, unknown, points)):
        assert with_errors_in_depth(one) is one
    told = plain(replace(unknown, depth_over_force_noise=DEPTH_MM / FORCE_N), Noise(0.05, stated=False))
    same = with_errors_in_depth(plain(data)).values
    assert with_errors_in_depth(told).values[0] == pytest.approx(same[0], rel=2e-3)
