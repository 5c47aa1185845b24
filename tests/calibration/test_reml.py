"""The likelihood of the noise's sizes, also at sizes that a search only passes through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations

from calibration.noise import model as rectangles
from calibration.noise.model import Linear, Noise, Scatter, Whitener
from calibration.noise.reml import Weighing, minus_two_log_likelihood, newton_move, sizes_of, stencil
from tactilevision.records.measured import Floats


@each(
    "sizes, correlation, white",
    [
        ((6, 6, 6), 0.0, 0.0),
        ((6, 3, 5), 0.0, 0.0),
        ((6, 6, 6), 0.6, 0.3),
        ((6, 3, 5), 0.6, 0.0),
        ((1, 6, 4), 0.6, 0.3),
    ],
)
def test_the_likelihood_is_that_of_the_whole_covariance_and_finite_beyond_all_sizes(
    sizes: tuple[int, ...], correlation: float, white: float
) -> None:
    """By hand, V = s^2 R + g^2 f f' + z^2 k k' for each press: ln det V + ln det X'V^-1 X + what is left."""
    rng = np.random.default_rng(3)
    data = observations([np.linspace(0.1, 0.6, n) for n in sizes], [indenter()] * len(sizes))
    force, slope, residual = rng.standard_normal((3, data.size))
    jacobian = rng.standard_normal((data.size, 2))
    alike, about = Noise(0.7, 0.4, 0.9, correlation, white), Linear(force, slope, np.ones(data.size))
    weighing = Weighing(data, about, alike)
    taken = weighing.take(np.column_stack([jacobian, residual]))
    product = weighing.product(taken, taken)
    apart = np.abs(np.subtract.outer(np.arange(data.size), np.arange(data.size)))
    likeness = (1 - white) * correlation**apart + white * (apart == 0)
    whole = 0.7**2 * likeness + 0.4**2 * np.outer(force, force) + 0.9**2 * np.outer(slope, slope)
    whole[data.press[:, None] != data.press] = 0.0
    weighed = np.linalg.solve(whole, np.column_stack([residual, jacobian]))
    information = jacobian.T @ weighed[:, 1:]
    left = residual @ weighed[:, 0] - (jacobian.T @ weighed[:, 0]) @ np.linalg.solve(
        information, jacobian.T @ weighed[:, 0]
    )
    by_hand = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(information)[1] + left
    nothing, beyond = np.zeros((2, 2)), replace(alike, scale=1e-4, gain=1e5, zero_mm=1e5)
    found = minus_two_log_likelihood(sizes_of([alike, beyond]), weighing, product=product, precision=nothing)
    np.testing.assert_allclose(found[0], by_hand, rtol=1e-9)
    assert np.isfinite(found[1])
    white_residual = Whitener(data, alike, about).apply(residual)
    np.testing.assert_allclose(np.sum(white_residual**2), residual @ np.linalg.solve(whole, residual), rtol=1e-9)


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
        likelihood = minus_two_log_likelihood(sizes_of([noise]), weighing, product=product, precision=np.eye(2))
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


def test_a_long_newton_step_leads_downhill_and_keeps_what_is_short_of_it() -> None:
    """Along a narrow valley: shortened size by size it would climb the valley's side."""
    along, across = np.array([3.0, 1.0, 0.0]) / np.sqrt(10), np.array([-1.0, 3.0, 0.0]) / np.sqrt(10)
    hessian = 2 * np.outer(along, along) + 800 * np.outer(across, across) + np.diag([0.0, 0.0, 2.0])
    least = 9 * along + np.array([0.0, 0.0, 0.5])

    def cost(places: Floats) -> Floats:
        return np.asarray(np.einsum("...i,ij,...j->...", places - least, hessian, places - least) / 2)

    move = newton_move(cost(stencil(3)), 3)
    assert cost(np.clip(least, -1, 1)) > cost(np.zeros(3)) > cost(move)
    assert move == pytest.approx(along + np.array([0.0, 0.0, 0.5]))
