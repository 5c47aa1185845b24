"""What a calibration says of its own scale, place by place: exact for a mean, and true of laws fitted anew."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pytest

from tactilevision.photometric import cross_validation
from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.cross_validation import (
    DIRECTIONS,
    PLACES,
    STEEP,
    BallFit,
    coverage_factor,
    extrapolated_std,
    gain_map,
    gain_std,
    gains_of,
    jackknife_std,
    nearest_inside,
    off_inside,
    places,
    scale_uncertainty,
)
from tactilevision.photometric.methods import polynomial
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.records.measured import Floats

BALLS, EACH, STEEPEST, NOISE = 12, 60, 0.6, 0.01
LAMPS = np.array([(0.7, 0.1), (-0.4, 0.6), (-0.3, -0.6)])


def colours(slopes: Floats, place: Floats) -> Floats:
    """The change of colour (N, 3) under three lamps that turn over the picture and shine a little."""
    turn = 0.3 * place[:, :1] * np.array([1.0, -1.0, 0.5])
    straight = slopes @ LAMPS.T + turn * (slopes @ LAMPS[:, ::-1].T) * np.array([1.0, -1.0, 1.0])
    return np.asarray(
        straight + 0.4 * straight**2 * (1.0 + 0.5 * place[:, 1:]) - 0.3 * np.sum(slopes**2, axis=1)[:, None]
    )


def balls(rng: np.random.Generator, numbers: Sequence[int]) -> Samples:
    """Samples under balls in the middle two thirds of the picture."""
    parts = []
    for number in numbers:
        centre = rng.uniform(-0.65, 0.65, 2)
        length, angle = STEEPEST * np.sqrt(rng.uniform(size=EACH)), rng.uniform(0, 2 * np.pi, EACH)
        slopes = (length * np.stack([np.cos(angle), np.sin(angle)])).T
        place = centre - 0.2 * slopes / STEEPEST
        seen = colours(slopes, place) + rng.normal(0.0, NOISE, (EACH, 3)) + rng.normal(0.0, NOISE, 3)
        parts.append((seen, place, slopes, np.full(EACH, number)))
    change, at, slope, press = (np.concatenate(many) for many in zip(*parts, strict=True))
    return Samples(change, at, slope, press, np.full_like(change, NOISE))


def still() -> Samples:
    """Samples of gel at rest."""
    change = np.random.default_rng(0).normal(0.0, NOISE, (500, 3))
    place = np.random.default_rng(1).uniform(-1, 1, (500, 2))
    return Samples(change, place, np.zeros((500, 2)), np.full(500, -1), np.full_like(change, NOISE))


def fitting(contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw:
    return fit_polynomial(contact, untouched_samples, ridge=ridge)


def fitted(samples: Samples) -> ColourLaw:
    return fitting(samples, still(), ridge=1e-3)


def true_gain(law: ColourLaw) -> Floats:
    """How far the law's depth scale is off over the picture, from the light itself."""
    x, y = (2.0 * (np.arange(count) + 0.5) / count - 1.0 for count in PLACES)
    place = np.stack([grid.ravel() for grid in np.meshgrid(x, y)], axis=1)
    off = np.zeros(len(place))
    for steep in STEEPEST * np.array(STEEP):
        for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            slopes = np.tile(steep * np.array([np.cos(angle), np.sin(angle)]), (len(place), 1))
            off += np.sum(law.at(colours(slopes, place), place) * slopes, axis=1) / steep**2 - 1.0
    return off.reshape(PLACES[::-1]) / (DIRECTIONS * len(STEEP))


@lru_cache
def many() -> tuple[Floats, Floats, Floats]:
    """Gains that are true, what a jackknife states, and that as balls bear it out (calibrations, 12, 16)."""
    off, stated, borne = [], [], []
    for seed in range(10):
        samples = balls(np.random.default_rng(seed), range(BALLS))
        made = BallFit(fitting, 1e-3, samples, still())
        stated.append(gain_map(made.law, made.others, contact=samples))
        uncertainty = scale_uncertainty(made)
        borne.append(np.hypot(uncertainty.gain_std, uncertainty.extrapolated_std))
        off.append(true_gain(made.law))
    return np.stack(off), np.stack(stated), np.stack(borne)


@pytest.mark.parametrize("groups", [3, 5, 12])
def test_of_a_mean_it_is_the_deviation_of_a_mean(groups: int) -> None:
    values = np.random.default_rng(2).normal(size=(groups, 60 // groups))
    without = [np.delete(values, k, axis=0).mean() - values.mean() for k in range(groups)]
    means = values.mean(axis=1)
    assert jackknife_std([np.array(one) for one in without]) == pytest.approx(means.std(ddof=1) / np.sqrt(groups))


def test_laws_that_agree_leave_no_doubt() -> None:
    samples = balls(np.random.default_rng(0), range(6))
    law = fitted(samples)
    assert np.abs(gain_map(law, [law, law, law], contact=samples)).max() == 0.0


def test_beyond_the_balls_a_jackknife_is_that_of_the_nearest_place_among_them() -> None:
    values = np.arange(192.0).reshape(PLACES[::-1])
    inside = (np.abs(places()) < 0.5).all(axis=1)
    found = nearest_inside(values, np.where(inside, 0.0, 1.0))
    kept = inside.reshape(values.shape)
    assert (found[kept] == values[kept]).all()
    assert found[0, 0] == values[kept].min()
    assert found[-1, -1] == values[kept].max()


@pytest.mark.slow
@pytest.mark.parametrize("part", [np.s_[4:8, 5:11], np.s_[:, :2], np.s_[:2, :]])
def test_what_is_stated_is_how_calibrations_scatter(part: tuple[slice, slice]) -> None:
    off, _, stated = (maps[:, *part] for maps in many())
    assert 0.5 < 1.4826 * np.median(np.abs(off) / stated) < 1.3


def test_two_thirds_are_off_by_no_more_than_balls_bear_out() -> None:
    off, _, borne = many()
    assert 0.6 < np.mean(np.abs(off) < borne) < 0.8


def test_balls_left_out_say_how_far_to_believe_what_is_stated() -> None:
    off = np.random.default_rng(3).normal(0.0, 0.02, 500)
    assert coverage_factor(off[:0]) == 1.0
    assert 0.6 < coverage_factor(off[:9] / 0.04) < 0.9, "half as far off as stated, but these are nine"
    assert coverage_factor(off / 0.04) == pytest.approx(0.5, abs=0.04)
    assert coverage_factor(off / 0.01) == pytest.approx(2.0, abs=0.15)
    strange = np.concatenate([off, [1.0]])
    assert coverage_factor(strange / 0.04) == pytest.approx(0.5, abs=0.04), "one that is strange moves it little"


def test_balls_beyond_the_others_say_nothing_of_those_among_them() -> None:
    errors, inside = np.array([0.02, -0.03, 0.01, 0.04, 0.5]), np.full(5, 0.02)
    assert off_inside(errors, inside, [0.0] * 4 + [0.3]) == pytest.approx([1.0, 1.5, 0.5, 2.0])
    few = off_inside(errors, inside, [0.0, 0.0, 0.0, 0.06, 0.3])
    assert few == pytest.approx([1.0, 1.5, 0.5, 0.0, 20.0]), "too few among the others: the excess of all"


def test_doubt_beyond_the_balls_leaves_the_deviation_among_them(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = balls(np.random.default_rng(0), range(BALLS))
    made, found = BallFit(fitting, 1e-3, samples, still()), []
    for times in (1.0, 10.0):
        monkeypatch.setattr(
            cross_validation, "extrapolated_std", lambda rate, far, t=times: extrapolated_std(t * rate, far)
        )
        found.append(scale_uncertainty(made))
    assert found[1].gain_std == pytest.approx(found[0].gain_std)
    assert found[1].extrapolated_std.mean() > 2.0 * found[0].extrapolated_std.mean()


def test_each_ball_has_a_law_that_never_saw_it() -> None:
    samples = balls(np.random.default_rng(0), range(BALLS))
    made = BallFit(fitting, 1e-3, samples, still())
    found, uncertainty = made.held_out, scale_uncertainty(made)
    assert sorted(uncertainty.held_out_laws) == list(range(BALLS))
    for number, held in uncertainty.held_out_laws.items():
        at = samples.press == number
        assert found[at] == pytest.approx(held.law.at(samples.change[at], samples.place[at]))
        assert 0.0 < held.std < 0.5
    for number, gain in gains_of(found, samples).items():
        assert abs(gain - 1.0) < 6.0 * np.hypot(uncertainty.held_out_laws[number].std, gain_std(found, samples))


def test_beyond_the_outermost_balls_less_is_known() -> None:
    stated = np.sqrt(np.mean(np.square(many()[2]), axis=0))
    assert stated[:, 0].mean() > 3.0 * stated[4:8, 5:11].mean()


def test_sums_over_samples_are_made_once_for_all_fits() -> None:
    samples, rest, made = balls(np.random.default_rng(0), range(BALLS)), still(), list[int]()
    for ridge in (1e-3, 1e-2):
        scale_uncertainty(BallFit(fitting, ridge, samples, rest))
        made.append(polynomial._sums.cache_info().misses)
    assert made[1] == made[0]
