"""Formulas of effects against what can be known without them: solved contacts, energy, corners, integrals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import GEL, indenter, observations

from calibration.effects import EFFECTS
from calibration.effects.force_crosstalk import ForceCrosstalk
from calibration.effects.recovery import carried
from calibration.effects.thickness_wedge import ThicknessWedge
from calibration.inputs import depth_path as phase
from calibration.inputs.checks import check, usable
from calibration.inputs.depth_path import GRID_S, depth_at, in_phase, offset_by_phase
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.laws.theory import punch_stiffness
from calibration.model.composition import Model
from tactilevision.errors import InputError
from tactilevision.mechanics.tilted_punch import PLACES, solve, upright

LAW = np.array([0.2, 0.48, 0.85])


def one_press(depth: np.ndarray, time: np.ndarray | None = None, **more: object) -> Observations:
    return observations([depth], [indenter()], time_s=None if time is None else [time], **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [0.0, 0.75, 1.5])
def test_the_table_of_the_askew_punch_is_what_the_contact_gives(ratio: float) -> None:
    """Fewer squares than the table was made with, so .003 apart."""
    x = np.array([-0.5, 0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(upright(x, ratio), solve(x, ratio, squares=33), atol=3e-3)


def test_the_askew_punch_pushes_more_than_its_mean_depth_and_ends_upright() -> None:
    """Without tension the gel only adds, the force grows, and from 2 a theta on the face lies whole."""
    for ratio in (0.0, 0.5, 1.0):
        found = upright(PLACES, ratio)
        assert (np.diff(found) > 0).all()
        assert (found >= PLACES - 1e-3).all()
    np.testing.assert_array_equal(upright(np.array([-1.5, 2.0, 7.0]), 0.8), [0.0, 2.0, 7.0])
    assert upright(np.zeros(1), 0.0) > upright(np.zeros(1), 1.0) > 2 / (3 * np.pi)  # springs: 2/(3 pi)


def test_pull_off_pays_for_the_face_by_the_layers_own_energy() -> None:
    """dU/da = 2 pi a W at the limit, U = K w^2/2, for a/h where the half-space would be wrong by half."""
    a, h, work = 2.5, 3.0, 2e-4
    pair = punch_stiffness(0.2, 0.48, radius_mm=np.array([a - 0.01, a + 0.01]), thickness_mm=np.full(2, h))
    limit = float(np.sqrt(4 * np.pi * a * work / (np.diff(pair)[0] / 0.02)))
    depth = np.concatenate([[0.3], -limit * np.array([0.8, 1.25])])
    force = (Model(FlatPunch()) + EFFECTS["adhesion"]).predict(np.append(LAW, work), one_press(depth))
    stiffness = punch_stiffness(0.2, 0.48, radius_mm=np.array([a]), thickness_mm=np.array([h]))[0]
    assert force[1] == pytest.approx(-0.8 * stiffness * limit, rel=0.03)
    assert force[2] == pytest.approx(0, abs=0.02 * stiffness * limit)


def test_corners_that_no_sample_hit_are_found() -> None:
    """Down at 1 mm/s to .5, held 2 s, up again: at any time the depth is that of the three lines."""
    time = np.array([0.1, 0.2, 0.3, 1.0, 1.5, 2.3, 2.6, 2.8])
    path_t, path_w = np.array([0.0, 0.5, 2.5, 3.0]), np.array([0.0, 0.5, 0.5, 0.0])
    depth = np.interp(time, path_t, path_w)
    phase = [["load"] * 3 + ["hold"] * 2 + ["hold"] + ["unload"] * 2]
    data = one_press(depth, time, phase=phase)
    for later in (-0.05, 0.05, 0.15):
        inside = slice(1, -1)
        np.testing.assert_allclose(
            depth_at(data, later)[inside], np.interp(time + later, path_t, path_w)[inside], atol=1e-12
        )


def test_a_positive_clock_offset_is_the_force_sensors_clock_running_ahead() -> None:
    """F/T minus camera: a force stamped t belongs to the depth read at t - dt."""
    time = np.linspace(0, 1, 21)
    data = one_press(0.5 * time, time)
    force = Model(FlatPunch()).predict(LAW, data.shifted(-0.5 * 0.1))
    found = (Model(FlatPunch()) + EFFECTS["clock_offset"]).predict(np.append(LAW, 0.1), data)
    np.testing.assert_allclose(found[4:], force[4:], atol=1e-12)


def test_presses_too_fast_for_clocks_that_far_apart_are_left_out() -> None:
    """Ramps of .1 s beside slow ones, the depth read 60 ms late: the offset is all presses', the fast leave."""
    along, speeds = np.linspace(0, 1, 25), np.array([4.0, 0.4, 0.4, 4.0, 0.4])
    time = [100.0 * k + 3 * 0.4 / speed * along for k, speed in enumerate(speeds)]
    true, late = (
        [
            np.interp((t - t[0] - by) * v / 0.4, [0, 1, 2, 3], [0, 0.4, 0.4, 0])
            for v, t in zip(speeds, time, strict=True)
        ]
        for by in (0.0, 0.06)
    )
    force = Model(FlatPunch()).predict(LAW, observations(true, [indenter()] * 5, time_s=time))
    data = observations(late, [indenter()] * 5, time_s=time).with_force(force)
    data = replace(data, presses=replace(data.presses, speed_mm_s=speeds))
    assert offset_by_phase(data) == pytest.approx(-0.06)
    kept = in_phase(data)
    assert kept.presses.label == tuple(np.array(data.presses.label)[[1, 2, 4]])
    assert "60 ms" in kept.warnings[-1]
    assert f"({data.presses.label[0]}, {data.presses.label[3]})" in kept.warnings[-1]
    right = replace(data, depth_mm=np.concatenate(true))
    assert in_phase(right) is right
    missed = replace(right, depth_mm=np.where(right.press == 1, -0.05, right.depth_mm))
    assert in_phase(missed) is missed, "a press that misses the gel tells nothing of clocks"


def read_late(speeds: np.ndarray, tops: tuple[float, ...], narrow: int, late_s: float) -> Observations:
    """Presses of these speeds (mm/s) and depths (mm), first of a narrow punch and then of a wide one."""
    along = np.linspace(0, 1, 25)
    kinds = [indenter("narrow", 1.0)] * narrow + [indenter("wide", 3.0)] * (len(tops) - narrow)
    time = [100.0 * k + 3 * 0.4 / speed * along for k, speed in enumerate(speeds)]
    read, then = (
        [
            top * np.interp((t - t[0] - by) * v / 0.4, [0, 1, 2, 3], [0, 1, 1, 0])
            for v, t, top in zip(speeds, time, tops, strict=True)
        ]
        for by in (0.0, late_s)
    )
    law = np.array([0.2, 0.48, 0.5, 0.5])
    force = Model(FlatPunch()).predict(law, observations(then, kinds, time_s=time))
    data = observations(read, kinds, time_s=time).with_force(force)
    return replace(data, presses=replace(data.presses, speed_mm_s=speeds))


def test_a_force_that_falls_is_looked_for_once_presses_out_of_phase_are_left_out() -> None:
    """Two fast presses of a narrow punch, the force read 160 ms late, beside slow ones of a wide punch."""
    data = read_late(np.array([4.0, 4.0, 0.4, 0.4, 0.4]), (0.4, 0.39, 0.4, 0.39, 0.38), 2, 0.16)
    narrow = data.radius_mm == 1.0
    assert np.corrcoef(data.depth_mm[narrow], data.normal_N[narrow])[0, 1] < 0
    kept = in_phase(usable(data))
    assert kept.presses.label == tuple(np.array(data.presses.label)[2:])
    check(kept)
    with pytest.raises(InputError, match="falls as the depth grows"):
        usable(data.with_force(-data.normal_N))


def test_a_force_that_falls_is_looked_for_with_one_clock_where_most_presses_are_out_of_phase() -> None:
    """The force read 160 ms late again: too few slow presses to leave the fast ones out."""
    data = read_late(np.array([4.0, 4.0, 4.0, 0.4, 0.4]), (0.4, 0.39, 0.41, 0.39, 0.38), 3, 0.16)
    narrow = data.radius_mm == 1.0
    assert np.corrcoef(data.depth_mm[narrow], data.normal_N[narrow])[0, 1] < 0
    assert in_phase(usable(data)).count == data.count
    with pytest.raises(InputError, match="falls as the depth grows"):
        usable(data.with_force(-data.normal_N))


def test_an_offset_that_leaves_more_of_all_forces_hides_none_that_leaves_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At -150 ms least is left of the narrow punch, and much of the wide one; at 30 ms little of both."""
    data = read_late(np.array([4.0, 0.4, 0.4]), (0.4, 0.39, 0.38), 1, 0.0)
    squares = [np.sum(data.normal_N[data.radius_mm == radius] ** 2) for radius in (1.0, 3.0)]
    left = np.full((GRID_S.size, 2), [0.5, 0.02])
    left[np.isclose(GRID_S, -0.15)], left[np.isclose(GRID_S, 0.03)] = [0.01, 0.1], [0.02, 0.01]
    shares = iter(left * squares)
    monkeypatch.setattr(phase, "_residual_of_cubic", lambda *_: next(shares))
    assert offset_by_phase(data) == pytest.approx(0.03)


def wide_presses_and_a_weak_one(late_s: float, *, samples: int, peak_N: float, seed: int) -> Observations:
    """Eight of 3 mm, three of them fast, and one of 1 mm whose force reaches this peak; 50 mN of noise on all."""
    speeds, tops = (
        np.append(np.where(np.arange(8) % 3 == 0, 4.0, 0.4), 0.4),
        np.append(np.linspace(0.3, 0.5, 8), 0.1),
    )
    kinds = [indenter("wide", 3.0)] * 8 + [indenter("narrow", 1.0)]
    counts = [40] * 8 + [samples]
    time = [100.0 * k + 3 * tops[k] / speeds[k] * np.linspace(0, 1, n) for k, n in enumerate(counts)]
    read, then = (
        [
            top * np.interp((t - t[0] - by) * v / top, [0, 1, 2, 3], [0, 1, 1, 0])
            for v, t, top in zip(speeds, time, tops, strict=True)
        ]
        for by in (0.0, late_s)
    )
    data = observations(read, kinds, time_s=time)
    force = Model(FlatPunch()).predict(np.array([0.2, 0.48, 0.5, 0.5]), observations(then, kinds, time_s=time))
    weak = data.radius_mm == 1.0
    force[weak] *= peak_N / np.max(force[weak])
    data = data.with_force(force + 0.05 * np.random.default_rng(seed).standard_normal(force.size))
    return replace(data, presses=replace(data.presses, speed_mm_s=speeds))


@each("seed", range(5))
def test_a_radius_that_nothing_explains_does_not_hide_that_clocks_are_apart(seed: int) -> None:
    """80 ms, and a narrow press whose force is noise only."""
    data = wide_presses_and_a_weak_one(0.08, samples=25, peak_N=0.0, seed=seed)
    assert offset_by_phase(data) == pytest.approx(0.08, abs=0.011)


@each("samples", [5, 6, 8, 12])
def test_a_few_samples_of_a_weak_press_set_no_clock_wrong(samples: int) -> None:
    """Clocks that are right: a cubic at one of 41 offsets explains five samples of mere noise."""
    for seed in range(10):
        data = wide_presses_and_a_weak_one(0.0, samples=samples, peak_N=0.1, seed=seed)
        assert in_phase(data) is data


def test_the_memory_fills_during_a_press_and_fades_in_the_wait() -> None:
    """Two steps of force at one spot by hand: 1 - exp(-t/tau), then its fading; a new spot knows nothing."""
    time = [np.array([0.0, 1e-9, 10.0]), np.array([30.0, 30.0 + 1e-9, 40.0]), np.array([60.0, 60.0 + 1e-9, 70.0])]
    data = observations([np.full(3, 0.3)] * 3, [indenter()] * 3, time_s=time, place_mm=[(0, 0), (0, 0), (5, 0)])
    data = replace(data, presses=replace(data.presses, rest_s=np.full(3, 20.0)))
    force = np.tile([0.0, 1.0, 1.0], 3)
    found = carried(force, 25.0, data=data)
    first = 1 - np.exp(-10 / 25)
    left = first * np.exp(-20 / 25)
    np.testing.assert_allclose(found[[2, 3, 5]], [first, left, first + left * np.exp(-10 / 25)], rtol=1e-6)
    np.testing.assert_allclose(found[6:], [0, 0, first], atol=1e-6)
    broken = carried(force, 25.0, data=data, at_once=1.0)  # all of it, however short the press
    left = np.exp(-20 / 25) * np.exp(-np.diff([0.0, *(time[1] - time[1][0])]).cumsum() / 25)
    np.testing.assert_allclose(broken, [0, 0, 0, *(left * force[3:6]), 0, 0, 0], atol=1e-9)


def test_softening_runs_from_its_full_size_to_nothing_at_the_largest_depth() -> None:
    data = one_press(np.array([0.3, 0.9, 0.9, 0.05]))
    bare = Model(FlatPunch()).predict(LAW, data)
    model = Model(FlatPunch()) + EFFECTS["mullins"]
    force = model.predict(np.append(LAW, [0.1, 0.3, 0.0]), data)
    np.testing.assert_allclose(force / bare, [1, 1, 1, 0.9], rtol=1e-6)
    wide = model.predict(np.append(LAW, [0.1, 0.3, 1.0]), data)  # by hand: erf((.81 - .0025)/(.09 + .81))
    np.testing.assert_allclose(wide / bare, [1, 1, 1, 1 - 0.1 * 0.7955], rtol=1e-4)


@pytest.mark.parametrize(("radius", "strain", "by_elements"), [(1.8, 0.1, 1.0606), (2.55, 0.15, 1.1602)])
def test_sticking_bends_the_curve_as_finite_elements_have_it(
    radius: float, strain: float, by_elements: float
) -> None:
    """Force of no slip over no friction, nu .48 (mechanics.punch_fem)."""
    data = observations([np.array([strain * GEL.thickness_mm])], [indenter(radius_mm=radius)])
    force = [(Model(FlatPunch()) + EFFECTS["friction"]).predict(np.append(LAW, q), data)[0] for q in (0.0, 1.0)]
    assert force[1] / force[0] == pytest.approx(by_elements, abs=0.004)


def test_the_rigs_give_is_taken_from_the_models_own_force_not_from_the_noise() -> None:
    """P = f(w - C P) holds, whatever was measured."""
    depth = np.linspace(0.05, 0.6, 9)
    data, model = one_press(depth), Model(FlatPunch()) + EFFECTS["backing_compliance"]
    values = np.append(LAW, 0.05)
    noisy = data.with_force(0.3 * np.random.default_rng(0).standard_normal(9))
    force = model.predict(values, noisy)
    np.testing.assert_allclose(force, Model(FlatPunch()).predict(LAW, data.shifted(-0.05 * force)), rtol=5e-3)


def test_an_axis_along_which_nothing_varies_tells_nothing() -> None:
    """Places on a line, and a tangential force that was never felt: the other number is 0, at each start too."""
    ramp = np.linspace(0.05, 0.3, 12)
    data = observations([ramp] * 3, [indenter()] * 3, place_mm=[(-4.0, 0.0), (0.0, 0.0), (4.0, 0.0)])
    force = np.column_stack([ramp.repeat(3), np.zeros(36), ramp.repeat(3)])
    data = replace(data, force_N=force)
    for effect in (ThicknessWedge(), ForceCrosstalk()):
        assert [p.fixed for p in effect.parameters_on(data)] == [False, True]
        assert (effect.starts(data)[:, 1] == 0).all()
        assert not effect.missing(data)
