"""The likelihood of the noise's sizes, also at sizes that a search only passes through."""

from __future__ import annotations

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.noise import rectangles
from calibration.noise.heteroscedasticity import Scatter
from calibration.noise.inner_products import Weighing
from calibration.noise.model import Linear, Noise, Whitener
from calibration.noise.reml import minus_two_log_likelihood
from tactilevision.records import Floats


def test_the_likelihood_is_that_of_the_whole_covariance_and_finite_beyond_all_sizes() -> None:
    """By hand, V = s^2 1 + g^2 f f' + z^2 k k' for each press: ln det V + ln det X'V^-1 X + what is left."""
    rng = np.random.default_rng(3)
    data = observations([np.linspace(0.1, 0.6, 6)] * 3, [indenter()] * 3)
    force, slope, residual = rng.standard_normal((3, 18))
    jacobian = rng.standard_normal((18, 2))
    weighing = Weighing(data, Linear(force, slope, np.ones(18)), Noise(1.0))
    taken = weighing.take(np.column_stack([residual, jacobian]))
    product = weighing.product(taken, taken)
    whole = np.zeros((18, 18))
    for m in range(3):
        part = slice(6 * m, 6 * m + 6)
        whole[part, part] = (
            0.7**2 * np.eye(6)
            + 0.4**2 * np.outer(force[part], force[part])
            + 0.9**2 * np.outer(slope[part], slope[part])
        )
    weighed = np.linalg.solve(whole, np.column_stack([residual, jacobian]))
    information = jacobian.T @ weighed[:, 1:]
    left = residual @ weighed[:, 0] - (jacobian.T @ weighed[:, 0]) @ np.linalg.solve(
        information, jacobian.T @ weighed[:, 0]
    )
    manual_checks = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(information)[1] + left
    nothing, beyond = np.zeros((2, 2)), Noise(1e-4, 1e5, 1e5)
    found = minus_two_log_likelihood([Noise(0.7, 0.4, 0.9), beyond], weighing, product=product, precision=nothing)
    np.testing.assert_allclose(found[0], manual_checks, rtol=1e-9)
    assert np.isfinite(found[1])


SIZES = (3, 40, 1, 7, 41)  # samples of presses: much of one rectangle would be padding


def test_presses_of_all_lengths_weigh_the_same_in_one_rectangle_or_in_several(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def weighed() -> list[Floats]:
        data = observations([np.linspace(0.1, 0.6, n) for n in SIZES], [indenter()] * len(SIZES))
        rng = np.random.default_rng(4)
        force, slope, *columns = rng.standard_normal((5, data.size))
        noise, about = Noise(0.7, 0.4, 0.9), Linear(force, slope, np.ones(data.size))
        whitener, weighing = Whitener(data, noise, about), Weighing(data, about, noise)
        taken, table = weighing.take(np.array(columns).T), np.array(columns).T
        np.testing.assert_allclose(whitener.apply(whitener.colour(table)), table, rtol=1e-9, atol=1e-12)
        product = weighing.product(taken, taken)
        likelihood = minus_two_log_likelihood([noise], weighing, product=product, precision=np.eye(2))
        return [
            whitener.apply(table),
            weighing.squares(taken).under(noise),
            likelihood,
            Scatter(data).differences(force),
        ]

    one = weighed()
    monkeypatch.setattr(rectangles, "ROOMY", 0)
    for got, wanted in zip(weighed(), one, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-9)


def test_one_long_press_does_not_pad_all_others() -> None:
    sizes = [200_000, *[50] * 30]
    data = observations([np.linspace(0.1, 0.6, n) for n in sizes], [indenter()] * len(sizes))
    parts = rectangles.rectangles(data)
    assert sum(part.rows.size for part in parts) <= rectangles.MOST_PADDED * data.size
    samples = np.concatenate([part.rows[part.real] for part in parts])
    assert np.array_equal(np.sort(samples), np.arange(data.size))
