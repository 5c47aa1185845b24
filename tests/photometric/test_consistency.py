"""Ball presses that speak against themselves are named, before a plausible map is made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from each import each
from lamp_room import BALL_MM, MM_PER_PX, ball, ball_pictures, flat, picture, presses

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import unfit
from tactilevision.photometric.ball_consistency import (
    contact_in_reference,
    contradicting_radii,
    label_warnings,
    odd_balls,
    pressed_reference,
    scale_warnings,
    shared_contact,
)
from tactilevision.photometric.ball_detection import Ball, find_ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes, Floats

SIDES = (MM_PER_PX, MM_PER_PX)


def calibrated(pictures: list[BallPicture], *, reference: Bytes | None = None) -> Calibration:
    untouched = make_reference([flat(np.random.default_rng(1)) if reference is None else reference])
    return calibrate_from_balls(untouched, pictures, mm_per_px=SIDES, fit=PHOTOMETRIC["polynomial"])


@pytest.mark.parametrize("stated_mm", [0.8 * BALL_MM, pytest.param(1.5 * BALL_MM, marks=pytest.mark.slow)])
def test_radii_that_contradict_each_other_are_named(stated_mm: float) -> None:
    pictures = [
        dataclasses.replace(shot, radius_mm=stated_mm) if number % 2 else shot
        for number, shot in enumerate(ball_pictures(16, np.random.default_rng(2)))
    ]
    warnings = calibrated(pictures).warnings
    assert any("radii contradict each other" in warning for warning in warnings)


@pytest.mark.parametrize(("implied_mm", "swapped"), [(16 / 6, True), (4.0, False)])
def test_radii_that_are_swapped_are_named_so(implied_mm: float, swapped: bool) -> None:
    """Stated 4 and 6; by the law of the others those stated as 6 are of 2.67 where both are the other's."""
    stated = dict(enumerate([4.0, 6.0] * 4))
    wrong = 6.0 / implied_mm
    (warning,) = contradicting_radii(
        stated,
        lambda group, steeper: {n: wrong if stated[n] > 5 and not steeper else 1.0 for n in group},
    )
    assert ("4 look swapped" in warning) == swapped


@pytest.mark.parametrize(
    ("wrong", "law_std", "named"), [(1.13, 0.01, True), (1.13, 0.06, False), (1.6, 0.06, True)]
)
def test_radii_contradict_by_more_than_a_law_of_half_of_the_balls_is_off(
    wrong: float, law_std: float, named: bool
) -> None:
    """A law of seven balls reads all of the others off by one factor, which the balls' scatter does not show."""
    stated = dict(enumerate([3.0, 5.0] * 7))

    def gains(group: Sequence[int], steeper: Mapping[int, float]) -> dict[int, float]:
        off = np.exp(law_std * np.random.default_rng(sum(n * n for n in group)).standard_normal())
        all_large = all(stated[n] > 4 for n in group)
        return {n: (wrong if all_large else off) / steeper.get(n, 1.0) ** all_large for n in group}

    assert bool(contradicting_radii(stated, gains)) is named


def test_balls_that_are_pressed_deeper_and_deeper_at_one_place_are_no_pressed_reference() -> None:
    rng = np.random.default_rng(9)
    change = ColourChange(make_reference([flat(rng)]))
    depths = [picture(*ball((1.0, -0.5), contact, BALL_MM)[1:], rng) for contact in (1.0, 1.4, 1.8, 2.2, 2.6)]
    sizes = [Ball((132.0, 84.0), 15.0 + 4 * n, BALL_MM) for n in range(5)]
    assert pressed_reference(change, depths, sizes) == (None, None)
    pressed = ColourChange(make_reference([depths[2]]))
    elsewhere = [picture(*ball(at, contact, BALL_MM)[1:], rng) for at, contact in presses(5, rng)]
    assert contact_in_reference(pressed, elsewhere) is not None
    assert contact_in_reference(change, elsewhere) is None


@pytest.mark.slow
def test_two_true_radii_agree() -> None:
    rng = np.random.default_rng(3)
    pictures = [
        BallPicture(picture(*ball(at, contact, radius)[1:], rng), radius)
        for number, (at, contact) in enumerate(presses(16, rng))
        for radius in [BALL_MM if number % 2 else 1.5 * BALL_MM]
    ]
    assert calibrated(pictures).warnings == ()


@pytest.mark.slow
def test_one_ball_of_another_radius_is_named_by_its_picture() -> None:
    pictures = [
        dataclasses.replace(shot, name=f"{number:02d}.png")
        for number, shot in enumerate(ball_pictures(12, np.random.default_rng(4)))
    ]
    pictures[5] = dataclasses.replace(pictures[5], radius_mm=0.6 * BALL_MM)
    (warning,) = calibrated(pictures).warnings
    assert warning.startswith("05.png: its slopes")


def test_one_wrong_radius_of_ten_is_named_though_the_law_leans_to_it() -> None:
    pictures = [
        dataclasses.replace(shot, name=f"{number:02d}.png")
        for number, shot in enumerate(ball_pictures(10, np.random.default_rng(4)))
    ]
    assert calibrated(pictures).warnings == ()
    pictures[5] = dataclasses.replace(pictures[5], radius_mm=BALL_MM / 1.5)
    (warning,) = calibrated(pictures).warnings
    assert warning.startswith("05.png: its slopes are 0.6")


def test_a_ball_in_the_reference_that_passes_for_all_balls_is_seen() -> None:
    rng = np.random.default_rng(5)
    pressed = picture(*ball((1.0, -0.5), 2.2, BALL_MM)[1:], rng)
    shots = [picture(*ball(at, 0.5 * contact, BALL_MM)[1:], rng) for at, contact in presses(7, rng)]
    found = calibrated([BallPicture(shot, BALL_MM) for shot in shots], reference=pressed)
    assert found.method.card.contact_in_reference_px is not None
    (warning,) = found.warnings
    assert "contact in the reference" in warning
    assert "reference/flat" in warning, "what to do about it"
    assert "are a contact in the reference" in unfit(found.method.card), "its law is upside down"


def test_balls_at_one_place_but_of_all_sizes_are_no_reference() -> None:
    sizes: Floats = np.linspace(10.0, 20.0, 8)
    assert shared_contact([Ball((50.0, 60.0), float(size), BALL_MM) for size in sizes]) is None
    assert shared_contact([None, *[Ball((50.0, 60.0), 15.0, BALL_MM)] * 2]) is None
    assert shared_contact([None, *[Ball((50.0, 60.0), 15.0, BALL_MM)] * 6]) == (50.0, 60.0)


def test_a_contact_as_wide_as_the_ball_is_refused() -> None:
    rng = np.random.default_rng(6)
    shot = picture(*ball((0.0, 0.0), 2.0, BALL_MM)[1:], rng).astype(np.float32) - flat(rng)
    assert find_ball(shot, SIDES, radius_mm=BALL_MM).contact_radius_px == pytest.approx(2.0 / MM_PER_PX, rel=0.1)
    with pytest.raises(InputError, match="as wide as the whole ball"):
        find_ball(shot, SIDES, radius_mm=1.6)


@pytest.mark.parametrize(
    ("scale", "said"), [(10 * MM_PER_PX, "as wide as the whole ball"), (1 / MM_PER_PX, "px in")]
)
def test_a_wrong_scale_is_named_once_with_what_to_do(scale: float, said: str) -> None:
    shots = ball_pictures(4, np.random.default_rng(8))
    untouched = make_reference([flat(np.random.default_rng(1))])
    with pytest.raises(InputError, match=said) as found:
        calibrate_from_balls(untouched, shots, mm_per_px=(scale, scale), fit=PHOTOMETRIC["polynomial"])
    assert "Is mm_per_px ten times too large, or pixels in a mm?" in found.value.remedy
    assert str(found.value).count("ball_radius_mm =") == 1, "not once for each picture"


def test_colours_that_no_lamp_makes_of_the_stated_slopes_are_named() -> None:
    slopes = 0.3 * np.random.default_rng(0).standard_normal((500, 2))
    change = slopes @ np.array([[1.5, -0.8, -0.7], [0.1, 1.3, -1.4]])
    assert scale_warnings(change, slopes) == []
    assert "mm_per_px" in scale_warnings(change, 0.1 * slopes)[0]


def test_labels_that_the_pictures_do_not_show_are_named() -> None:
    """Circles clicked on a blurred blob: too wide, and beside the middle. Good ones, or one slip, say nothing."""
    balls = [Ball((50.0 + 10 * n, 60.0), 20.0, 4.0) for n in range(6)]
    right: list[tuple[tuple[float, float] | None, float | None]] = [
        ((ball.centre_px[0] + 1.0, ball.centre_px[1]), 22.0) for ball in balls
    ]
    moved = [((ball.centre_px[0] + 9.0, ball.centre_px[1]), 40.0) for ball in balls]
    assert label_warnings(right, balls) == []
    assert label_warnings([moved[0], *right[1:]], balls) == []
    assert label_warnings([(None, None)] * 6, balls) == []
    (said,) = label_warnings(moved, balls)
    assert said.startswith("6 of 6")
    assert "9.0 px" in said
    assert "a factor of 2 " in said


@each(
    "gain, told",
    [(2.0, "2 times"), (0.4, "0.4 times"), (0.0, "less than 0.1 times"), (610.0, "more than 10 times")],
)
def test_an_odd_ball_is_told_by_a_figure_that_means_something(gain: float, told: str) -> None:
    gains = dict.fromkeys(range(9), 1.0) | {4: gain}
    balls = [Ball((10.0, 10.0), 5.0, BALL_MM)] * 9
    (said,) = odd_balls(gains, balls, names=[f"{k}.png" for k in range(9)], unsure={})
    assert said.startswith(f"4.png: its slopes are {told} those")
