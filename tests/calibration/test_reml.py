"""The likelihood of the noise's sizes, also at sizes that a search only passes through."""

from __future__ import annotations

import numpy as np

from calibration.reml import Grams, minus_two_log_likelihood


def test_the_likelihood_is_that_of_the_whole_covariance_and_finite_beyond_all_sizes() -> None:
    """By hand, V = s^2 1 + g^2 f f' + z^2 k k' for each press: ln det V + ln det X'V^-1 X + what is left."""
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((3, 6, 5))  # presses, samples, (force, slope, residual, two parameters)
    grams = Grams(np.einsum("mti,mtj->mij", columns, columns), np.full(3, 6.0), 2, np.zeros((2, 2)), 0.0)
    logs = np.log([0.7, 0.4, 0.9])
    whole = np.zeros((18, 18))
    for m, (force, slope) in enumerate(columns[:, :, :2].transpose(0, 2, 1)):
        part = slice(6 * m, 6 * m + 6)
        whole[part, part] = 0.7**2 * np.eye(6) + 0.4**2 * np.outer(force, force) + 0.9**2 * np.outer(slope, slope)
    residual, jacobian = columns[:, :, 2].ravel(), columns[:, :, 3:].reshape(18, 2)
    weighed = np.linalg.solve(whole, np.column_stack([residual, jacobian]))
    information = jacobian.T @ weighed[:, 1:]
    left = residual @ weighed[:, 0] - (jacobian.T @ weighed[:, 0]) @ np.linalg.solve(
        information, jacobian.T @ weighed[:, 0]
    )
    by_hand = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(information)[1] + left
    np.testing.assert_allclose(minus_two_log_likelihood(logs, grams, shared=True), by_hand, rtol=1e-9)
    assert np.isfinite(minus_two_log_likelihood(np.array([-9.0, 12.0, 12.0]), grams, shared=True))
