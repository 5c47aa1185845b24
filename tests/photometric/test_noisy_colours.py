"""Noise in colours must not flatten slopes, and the light's law must fill in where balls say little."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.methods.polynomial import InverseShading, Polynomial, fit_polynomial

LIGHTS = np.array([[1.0, -0.4, -0.5], [0.1, 0.8, -0.7]])  # x, y by channel


def samples(noise: float, *, places: float = 1.0, steepest: float = 0.4) -> Samples:
    """Gel under one far light a channel: 1 + u is (1 - p.l)/sqrt(1 + p^2), everywhere alike."""
    rng = np.random.default_rng(3)
    slopes = rng.uniform(-steepest, steepest, (6000, 2))
    place = rng.uniform(-places, places, (6000, 2))
    change = (1.0 + slopes @ LIGHTS) / np.sqrt(1.0 + np.sum(slopes**2, axis=1))[:, None] - 1.0
    seen = Samples(change + rng.normal(0.0, noise, change.shape), place, slopes, np.arange(6000) % 9)
    return dataclasses.replace(seen, noise=np.full_like(change, noise))


def resting(noise: float) -> Samples:
    seen = samples(noise, steepest=0.0)
    return dataclasses.replace(seen, slopes=np.zeros_like(seen.slopes))


def gain(law: Polynomial, of: Samples) -> float:
    return float(np.sum(law.at(of.change, of.place) * of.slopes) / np.sum(of.slopes**2))


@pytest.mark.parametrize("noise", [0.02, 0.06])
def test_the_mean_over_noisy_pixels_is_the_slope(noise: float) -> None:
    seen = samples(noise)
    plain = fit_polynomial(dataclasses.replace(seen, noise=None), resting(noise), ridge=1e-2)
    assert gain(fit_polynomial(seen, resting(noise), ridge=1e-2), seen) == pytest.approx(1.0, abs=0.006)
    assert gain(plain, seen) < 1.0 - 5.0 * noise**2


def test_without_noise_nothing_is_taken_off() -> None:
    seen, still = samples(0.0), resting(0.0)
    known = fit_polynomial(dataclasses.replace(seen, noise=None), still, ridge=1e-3)
    assert np.allclose(fit_polynomial(seen, still, ridge=1e-3).coefficients, known.coefficients)


def test_the_lights_law_goes_on_where_no_ball_was_pressed() -> None:
    seen, still, everywhere = samples(0.01, places=0.4), resting(0.01), samples(0.0)
    through = gain(InverseShading(1e-3, 0.1)(seen, still, ridge=1e-6), everywhere)
    assert through == pytest.approx(1.0, abs=0.01)


def test_noise_is_looked_up_at_the_place_of_each_sample() -> None:
    planes = np.arange(3 * 4 * 5, dtype=np.float32).reshape(3, 4, 5)
    corners = Samples(
        np.zeros((2, 3)), np.array([[-1.0, -1.0], [1.0, 0.34]]), np.zeros((2, 2)), np.zeros(2, np.int64)
    )
    noise = corners.with_noise(planes).noise
    assert noise is not None
    assert noise.tolist() == [planes[:, 0, 0].tolist(), planes[:, 2, 4].tolist()]
