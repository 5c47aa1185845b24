"""The blind test's own mechanics against printed figures and exact limits."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from each import each

from benchmarks.blind import figures, layer
from benchmarks.blind.design import DESIGNS, Touch
from benchmarks.blind.rig import Noise, add_noise, read
from benchmarks.blind.signal import set_stage, sized
from benchmarks.blind.world import HIDDEN, draw_world

ROOT = Path(__file__).parents[2]
BLIND = sorted((ROOT / "benchmarks" / "blind").glob("*.py"))


def test_only_the_analysts_import_the_analyst() -> None:
    """The recordings are made without a line of calibration."""
    for path in BLIND:
        names = [n for node in ast.walk(ast.parse(path.read_text())) for n in _imported(node)]
        assert path.name == "analyst.py" or not any(n.startswith("calibration") for n in names), path


def _imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) else []


def test_force_is_that_of_the_printed_finite_elements() -> None:
    """NGSolve's sticking neo-Hookean row, within the .2 % that a parabola and the table of kappa leave."""
    depth = np.array(figures.PRINTED_DEPTHS_MM)
    ratio = np.full(5, 2.5 / 3)
    bent = figures.PRINTED_START_MM * figures.bend(depth / 3, ratio, straight=False)
    np.testing.assert_allclose(bent, figures.PRINTED_P_OVER_EW_MM, rtol=3e-3)
    slope = figures.slope_N_per_mm(1.0, 0.4797, np.array(2.5), np.array(3.0))
    assert slope == pytest.approx(18.25, rel=2e-3)  # Hayes, P/(E w) as w goes to 0


def test_punch_on_layer_is_hayes_and_a_coat_only_stiffens() -> None:
    """The energy method against kappa(.48, 2.5/3), 1e-3; a thicker coat is never softer, and none is nothing."""
    exact = 2 * 2.5 * 2.8125068 / (1 - 0.48**2)
    assert layer.stiffness_of_coated(2.5, 3.0, 0.0) == pytest.approx(exact, rel=1e-3)
    factors = [layer.coat_factor(2.5, 3.0, bending) for bending in (1e-9, 1e-7, 1e-5, 1e-3)]
    assert factors == sorted(factors)
    assert factors[0] == pytest.approx(1, abs=2e-3)
    assert layer.coat_factor(1.5, 3.0, 1e-4) > layer.coat_factor(3.5, 3.0, 1e-4)


def test_a_punch_askew_is_upright_once_its_face_lies_whole() -> None:
    """A flat punch's pressure (w + 2 theta x)/sqrt(a^2 - r^2) is nowhere negative from w = 2 a theta on."""
    place, upright = layer.askew(0.5)
    whole = place >= 2
    np.testing.assert_allclose(upright[whole], place[whole], rtol=1e-3)
    assert upright[0] == pytest.approx(0, abs=1e-6)
    assert np.all(np.diff(upright) > 0)
    assert np.all(upright >= place - 1e-3)  # without tension the gel pushes more, never less


def test_a_rounded_edge_takes_less_the_deeper_and_the_sharper_it_is() -> None:
    """Nothing where it is sharp; at the solved places what elements gave (17.0702 over 17.6334 N/mm at .4 mm)."""
    strain = np.linspace(0.005, 0.2, 30)
    left = np.array([figures.rounded(edge / 3, strain, 2.5 / 3) for edge in (1e-4, 0.05, 0.1, 0.2, 0.5)])
    np.testing.assert_allclose(left[0], 1, atol=1e-3)
    assert np.all(np.diff(left, axis=0) < 0)
    assert np.all(np.diff(left[2:], axis=1) > 0)
    at = [float(figures.rounded(edge / 3, np.array([0.4 / 3]), 2.5 / 3)[0]) for edge in (0.2, 0.1)]
    assert at[0] / at[1] == pytest.approx(17.0702 / 17.6334, rel=1e-4)


@pytest.mark.parametrize("design", list(DESIGNS))
def test_a_world_with_everything_at_nothing_is_the_clean_one(design: str) -> None:
    rng = np.random.default_rng(3)
    plan, world = DESIGNS[design](rng), draw_world(rng)
    clean = read(world, plan)
    nothing = read(replace(world, amounts=dict.fromkeys(HIDDEN, 0.0)), plan)
    np.testing.assert_array_equal(nothing.force_N, clean.force_N)
    np.testing.assert_array_equal(nothing.depth_mm, clean.depth_mm)
    assert clean.force_N[:, :, 2].max() < 6
    assert np.all(np.diff(clean.time_s.ravel()) > 0)  # one clock, never anew


@each("key", [k for k in HIDDEN if k not in ("skin", "adhesion", "backing_compliance")])
def test_what_is_hidden_shows_as_strongly_as_asked(key: str) -> None:
    """Sized to 10 sigma; within a fifth, or at an end of the effect's range."""
    rng = np.random.default_rng(5)
    plan, world = DESIGNS["rich"](rng), draw_world(rng)
    world = replace(world, source=HIDDEN[key].source)
    stage = set_stage(world, plan, Noise())
    found = sized(stage, world.with_amount(key, HIDDEN[key].low), key, 10.0)
    strength, amount = stage.strength(found), found.amount(key)
    assert HIDDEN[key].low <= amount <= HIDDEN[key].high
    assert strength == pytest.approx(10, rel=0.2) or amount > 0.97 * HIDDEN[key].high
    assert stage.strength(world) == 0


def test_a_relaxing_gel_tends_to_its_long_term_force() -> None:
    """After a hold of twenty time constants 1 - g of the force is left."""
    plan = DESIGNS["plain"](np.random.default_rng(0))
    plan = replace(plan, touches=(Touch(2.5, 0.5, 5.0, hold_s=20.0),), load=(0.5,), hold=(1.0,))
    world = replace(draw_world(np.random.default_rng(1)), shapes={"tau_s": 1.0})
    elastic = read(world, plan).force_N[0, -1, 2]
    relaxed = read(world.with_amount("viscoelasticity", 0.1), plan).force_N[0, -1, 2]
    assert relaxed / elastic == pytest.approx(0.9, abs=1e-4)


@pytest.mark.parametrize("kind", ["white", "ar1", "heavy"])
def test_noise_is_as_large_as_it_says(kind: str) -> None:
    rng = np.random.default_rng(9)
    plan, world = DESIGNS["rich"](rng), draw_world(rng)
    clean = read(world, plan)
    noise = Noise(gain=0.0, kind=kind)
    many = [add_noise(clean, noise, rng) for _ in range(30)]
    errors = np.array([m.force_N[:, :, 2] - clean.force_N[:, :, 2] for m in many])
    zeros = np.array([m.depth_mm[:, 0] - clean.depth_mm[:, 0] for m in many])
    assert errors.std() == pytest.approx(noise.sample_N, rel=0.1)
    assert zeros.std() == pytest.approx(noise.zero_mm, rel=0.1)
    neighbours = np.mean(errors[:, :, 1:] * errors[:, :, :-1]) / errors.var()
    assert neighbours == pytest.approx(0.6 if kind == "ar1" else 0, abs=0.05)
