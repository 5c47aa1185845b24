"""What counts as one depth: a ramp read densely is no plateau, and points of one height are one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.inputs.conditions import group_basis
from calibration.inputs.denoised_depth import BRANCHES, denoised_depth, nominal_depth, ways
from calibration.inputs.depth_path import depth_at
from tactilevision.records.measured import Floats


def test_a_dense_ramp_keeps_its_shape() -> None:
    """Readings 5 um apart, nearer than two zeros of presses: the group's mean curve still has degree 4."""
    ramp = np.linspace(0.01, 0.6, 120)
    data = observations([ramp, ramp + 0.002, ramp - 0.002], [indenter()] * 3)
    basis = group_basis(data)
    assert basis.shape[1] == 5
    coefficients = np.linalg.lstsq(basis, data.depth_mm**3, rcond=None)[0]
    np.testing.assert_allclose(basis @ coefficients, data.depth_mm**3, atol=1e-9)


def test_heights_that_scatter_are_as_many_as_were_pressed() -> None:
    rng = np.random.default_rng(0)
    heights = np.repeat([0.15, 0.3, 0.6], 6)
    data = observations(list((heights + 0.003 * rng.standard_normal(18))[:, None]), [indenter()] * 18)
    assert group_basis(data).shape[1] == 3
    depth = nominal_depth(data)
    assert np.unique(depth.round(9)).size == 3
    np.testing.assert_allclose(depth, heights, atol=0.004)


def test_a_chain_of_near_depths_is_no_one_depth() -> None:
    """Forty points 15 um apart reach over .6 mm: they stay near where they were."""
    heights = np.linspace(0.02, 0.6, 40)
    data = observations(list(heights[:, None]), [indenter()] * 40)
    np.testing.assert_allclose(nominal_depth(data), heights, atol=0.011)


def test_what_is_kept_is_the_data_sets_own() -> None:
    """The same depths at other times, and other depths at the same times, are asked for anew."""
    time_s = np.linspace(0, 1, 40)
    one = observations([time_s**2], [indenter()], time_s=[time_s])
    other = observations([time_s**3], [indenter()], time_s=[time_s])
    assert denoised_depth(one) is denoised_depth(one)
    np.testing.assert_allclose(denoised_depth(other), time_s**3, atol=1e-9)
    np.testing.assert_allclose(denoised_depth(one), time_s**2, atol=1e-9)


@pytest.mark.parametrize("late_s", [-0.05, 0.05])
def test_a_corner_lies_where_the_depth_turns_and_not_where_the_forces_clock_says(late_s: float) -> None:
    """Loads of .5 s at 1 mm/s, phases by the true clock: the depth of other moments comes back within a micron."""

    def depth(t: Floats) -> Floats:
        return np.interp(t, [0, 0.5, 1.5, 2.5], [-0.1, 0.4, 0.4, -0.1])

    time_s = np.array([0.02, 0.1, 0.2, 0.3, 0.4, 0.48, 0.52, 0.8, 1.1, 1.4, 1.48, 1.6, 1.9, 2.2, 2.4])
    phase = ["load"] * 6 + ["hold"] * 5 + ["unload"] * 4
    data = observations([depth(time_s + late_s)], [indenter()], time_s=[time_s], phase=[phase])
    np.testing.assert_allclose(depth_at(data, -late_s)[1:], depth(time_s)[1:], atol=1e-3)


@pytest.mark.parametrize("late_s", [-0.05, 0.05])
def test_a_press_left_in_air_on_its_way_out_is_followed_further(late_s: float) -> None:
    """The last sample is of the free gel, while the punch goes on at the speed of its press."""

    def depth(t: Floats) -> Floats:
        return np.interp(t, [-1, 0.6, 1.5, 3.5], [-1.2, 0.4, 0.4, -1.6])

    time_s = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.3, 1.6, 1.7, 1.8, 1.95])
    phase = ["free"] + ["load"] * 4 + ["hold"] * 3 + ["unload"] * 3 + ["free"]
    data = observations([depth(time_s + late_s)], [indenter()], time_s=[time_s], phase=[phase])
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([1.0])))
    np.testing.assert_allclose(depth_at(data, -late_s), depth(time_s), atol=1e-3)


def test_ramps_do_not_follow_noise_that_is_alike() -> None:
    """Forty ramps at one speed, neighbours' noise alike by .6: all of them straight."""
    rng, noise = np.random.default_rng(3), np.zeros((40, 22))
    white = rng.standard_normal(noise.shape)
    for k in range(1, 22):
        noise[:, k] = 0.6 * noise[:, k - 1] + 0.8 * white[:, k]
    time_s = np.linspace(0.0, 1.0, 22)
    ramps = list(0.02 + 0.3 * time_s + 0.004 * noise)
    data = observations(ramps, [indenter()] * 40, time_s=[time_s] * 40, phase=[["load"] * 22] * 40)
    bends = np.diff(denoised_depth(data).reshape(40, 22), n=2, axis=1)
    np.testing.assert_allclose(bends, 0, atol=1e-9)


def test_a_turn_and_an_end_that_the_depths_clock_saw_early_are_found() -> None:
    """5 mm/s, the depth 30 ms ahead of the phases: down and up at once, and down and held."""
    time_s = np.concatenate([np.linspace(0.004, 0.06, 15), np.linspace(0.064, 0.12, 15)])
    turn = np.interp(time_s + 0.03, [-1, 0.06, 0.12, 1], [-5.02, 0.28, -0.02, -0.02])
    way = np.interp(time_s + 0.03, [-1, 0.06, 1], [-5.02, 0.28, 0.28])
    phase = ["load"] * 15 + ["unload"] * 15
    data = observations(
        [turn, way], [indenter()] * 2, time_s=[time_s, time_s], phase=[phase, ["load"] * 15 + ["hold"] * 15]
    )
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([5.0, 5.0])))
    true = np.concatenate(
        [
            np.interp(time_s, [0, 0.06, 0.12], [-0.02, 0.28, -0.02]),
            np.interp(time_s, [0, 0.06, 1], [-0.02, 0.28, 0.28]),
        ]
    )
    inside = true > 0.02
    np.testing.assert_allclose(depth_at(data, -0.03)[inside], true[inside], atol=2e-3)


def _through(time_s: Floats, phase: list[str], corners: tuple[list[float], list[float]], late_s: float) -> None:
    """One press at 5 mm/s, its depth read early by so much: in the gel it is found at the force's times."""
    data = observations([np.interp(time_s + late_s, *corners)], [indenter()], time_s=[time_s], phase=[phase])
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([5.0])))
    true = np.interp(time_s, *corners)
    np.testing.assert_allclose(depth_at(data, -late_s)[true > 0.02], true[true > 0.02], atol=2e-3)


def test_a_way_out_that_ends_at_its_last_sample_is_not_slower_for_it() -> None:
    """The punch rests from .2 s on; the last sample alone was read there, and its phase says unload."""
    time_s = np.array([0.004, 0.03, 0.056, 0.08, 0.11, 0.14, 0.15, 0.16, 0.17, 0.21])
    way = [-1, 0, 0.06, 0.14, 0.2, 1], [-5.02, -0.02, 0.28, 0.28, -0.02, -0.02]
    _through(time_s, ["load"] * 3 + ["hold"] * 3 + ["unload"] * 4, way, 0.014)


def test_two_samples_at_almost_one_time_say_nothing_of_a_speed() -> None:
    """The corner before them is found with the speed of their press."""
    time_s = np.array([0.004, 0.03, 0.056, 0.08, 0.11, 0.12, 0.1502, 0.1505])
    way = [-1, 0, 0.06, 0.14, 1], [-5.02, -0.02, 0.28, 0.28, -4.02]
    late_s, noise_mm = 0.014, np.array([0, 0, 0, 0, 0, 0, 0.001, -0.002])
    depth = np.interp(time_s + late_s, *way) + noise_mm
    phase = ["load"] * 3 + ["hold"] * 3 + ["unload"] * 2
    data = observations([depth], [indenter()], time_s=[time_s], phase=[phase])
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([5.0])))
    np.testing.assert_allclose(depth_at(data, -late_s)[1:], np.interp(time_s, *way)[1:], atol=4e-3)


def test_a_turn_half_a_gap_late_is_told_by_both_its_sides() -> None:
    """The deepest sample was read on the way out, while its phase says load."""
    time_s = np.array([0.004, 0.03, 0.05, 0.07, 0.09, 0.11, 0.13])
    way = [-1, 0, 0.09, 0.15, 1], [-5.02, -0.02, 0.43, 0.13, -4.12]
    _through(time_s, ["load"] * 5 + ["unload"] * 2, way, 0.0093)


def _ways(depth_mm: Sequence[float], phase: list[str], step_mm: float) -> list[str]:
    """Of one press at 1 mm/s, a step between its samples."""
    depth = np.array(depth_mm)
    data = observations([depth], [indenter()], time_s=[step_mm * np.arange(float(depth.size))], phase=[phase])
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([1.0])))
    return [BRANCHES[way] for way in ways(data)]


@pytest.mark.parametrize(
    ("depth_mm", "phase"),
    [
        ([0.4, 0.2, 0.0], ["load", "unload", "unload"]),
        ([0.2, 0.3999, 0.4, 0.0], ["load", "load", "unload", "free"]),
    ],
)
def test_a_turn_beside_air_or_an_end_stays_where_the_phases_say(depth_mm: list[float], phase: list[str]) -> None:
    """The deepest sample has one neighbour in the gel: nothing weighs its way in against its way out."""
    assert _ways(depth_mm, phase, 0.2) == phase


def test_a_last_step_shorter_than_the_one_before_is_no_air_in_the_gel() -> None:
    """Half as long in the same time, and .275 mm deep: the way out goes on to it."""
    phase = ["unload"] * 6
    assert _ways([0.5, 0.45, 0.4, 0.35, 0.3, 0.275], phase, 0.05) == phase


def test_readings_noise_makes_no_air_of_the_end_of_a_ramp() -> None:
    """Forty presses at one speed, to .1 mm above the touch, read with 6 um: of 80 ends at most one rests."""
    rng, along = np.random.default_rng(11), np.linspace(-0.1, 0.5, 13)
    true = np.concatenate([along, np.full(5, 0.5), along[::-1]])
    time_s = 0.05 * np.arange(float(true.size))
    phase = [["load"] * 13 + ["hold"] * 5 + ["unload"] * 13] * 40
    data = observations(
        [true + 0.006 * rng.standard_normal(true.size) for _ in range(40)],
        [indenter()] * 40,
        time_s=[time_s] * 40,
        phase=phase,
    )
    data = replace(data, presses=replace(data.presses, speed_mm_s=np.ones(40)))
    assert np.count_nonzero(ways(data) == BRANCHES.index("free")) <= 1


def test_a_fast_ramp_ends_where_it_meets_the_plateau() -> None:
    """Its last sample lies .015 mm below: four std of a reading, and an outlier of the plateau might lie there.

    Taken for one it put the corner a sample early, and depths of 27 ms later were .015 mm off.
    """
    rng = np.random.default_rng(2)
    time_s = np.concatenate([0.00337 * np.arange(23), 0.0741 + 0.09 * np.arange(1, 11)])
    true = np.minimum(0.118 + 4.95 * time_s, 0.35)
    off = []
    for _ in range(20):
        data = observations(
            [true + 0.004 * rng.standard_normal(true.size)],
            [indenter()],
            time_s=[time_s],
            phase=[["load"] * 23 + ["hold"] * 10],
        )
        data = replace(data, presses=replace(data.presses, speed_mm_s=np.array([5.0])))
        steady = replace(data, depth_mm=denoised_depth(data))
        asked = slice(9, 23)  # before the corner, 27 ms earlier than stamped
        off.append(depth_at(steady, -0.027)[asked] - np.interp(time_s[asked] - 0.027, time_s, true))
    assert np.max(np.abs(np.mean(off, axis=0))) < 0.004
