"""Balls tell whether a camera writes light or its root, and what a gentle slope makes of its colours."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.drift import SOFTENING_GREY, Response, response_from_card
from tactilevision.photometric.shading_law import response_of
from tactilevision.records.measured import Floats

LAMPS = np.array([[0.8, 0.1], [-0.5, 0.7], [-0.3, -0.8]])  # of each channel, over its height


def samples(power: float, rng: np.random.Generator) -> tuple[Samples, Floats]:
    """Colours of balls under far lamps, each channel its own, and the untouched picture at them."""
    steep, angle = 0.55 * np.sqrt(rng.random(2000)), rng.uniform(0.0, 2 * np.pi, 2000)
    slopes = steep[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place, level = rng.uniform(-1, 1, (2000, 2)), rng.uniform(60.0, 200.0, (2000, 3))
    light = np.maximum(1.0 - slopes @ LAMPS.T, 0.01) / np.sqrt(1.0 + np.sum(slopes**2, axis=1))[:, None]
    grey = level * light ** (1.0 / power) + rng.normal(0.0, 1.0, level.shape)
    return Samples((grey - level) / (level + SOFTENING_GREY), place, slopes, np.zeros(2000, np.int64)), level


@pytest.mark.parametrize(("power", "taken"), [(1.0, 1), (1.8, 2), (2.2, 2)])
def test_the_power_is_the_one_in_which_light_is_straight_in_slope(power: float, taken: int) -> None:
    contact, level = samples(power, np.random.default_rng(0))
    assert response_of(contact, level).power == taken


def test_answers_are_the_colours_of_gentle_slopes() -> None:
    contact, level = samples(2.0, np.random.default_rng(1))
    found = response_of(contact, level).to_slope(np.array([-0.5, 0.4]), np.array([0.3, -0.2]))
    assert found is not None
    usual = float(np.mean(level / (level + SOFTENING_GREY)))
    assert found == pytest.approx(np.repeat(-0.5 * usual * LAMPS[..., None], 2, axis=2), abs=0.03)


def test_a_card_keeps_the_response() -> None:
    made = response_of(*samples(1.0, np.random.default_rng(2)))
    kept = response_from_card(made.to_card())
    assert kept.power == 1
    assert kept.answers == pytest.approx(made.answers, abs=1e-5)
    assert response_from_card(None) == Response(power=2, answers=None)
    assert response_from_card(Response().to_card()).to_slope(np.zeros(1), np.zeros(1)) is None
