"""The contract that every effect keeps, and a check of each formula where it can be checked by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import GEL, indenter, observations

from calibration.effects import CATALOGUE, EFFECTS, get_effect
from calibration.effects.edge_fillet import EdgeFillet
from calibration.effects.mullins import largest_past_depth
from calibration.effects.recovery import memory
from calibration.effects.skin import weight
from calibration.effects.tilt import Tilt
from calibration.fit.least_squares import Problem, fit, linearise
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import Effect
from calibration.noise.model import Noise, Whitener
from calibration.result.result import common_assumptions
from tactilevision.errors import InputError
from tactilevision.mechanics.kappa import kappa
from tactilevision.records.measured import Floats

EVERY = [EFFECTS[key] for key in CATALOGUE]
# by force alone, or for want of steps
UNSEEN = ("depth_quantisation", "force_gain", "photometric_gain", "bevel_rise", "cast_shadow", "lamp_fading")
CLEAR = [effect for effect in EVERY if effect.key not in UNSEEN and effect.acts_on != "resultant"]
LONG = ("edge_fillet", "tilt", "adhesion", "force_jump", "screw_error", "slip_stick")  # fits of some seconds


def rich() -> Observations:
    """Three radii, three rates, nine places, waits, days, temperature, shear; load, hold, unload into air."""
    depths, times, kinds, places, phases = [], [], [], [], []
    start = 0.0
    load, unload = np.linspace(-0.02, 0.45, 10), np.linspace(0.36, -0.06, 7)
    for k in range(27):
        top = (0.6, 1.0, 0.8)[(k // 9) % 3]
        depth = top * np.concatenate([load, [0.45, 0.45], unload])
        rate = (0.05, 0.5, 5.0)[(k // 3) % 3]
        away = np.abs(np.diff(depth, prepend=depth[0])) / rate + np.isclose(np.diff(depth, prepend=-1), 0) * 5.0
        times.append(start + np.cumsum(away))
        start = float(times[-1][-1]) + (5.0, 40.0, 200.0, 2000.0)[k % 4] + (86400.0 * 20 if k % 9 == 8 else 0)
        depths.append(depth)
        kinds.append(indenter(f"R{k % 3}", (1.5, 2.5, 3.5)[k % 3]))
        places.append((6.0 * (k // 2 % 3 - 1), 6.0 * (k // 5 % 3 - 1)))
        phases.append(["load"] * 10 + ["hold"] * 2 + ["unload"] * 7)
    data = observations(depths, kinds, time_s=times, place_mm=places, phase=phases)
    rng = np.random.default_rng(1)
    shear = 0.1 * rng.standard_normal((data.count, 2))[data.press] * np.maximum(data.depth_mm, 0)[:, None]
    warmth = (22 + 3 * rng.standard_normal(data.count))[data.press]
    return replace(data, force_N=np.column_stack([shear, np.zeros(data.size)]), temperature_C=warmth)


RICH = rich()
BASE = np.array([0.2, 0.48, 0.8, 0.85, 0.9])


def data_for(effect: Effect) -> Observations:
    """The rich data, with the depth from where the effect can act."""
    return replace(RICH, depth_source=effect.depth_source or "vision")


def planted(effect: Effect, values: Floats, data: Observations) -> Floats:
    """The force with the effect; iterated where the effect depends on the force itself."""
    model = Model(FlatPunch()) + effect
    force = model.predict(np.concatenate([BASE, values]), data)
    for _ in range({"backing_compliance": 30, "adhesion": 2}.get(effect.key, 0)):
        force = model.predict(np.concatenate([BASE, values]), data.with_force(force))
    return force


@each("effect", EVERY)
def test_off_it_is_the_base_model_exactly(effect: Effect) -> None:
    data = data_for(effect)
    off = np.array([p.default for p in effect.parameters])
    bare = Model(FlatPunch()).predict(BASE, data)
    np.testing.assert_array_equal((Model(FlatPunch()) + effect).predict(np.concatenate([BASE, off]), data), bare)


@each("effect", EVERY)
def test_it_is_finite_over_its_bounds_and_tends_to_nothing(effect: Effect) -> None:
    data, table = data_for(effect), effect.parameters
    bare = Model(FlatPunch()).predict(BASE, data)
    for corner in np.ndindex(*[2] * len(table)):
        values = np.array([p.bounds[c] for p, c in zip(table, corner, strict=True)])
        assert np.isfinite(planted(effect, values, data)).all()
    for start in effect.starts(data):
        off = np.array([p.default for p in table])
        near = off + 1e-5 * (start - off)
        assert np.max(np.abs(planted(effect, near, data) - bare)) < 2e-2 * np.max(bare)


@each("effect", EVERY)
def test_it_says_what_it_is(effect: Effect) -> None:
    assert type(effect).__doc__
    for part in ("title", "seen_in", "confused_with", "separated_by", "source"):
        assert getattr(effect, part), f"{effect.key} lacks {part}"
    units = {"", "1", "mm", "N", "s", "mm^2/s", "rad", "1/K", "d", "mm/N", "mm/mm", "N/mm", "1/mm"}
    suffixes = ("_mm", "_N", "_s", "_rad", "_K", "_days", "_mm_per_N", "_N_per_mm", "_per_mm", "_x", "_y")
    for parameter in effect.parameters:
        assert parameter.unit in units
        assert parameter.unit == "1" or parameter.name.endswith(suffixes), parameter.name
    starts = effect.starts(RICH)
    assert starts.shape[1] == len(effect.parameters)
    for start in starts:
        for value, parameter in zip(start, effect.parameters, strict=True):
            assert parameter.bounds[0] <= value <= parameter.bounds[1]


@each("effect", [effect for effect in CLEAR if effect.key not in LONG])
def test_rich_data_can_show_it_and_its_planted_value_is_found(effect: Effect) -> None:
    finds_what_was_planted(effect)


@pytest.mark.slow
@each("effect", [EFFECTS[key] for key in LONG])
def test_effects_with_long_fits_are_found_too(effect: Effect) -> None:
    finds_what_was_planted(effect)


def finds_what_was_planted(effect: Effect) -> None:
    data = data_for(effect)
    assert effect.missing(data) == ""
    truth = effect.starts(data)[0] * 1.2
    truth = np.clip(truth, [p.bounds[0] for p in effect.parameters], [p.bounds[1] for p in effect.parameters])
    if effect.searched > 1:  # the form is searched over starts
        truth[1:] = effect.starts(data)[len(effect.starts(data)) // 2][1:]
    measured = data.with_force(planted(effect, truth, data))
    starts = [np.concatenate([BASE, start]) for start in effect.starts(data)] if effect.searched > 1 else []
    noise, model = Noise(1e-3, 1e-4, 1e-4, stated=False), Model(FlatPunch()) + effect
    found = fit(model, measured, noise=noise, starts=np.array(starts) if starts else None)
    np.testing.assert_allclose(found.force_N, measured.normal_N, atol=2e-3)
    assert found.values[5] == pytest.approx(truth[0], rel=0.1, abs=0.02 * effect.parameters[0].scale)


@each("effect", EVERY)
def test_the_jacobian_of_a_fit_is_the_difference_quotient(effect: Effect) -> None:
    data = data_for(effect)
    model = Model(FlatPunch()) + effect
    values = np.concatenate([BASE, effect.starts(data)[0]])
    about, _ = linearise(model, values, data=data)
    problem = Problem(model, data, model.parameters(data), Whitener(data, Noise(1.0, stated=False), about))
    jacobian = problem.jacobian(values)
    step = 1e-4 * effect.parameters[0].scale
    high, low = values.copy(), values.copy()
    high[5] += step
    low[5] -= step
    coarse = (model.predict(high, data) - model.predict(low, data)) / (2 * step)
    scale = np.max(np.abs(jacobian[:, 5])) + 1e-12
    assert np.mean(np.abs(coarse - jacobian[:, 5])) < 0.02 * scale


@each("effect", CLEAR)
def test_poor_data_are_told_what_they_lack_or_the_effect_needs_nothing(effect: Effect) -> None:
    poor = observations([np.array([0.3]), np.array([0.5])], [indenter()] * 2, time_s=[np.array([np.nan])] * 2)
    poor = replace(
        poor,
        depth_source="gauge",
        gel=replace(GEL, shape="unbounded"),
        presses=replace(poor.presses, x_mm=np.full(2, np.nan), y_mm=np.full(2, np.nan)),
    )
    needs_nothing = {"depth_zero", "force_bias", "tilt", "edge_fillet", "thickness", "stiffening", "mullins"}
    needs_nothing |= {"force_travel"}
    assert bool(effect.missing(poor)) == (effect.key not in needs_nothing) or effect.key == "mullins"


@pytest.mark.parametrize(("stated_mm", "spread"), [(0.0, 0.1), pytest.param(0.06, 0.02, marks=pytest.mark.slow)])
def test_the_thickness_is_held_by_what_is_known_of_it(stated_mm: float, spread: float) -> None:
    model = Model(FlatPunch()) + EFFECTS["thickness"]
    data = replace(RICH, gel=replace(GEL, thickness_std_mm=stated_mm)).take([0, 3, 6])  # one radius: h is not seen
    prior = {p.name: p.prior for p in model.parameters(data)}["thickness.relative"]
    assert prior is not None
    assert prior.std == pytest.approx(spread)
    thin = np.array([0.2, 0.48, 0.9, -0.3])
    found = fit(model, data.with_force(model.predict(thin, data)), tolerances=False)
    assert abs(found.values[-1]) < 0.3 * spread
    assert found.std("thickness.relative") == pytest.approx(spread, rel=0.1)
    assert any("thickness is fitted" in line for line in common_assumptions(found))


def test_unknown_keys_are_named() -> None:
    with pytest.raises(InputError, match="Choose among: depth_quantisation, depth_zero"):
        get_effect("phlogiston")


def test_the_tilted_punch_joins_the_upright_one_in_value_and_slope() -> None:
    theta, a = 0.01, 2.5
    depth = 2 * a * theta + np.array([-1e-6, 1e-6, 1e-3])
    data = observations([depth], [indenter()])
    force = (Model(FlatPunch()) + Tilt()).predict(np.array([0.2, 0.48, 0.0, theta, 0.0]), data)
    c = 2 * a * 0.2 * kappa(0.48, a / 3) / (1 - 0.48**2)
    np.testing.assert_allclose(force, c * depth, rtol=1e-8)
    touched = replace(data.shifted(a * theta), depth_source="stage")
    again = (Model(FlatPunch()) + Tilt()).predict(np.array([0.2, 0.48, 0.0, theta, 1.0]), touched)
    np.testing.assert_allclose(again, force, rtol=1e-8)


def test_a_rounded_edge_begins_as_a_smaller_punch_and_ends_as_the_sharp_one() -> None:
    data = observations([np.array([1e-6, 0.5, 1.0])], [indenter()])
    force = (Model(FlatPunch()) + EdgeFillet()).predict(np.array([0.2, 0.48, 0.0, 0.05, 0.0]), data)
    small = 2 * 2.45 * 0.2 * kappa(0.48, 2.45 / 3) / (1 - 0.48**2)
    sharp = 2 * 2.5 * 0.2 * kappa(0.48, 2.5 / 3) / (1 - 0.48**2)
    assert force[0] / 1e-6 == pytest.approx(small, rel=2e-3)
    assert small < force[2] < sharp * 1.0
    assert force[2] > 0.985 * sharp


def test_the_skin_weight_runs_from_nothing_to_all() -> None:
    assert weight(np.array([1e-6]))[0] == pytest.approx(0, abs=1e-5)
    assert weight(np.array([1e6]))[0] == pytest.approx(1, abs=1e-5)
    x = 0.3  # by hand at nu = .3: eq. 28 with its logarithm
    log = (1 - 0.6) * x * np.log((1 + x**2) / x**2)
    manual_checks = 2 / np.pi * np.arctan(x) + (log - x / (1 + x**2)) / (2 * np.pi * 0.7)
    assert weight(np.array([x]), 0.3)[0] == pytest.approx(manual_checks)


@each("key", ["viscoelasticity", "recovery"])
@each("time_s", [0.5, 50.0, 500.0])
def test_the_past_never_pulls_on_the_punch(key: str, time_s: float) -> None:
    effect = EFFECTS[key]
    data = replace(RICH, presses=replace(RICH.presses, rest_s=np.full(RICH.count, 1.0)))
    bare = Model(FlatPunch()).predict(BASE, data)
    rest = [p.default for p in effect.parameters[2:]]
    force = planted(effect, np.array([effect.parameters[0].bounds[1], time_s, *rest]), data)
    assert force.min() == 0.0, "no tension without adhesion"
    np.testing.assert_array_equal(force[bare == 0], 0.0, "nothing in air")
    assert np.count_nonzero(force < bare) > 100, "and yet it acts"


def test_relaxation_leaves_the_tension_of_a_clinging_gel() -> None:
    clinging = Model(FlatPunch()) + EFFECTS["adhesion"]
    both = clinging + EFFECTS["viscoelasticity"]
    tension = clinging.predict(np.append(BASE, 1e-3), RICH)
    force = both.predict(np.concatenate([BASE, [1e-3, 0.2, 1.0]]), RICH)
    assert tension.min() < 0
    np.testing.assert_array_equal(force[tension <= 0], tension[tension <= 0])


def test_the_memory_of_presses_fills_and_heals() -> None:
    data = replace(RICH, presses=replace(RICH.presses, rest_s=np.full(RICH.count, 10.0)))
    state = memory(data, 10.0)
    assert state[0] == 0
    assert state[1] == pytest.approx(np.exp(-1))
    assert state[-1] == pytest.approx(1 / (np.e - 1), rel=1e-6)


def test_only_a_spot_that_was_pressed_remembers_its_depth() -> None:
    depth = [np.array([0.1, 0.5, 0.2]), np.array([0.1, 0.3]), np.array([0.1, 0.3])]
    data = observations(depth, [indenter()] * 3, place_mm=[(0, 0), (0, 0), (5, 0)])
    np.testing.assert_allclose(largest_past_depth(data), [0.1, 0.5, 0.5, 0.5, 0.5, 0.1, 0.3])
