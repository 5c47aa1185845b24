"""The broken stick: planted onsets are found, with an honest uncertainty, and none where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each

from tactilevision.contact.bevel import Growth, find_onset, picture_signal, strip_places
from tactilevision.records.measured import Floats


def trace(
    rng: np.random.Generator, *, share: float, over_mm: float, noise_mm: float = 0.001
) -> tuple[Floats, Floats]:
    """Depth and signal of a press that touches at .15 mm, 30 frames a second at .2 mm/s and a hold."""
    time = np.arange(0, (0.15 + over_mm) / 0.2 + 0.5, 1 / 30) + rng.uniform(0, 1 / 30)
    x = np.minimum(0.2 * time, 0.15 + over_mm)
    y = 0.002 + 0.03 * x + 0.8 * Growth(share, 0.025)(x - 0.15) + noise_mm * rng.standard_normal(x.size)
    return x, y


@each("share, over_mm", [(1.0, 0.02), (1.0, 0.06), (0.7, 0.07), (0.0, 0.07)])
def test_onset_within_a_frame_and_within_its_std(share: float, over_mm: float) -> None:
    errors, sigmas = [], []
    for seed in range(40):
        found = find_onset(
            *trace(np.random.default_rng(seed), share=share, over_mm=over_mm), growth=Growth(share, 0.025)
        )
        assert found is not None
        assert found.gain > 25
        errors.append(found.at - 0.15)
        sigmas.append(errors[-1] / found.std)
    assert np.sqrt(np.mean(np.square(errors))) < 0.2 / 30
    assert 0.5 < np.sqrt(np.mean(np.square(sigmas))) < 1.5


def test_no_onset_is_not_made_up() -> None:
    for seed in range(60):
        x, y = trace(np.random.default_rng(seed), share=1.0, over_mm=0.0)
        found = find_onset(x, y)
        assert found is None or found.gain < 25


def test_a_smooth_asymmetry_is_no_onset() -> None:
    rng = np.random.default_rng(0)
    x = np.linspace(0, 0.4, 60)
    found = find_onset(x, 0.05 * x + 0.01 * x**2 + 0.0005 * rng.standard_normal(60))
    assert found is None or found.gain < 25


def test_what_other_presses_say_sharpens_a_short_overtravel() -> None:
    alone, told = [], []
    for seed in range(30):
        x, y = trace(np.random.default_rng(seed), share=1.0, over_mm=0.02, noise_mm=0.003)
        first, second = find_onset(x, y), find_onset(x, y, amplitude=(0.8, 0.05))
        assert first is not None
        assert second is not None
        alone.append(first.at - 0.15)
        told.append(second.at - 0.15)
    assert np.std(told) < np.std(alone)


def test_wild_and_missing_readings_do_not_move_it() -> None:
    x, y = trace(np.random.default_rng(1), share=1.0, over_mm=0.06)
    reference = find_onset(x, y)
    y[4], y[9] = 0.5, np.nan
    spoilt = find_onset(x, y)
    assert reference is not None
    assert spoilt is not None
    assert spoilt.at == pytest.approx(reference.at, abs=0.004)


def test_too_few_readings_say_nothing() -> None:
    assert find_onset(np.linspace(0, 1, 5), np.zeros(5)) is None


def test_a_touch_in_the_picture_lies_where_it_does_wherever_it_was_put_first() -> None:
    """Places change as the dent reaches them; a gentle press, few frames before it, put 0, 8 and 14 um late."""
    rng, growth = np.random.default_rng(8), Growth(0.3, 0.026)
    depth = np.concatenate([[0.01, 0.07, 0.12, 0.13, 0.137, 0.139], 0.14 + np.geomspace(0.002, 0.17, 12)])
    s, gains = strip_places(8.0), np.array([1.0, -0.6, 0.3])
    reached_mm = 0.03 * np.abs(s - 5.0)  # of depth, after the touch
    grown = growth(depth[:, None] - 0.14 - reached_mm) * np.exp(-(((s - 5.0) / 0.4) ** 2))
    colours = 100 + 5 * depth[:, None, None] + 300 * grown[..., None] * gains
    colours += 0.05 * rng.standard_normal(colours.shape)
    plain = find_onset(depth, growth(depth - 0.14), growth=growth)
    assert plain is not None
    places = []
    for first_mm in (0.14, 0.148, 0.154):
        first = replace(plain, at=first_mm, std=0.006)
        signal = picture_signal(colours, s, depth_mm=depth, distance_mm=5.0, onset=first)
        assert signal is not None
        found = find_onset(depth, signal, growth=growth)
        assert found is not None
        places.append(found.at)
    assert np.ptp(places) < 0.001
    assert places[0] == pytest.approx(0.142, abs=0.003), "the places in the middle begin at .14"
