"""Forecasts of E, nu and c before any press: they agree with drawn calibrations, and say what stays open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from each import each

import calibration
from calibration.fit.least_squares import fit
from calibration.noise.model import Noise
from calibration.tasks.compare import base_model
from calibration.tasks.plan import (
    Design,
    Goal,
    PressNoise,
    fewest_presses,
    forecast,
    forecast_data,
    forecast_fit,
    least_repeats,
    plan,
)
from tactilevision.errors import InputError
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter

HEIGHTS = (0.15, 0.3, 0.4, 0.5, 0.6)
GEL = Gel(3.0, shape="disc", radius_mm=15.0)
KNOWN = replace(GEL, poisson_ratio=0.48, poisson_ratio_std=0.002)


def design(radii: tuple[float, ...] = (2.5,), heights: tuple[float, ...] = HEIGHTS, **what: Any) -> Design:
    edge = what.pop("edge", None)
    faces = tuple(
        Indenter(f"{a:g} {h:g}", radius_mm=a, height_mm=h, edge_radius_mm=edge) for a in radii for h in heights
    )
    return Design(what.pop("gel", GEL), faces, **what)


def drawn_values(one: Design, count: int, rng: np.random.Generator) -> Floats:
    """E, nu and beta (count, p) of calibrations of drawn depths and forces of a gel of E = .2 MPa, nu = .48."""
    clean, truth = forecast_data(one, 0.2, poisson_ratio=0.48), forecast_fit(one, 0.2, poisson_ratio=0.48).values
    model, noise = base_model(clean), Noise(1.0)
    rows = []
    for _ in range(count):
        reached = clean.shifted(rng.normal(0, clean.depth_std_mm))
        force = model.predict(truth, reached) + rng.normal(0, clean.force_std_N)
        rows.append(fit(model, clean.with_force(force), noise=noise, starts=truth).values)
    return np.array(rows)


def test_the_forecast_is_the_scatter_of_drawn_calibrations() -> None:
    one, count = design(heights=(0.3, 0.6), repeats=4), 12
    moduli, std = drawn_values(one, count, np.random.default_rng())[:, 0], forecast(one).c.std
    assert std is not None
    assert np.std(moduli, ddof=1) / 0.2 == pytest.approx(std, rel=0.85)  # 4 std of a scatter of 12
    assert abs(np.mean(moduli) / 0.2 - 1) < 5 * std / np.sqrt(count)


@pytest.mark.slow
@pytest.mark.parametrize("heights", [(0.15, 0.6), HEIGHTS])
@pytest.mark.parametrize("repeats", [1, 9])
def test_the_forecast_is_the_scatter_of_many(heights: tuple[float, ...], repeats: int) -> None:
    one = design(heights=heights, repeats=repeats)
    moduli = drawn_values(one, 400, np.random.default_rng())[:, 0]
    assert np.std(moduli, ddof=1) / 0.2 == pytest.approx(forecast(one).c.std, rel=0.15)


@pytest.mark.slow
def test_nu_of_three_radii_scatters_as_forecast() -> None:
    one = design((1.5, 2.5, 3.5), repeats=100, lubricated=True, edge=0.0)
    ratios = drawn_values(one, 100, np.random.default_rng())[:, 1]
    assert np.std(ratios, ddof=1) == pytest.approx(forecast(one).poisson_ratio.std, rel=0.3)


def test_four_times_the_presses_halve_the_deviation() -> None:
    few, many = (forecast(design(repeats=n)).c for n in (3, 12))
    assert few.std is not None
    assert many.std == pytest.approx(few.std / 2, rel=1e-6)
    assert many.half_width == pytest.approx(few.half_width / 2, rel=0.05)  # Student's t falls a little too


def test_one_punch_leaves_nu_open_however_often_it_presses() -> None:
    often = forecast(design(heights=(0.3, 0.6), repeats=1000))
    assert often.nu_is_open
    assert often.youngs_modulus.std is None
    assert often.c.half_width < 0.01
    assert least_repeats(design(heights=(0.3, 0.6)), Goal(0.5), most=2) is None


@pytest.mark.slow
def test_the_plan_of_one_punch_says_what_would_fix_nu() -> None:
    found = plan(design(heights=(0.3, 0.6)), goal=Goal(0.05))
    assert found.fewest is None
    reaching = [remedy for remedy in found.remedies if remedy.least is not None]
    assert any(remedy.action.startswith("know nu") for remedy in reaching)
    assert any("second radius" in remedy.action for remedy in reaching)
    assert all(remedy.least and found.goal.reached(remedy.least) for remedy in reaching)


def test_the_least_repeats_reach_the_goal_and_one_less_does_not() -> None:
    goal, one = Goal(0.05), design(gel=KNOWN, lubricated=True, edge=0.0)
    least = least_repeats(one, goal)
    assert least is not None
    assert goal.reached(least)
    assert not goal.reached(forecast(replace(least.design, repeats=least.design.repeats - 1)))
    fewest = fewest_presses(least, goal)
    assert goal.reached(fewest)
    assert fewest.design.presses <= least.design.presses


def test_more_presses_than_any_do_not_sharpen_a_stated_nu() -> None:
    loose = replace(KNOWN, poisson_ratio_std=0.01)
    found = forecast(design(gel=loose, lubricated=True, edge=0.0, repeats=1000))
    assert found.youngs_modulus.half_width > 0.05


def test_a_goal_of_c_alone_needs_no_nu() -> None:
    found = plan(design(heights=(0.3, 0.6)), goal=Goal(None, c=0.03))
    assert found.fewest is not None
    assert found.fewest.nu_is_open
    content = found.as_json()
    assert content["reached"]
    assert content["fewest"]["presses"] == found.fewest.design.presses


@each(
    "what, change",
    [
        ("reaches through the gel", {"heights": (0.3, 3.5)}),
        ("height_mm must lie between", {"heights": (-0.3, 0.5)}),
        ("step height must be above 0", {"heights": (float("nan"), 0.5)}),
        ("two step heights", {"heights": (0.3,)}),
        ("nothing to press", {"radii": ()}),
        ("radius_mm must lie between", {"radii": (0.0,)}),
        ("repeats must be above 0", {"repeats": 0}),
        ("E must be above 0", {"youngs_modulus_MPa": (float("nan"), 0.2)}),
        ("Poisson's ratio lies in", {"poisson_ratio": (0.48, 0.5)}),
        ("noise of depth must be above 0", {"noise": PressNoise(depth_std_mm=-1.0)}),
        ("as wide as the gel pad", {"radii": (16.0,)}),
    ],
)
def test_bad_input_is_told_in_one_sentence(what: str, change: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=what):
        plan(design(**change))


@pytest.mark.parametrize("goal", [Goal(0.0), Goal(float("nan")), Goal(None)])
def test_a_goal_lies_above_zero(goal: Goal) -> None:
    with pytest.raises(InputError, match="goal"):
        plan(design(), goal=goal)


def test_the_public_name_is_the_function() -> None:
    assert calibration.plan is plan
