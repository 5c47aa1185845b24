"""The likelihood of the noise's sizes, also at sizes that a search only passes through."""

from __future__ import annotations

import numpy as np
from made_presses import indenter, observations

from calibration.noise.inner_products import Weighing
from calibration.noise.model import Linear, Noise
from calibration.noise.reml import minus_two_log_likelihood


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
