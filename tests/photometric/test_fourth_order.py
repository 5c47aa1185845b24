"""Products of four colours: told as the sum says, fitted where the light asks for them, and left out elsewhere."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.cross_validation import BallFit
from tactilevision.photometric.methods.polynomial import (
    POWERS,
    AutoMethod,
    Polynomial,
    fit_fourth_order,
    fit_polynomial,
)
from tactilevision.records.measured import Floats

PICKS = [pick for n in (1, 2, 3, 4) for pick in combinations_with_replacement((0, 1, 2), n)]
BALLS, PER_BALL = 12, 250
SOFT = 0.08  # of slope: over which a lamp's light fades
AZIMUTHS = np.radians([20.0, 140.0, 260.0])


def drawn(order: int, rng: np.random.Generator) -> Floats:
    """Coefficients (2, 34, 21) of products of `order` colours at most, of first order in place at most."""
    coefficients = np.zeros((2, len(PICKS), len(POWERS)))
    for k, pick in enumerate(PICKS):
        for m, power in enumerate(POWERS):
            if len(pick) <= order and sum(power) <= 1:
                coefficients[:, k, m] = rng.normal(0, 0.3, 2)
    return coefficients


@pytest.mark.parametrize("order", [3, 4])
def test_it_is_the_sum_that_is_written_down(order: int) -> None:
    rng = np.random.default_rng(order)
    coefficients = drawn(order, rng)
    law = Polynomial(coefficients, 50.0)
    assert law.fourth == (order == 4)
    change = rng.normal(0, 0.5, (3, 4, 7)).astype(np.float32)
    found = np.stack(law.evaluator((4, 7))(change))
    for row in range(4):
        for column in range(7):
            x, y, u = 2 * column / 6 - 1, 2 * row / 3 - 1, change[:, row, column].astype(float)
            expected = sum(
                coefficients[:, k, m] * np.prod(u[list(pick)]) * x**i * y**j
                for k, pick in enumerate(PICKS)
                for m, (i, j) in enumerate(POWERS)
            )
            np.testing.assert_allclose(found[:, row, column], expected, atol=3e-5)
            at = law.at(u[None], np.array([[x, y]]))[0]
            np.testing.assert_allclose(at, expected, atol=1e-9)


def under_balls(dark: float, rng: np.random.Generator) -> Samples:
    """Samples under balls, lit by three lamps, which fade softly to nothing where gel turns from one by `dark`."""
    parts = []
    for ball in range(BALLS):
        slope, angle = 0.6 * np.sqrt(rng.random(PER_BALL)), rng.uniform(0, 2 * np.pi, PER_BALL)
        slopes = np.stack([slope * np.cos(angle), slope * np.sin(angle)], axis=1)
        place = np.tile(rng.uniform(-0.7, 0.7, 2), (PER_BALL, 1)) + rng.normal(0, 0.05, (PER_BALL, 2))
        towards = slopes @ np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)])
        light = np.logaddexp(0.0, (towards + dark) / SOFT) / np.logaddexp(0.0, dark / SOFT)
        change = light - 1.0 + rng.normal(0, 0.005, light.shape)
        parts.append((change, place, slopes, np.full(PER_BALL, ball)))
    change, place, slopes, press = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Samples(change, place, slopes, press)


def at_rest(rng: np.random.Generator) -> Samples:
    count = 500
    zero = np.zeros((count, 2))
    return Samples(
        rng.normal(0, 0.005, (count, 3)), rng.uniform(-1, 1, (count, 2)), zero, np.arange(count) % BALLS
    )


def off(fit: object, contact: Samples, rest: Samples) -> float:
    return BallFit(fit, 1e-2, contact, rest).error  # type: ignore[arg-type]


def test_lamps_that_gel_turns_away_from_ask_for_it() -> None:
    rng = np.random.default_rng(7)
    contact, rest = under_balls(0.3, rng), at_rest(rng)
    assert off(fit_fourth_order, contact, rest) < 0.9 * off(fit_polynomial, contact, rest)


def test_balls_left_out_may_choose_it() -> None:
    fitters = [fit for fit, _ in AutoMethod.ways]
    assert fitters.count(fit_fourth_order) == fitters.count(fit_polynomial) > 0
