"""What a card says of depth: exact for an exact ball, and silent on what lies beside it."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import Known, bands, conformal_factor, dent_mm, told
from tactilevision.heightmap.deviation import gain_std, place_gain_std
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.card import MethodCard


@pytest.mark.parametrize("scale", [(0.06, 0.06), (0.05, 0.07)])
def test_the_dent_of_a_ball_is_its_own(scale: tuple[float, float]) -> None:
    ball = Ball((80.3, 61.8), 1.5 / scale[0], 3.0)
    y, x = np.indices((130, 170), dtype=np.float64)
    r = np.hypot((x - 80.3) * scale[0], (y - 61.8) * scale[1])
    depth = np.sqrt(np.maximum(9.0 - r**2, 0.0)) + 0.7
    depth[r > 1.6] = -5.0
    found, true = dent_mm(depth, ball, mm_per_px=scale)
    assert found == pytest.approx(true, rel=1e-12)
    assert true == pytest.approx(3.0 - np.sqrt(9.0 - 1.35**2), rel=0.03)
    assert dent_mm(0.9 * depth, ball, mm_per_px=scale)[0] == pytest.approx(0.9 * true, rel=1e-12)


def contacts(relative_std: float) -> list[Known]:
    return [Known(0.1 * n, 0.1 * n * 1.02, relative_std * 0.1 * n, 40.0 - n) for n in range(1, 10)]


def test_bands_hold_their_errors_against_the_stated_one() -> None:
    low, middle, high = bands(contacts(0.04), "true_mm")
    assert (low.count, middle.count, high.count) == (3, 3, 3)
    assert (low.low, high.high) == pytest.approx((0.1, 0.9))
    assert middle.rms_mm == pytest.approx(0.5 * middle.stated_mm)
    assert high.bias_mm == pytest.approx(0.02 * 0.8)
    assert high.within == 1.0
    assert [band.within for band in bands(contacts(0.01), "radius_px")] == [0.0] * 3
    assert bands([], "true_mm") == []


def test_contacts_alike_are_never_torn_into_two_bands() -> None:
    alike = [Known(0.2, 0.21, 0.02, 40.0)] * 7 + [Known(0.4, 0.38, 0.01, 40.0)] * 2
    assert [band.count for band in bands(alike, "true_mm")] == [7, 2]
    assert [band.count for band in bands(alike, "radius_px")] == [9]
    card = told("flat_steps", alike)
    assert len(card["flat_steps"]) == 9
    assert card["flat_steps_by"]["true_mm"][1]["bias_mm"] == pytest.approx(-0.02)
    assert card["flat_steps_by"]["true_mm"][1]["within"] == 0.0


def test_the_stated_scale_lies_between_balls_seen_and_unseen() -> None:
    assert 0.02 < gain_std(MethodCard(held_out_gain_std=0.06, seen_gain_std=0.02), 0.5) < 0.06
    assert gain_std(MethodCard(), 0.5) == 0.5


def test_what_other_balls_would_have_changed_is_told_place_by_place() -> None:
    card = MethodCard(held_out_gain_std=0.06, seen_gain_std=0.03, place_gain_std=[[0.04, 0.0]])
    assert place_gain_std(card, 0.5) == pytest.approx(np.array([[0.05, 0.03]]))
    assert gain_std(card, 0.5) == 0.03, "from ball to ball alone"
    assert place_gain_std(MethodCard(), 0.5) == pytest.approx(0.5)


@each("count", [3, 5, 10, 40])
@each("tail", [2.0, 50.0])
def test_the_stated_deviation_holds_for_a_further_ball(count: int, tail: float) -> None:
    """Two thirds of further errors lie within it, whatever their law, and however few balls told it."""
    rng = np.random.default_rng(count)
    off = 3.0 * np.abs(rng.standard_t(tail, (4000, count + 1)))
    held = np.mean([one[-1] < conformal_factor(one[:-1]) for one in off])
    chance = min(count, np.ceil(0.6827 * (count + 1))) / (count + 1)
    assert held == pytest.approx(chance, abs=0.025)
    assert chance > 0.66


def test_no_ball_left_out_changes_nothing_stated() -> None:
    assert conformal_factor(np.array([])) == 1.0
    assert conformal_factor(np.zeros(12)) == 0.5


@each("key", ["place_gain_std", "extrapolated_gain_std"])
@each(
    "forged",
    ["a", 3.0, [], [[]], [["a"]], [[None]], [[True]], [[0.1, 0.2], [0.1]], [[-0.1]], [[1e30]], [[np.nan]]],
)
def test_a_forged_deviation_over_the_picture_is_one_clear_error(key: str, forged: object) -> None:
    with pytest.raises(InputError, match=f"{key}: the method's card cannot be read") as fault:
        MethodCard.from_json({key: forged})
    assert fault.value.value is not None
    assert fault.value.remedy.endswith("calibrate again.")


def test_a_deviation_over_the_picture_is_read_as_written() -> None:
    rows = [[0.0, 0.5], [1, 0.25]]
    card = MethodCard.from_json({"place_gain_std": rows, "extrapolated_gain_std": rows})
    assert card.place_gain_std == card.extrapolated_gain_std == rows
    with pytest.raises(InputError, match="not from 0 to 1"):
        MethodCard.from_json({"extrapolated_gain_std": [[1.5]]})
