"""Balls and cones: the exact contact comes back, thick gels are Hertz' and Sneddon's, and what is open is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from each import each
from made_recordings import points_of

from calibration.inputs.observations import Measured
from calibration.laws.round_bodies import _force_over_E, _table
from calibration.result.material import stuck_surplus
from calibration.tasks.calibrate import calibrate
from tactilevision.errors import InputError
from tactilevision.mechanics.round_contact import Ball, Cone, contact_curve
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter

DEPTHS = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
E_MPA, NU = 0.2, 0.478
KNOWN = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=NU, poisson_ratio_std=0.002)
BODIES: dict[str, tuple[Ball | Cone, Indenter]] = {
    "sphere": (Ball(3.0), Indenter("body", "sphere", 3.0)),
    "cone": (Cone(70.0), Indenter("body", "cone", half_angle_deg=70.0)),
}


def over_E(body: Ball | Cone, depth_mm: Floats, thickness_mm: float = 3.0, nu: float = NU) -> Floats:
    return contact_curve(body, depth_mm, thickness_mm=thickness_mm, poisson_ratio=nu).force_over_E_mm2


def forces(body: Ball | Cone) -> Floats:
    return E_MPA * over_E(body, DEPTHS)


def measured(shape: str, force_N: Floats, gel: Gel = KNOWN) -> Measured:
    made = points_of(DEPTHS, force_N, gel=gel)
    names = {name: replace(BODIES[shape][1], name=name) for name in made.recording.indenters}
    return replace(made, recording=replace(made.recording, indenters=names))


@pytest.mark.parametrize("shape", BODIES)
def test_the_exact_contact_comes_back(shape: str) -> None:
    result = calibrate(measured(shape, forces(BODIES[shape][0])))
    assert result.law == shape
    assert result.youngs_modulus.value == pytest.approx(E_MPA, rel=2e-3)
    assert result.beta.value == pytest.approx(0.0, abs=0.02)
    assert result.c.value is None
    assert "no stiffness at depth 0" in result.c.why
    low, high = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert low < E_MPA < high


@pytest.mark.parametrize("shape", BODIES)
def test_without_a_prior_only_the_curve_is_given(shape: str) -> None:
    result = calibrate(measured(shape, forces(BODIES[shape][0]), Gel(3.0)))
    assert result.youngs_modulus.value is None
    assert result.poisson_ratio.interval95 == (0.45, 0.4999)
    low, high = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert low < E_MPA < high
    curve = np.array(result.youngs_modulus_of_nu)
    assert float(np.interp(NU, *curve.T)) == pytest.approx(E_MPA, rel=5e-3)
    json.dumps(result.as_json())


@pytest.mark.parametrize("shape", BODIES)
def test_a_thick_gel_is_a_half_space(shape: str) -> None:
    body = BODIES[shape][0]
    thick = _force_over_E(body, 300.0, NU, DEPTHS)
    hertz = 4 / 3 * np.sqrt(3.0) * DEPTHS**1.5
    exact = (hertz if isinstance(body, Ball) else 2 / np.pi * np.tan(np.radians(70.0)) * DEPTHS**2) / (1 - NU**2)
    share = 0.04 if shape == "sphere" else 0.01  # Hertz' ball is a parabola, ours a sphere
    np.testing.assert_allclose(thick, exact, rtol=share)


def test_the_table_of_a_fit_is_the_contact_itself() -> None:
    depth = np.array([1e-5, 0.011, 0.17, 0.333, 0.6])  # the first lies below the table, where a power law goes on
    for body, _ in BODIES.values():
        exact = over_E(body, depth)
        found = _force_over_E(body, 3.0, NU, depth)
        np.testing.assert_allclose(found[1:], exact[1:], rtol=1e-3)
        assert found[0] == pytest.approx(exact[0], rel=0.03)


def test_a_cone_needs_its_angle() -> None:
    made = measured("cone", forces(BODIES["cone"][0]))
    bare = {name: replace(one, half_angle_deg=None) for name, one in made.recording.indenters.items()}
    with pytest.raises(InputError, match="angle"):
        calibrate(replace(made, recording=replace(made.recording, indenters=bare)))


def test_a_ball_is_refused_where_a_flat_law_was_asked_for() -> None:
    with pytest.raises(InputError, match="flat_cylinder"):
        calibrate(measured("sphere", forces(BODIES["sphere"][0])), law="flat_punch")


STUCK = {  # finite elements of balls: P_stick/P_free - 1 at w/h = .1 .15 .2, by R/h and nu
    (1.0, 0.48): (0.0104, 0.0250, 0.0463),
    (3.0, 0.48): (0.0272, 0.0595, 0.0993),
    (2.0, 0.45): (0.0070, 0.0210, 0.0395),
    (1.0, 0.4999): (0.0162, 0.0348, 0.0614),
    (3.0, 0.4999): (0.0454, 0.0909, 0.1471),
}


@each("case", STUCK)
def test_a_ball_that_sticks_pushes_back_as_elements_say(case: tuple[float, float]) -> None:
    ratio, nu = case
    np.testing.assert_allclose(
        stuck_surplus(nu, ratio, w_over_h=np.array([0.1, 0.15, 0.2])), STUCK[case], rtol=0.36
    )


def test_a_gel_that_sticks_to_the_ball_lies_inside_the_interval() -> None:
    """Elements of a ball of R = h, nu = .48, to w/h = .2: the value is low, the interval holds the truth."""
    depth = np.array([0.09, 0.18, 0.3, 0.45, 0.6])
    surplus = np.array([0.0021, 0.0042, *STUCK[1.0, 0.48]])
    force = E_MPA * over_E(Ball(3.0), depth, nu=0.48)
    made = points_of(depth, force * (1 + surplus), gel=replace(KNOWN, poisson_ratio=0.48, poisson_ratio_std=1e-4))
    names = {name: replace(BODIES["sphere"][1], name=name) for name in made.recording.indenters}
    result = calibrate(replace(made, recording=replace(made.recording, indenters=names)))
    low, high = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert result.youngs_modulus.value is not None
    assert result.youngs_modulus.value < 0.992 * E_MPA
    assert low < E_MPA < high
    assert any("may be higher" in line for line in result.assumptions)


@pytest.mark.slow
def test_the_command_reads_a_ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tactilevision.cli import main

    folder = tmp_path / "ball"
    folder.mkdir()
    (folder / "recording.toml").write_text(
        'format = 1\nname = "ball"\n[sensor]\nkind = "gelslim3"\nmm_per_px = 0.0634\n[sensor.gel]\n'
        "thickness_mm = 3.0\npoisson_ratio = 0.478\npoisson_ratio_std = 0.002\n"
        '[indenter.B]\nshape = "sphere"\nradius_mm = 3.0\n'
    )
    rows = [f"{k},B,{w},{p}" for k, (w, p) in enumerate(zip(DEPTHS, forces(Ball(3.0)), strict=True), 1)]
    (folder / "points.csv").write_text("press,indenter,depth_mm,fz_N\n" + "\n".join(rows) + "\n")
    monkeypatch.setattr("sys.argv", ["tactilevision", "calibrate", str(folder), "--out", str(tmp_path / "out")])
    assert main() == 0
    content = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert content["law"] == "sphere"
    assert content["youngs_modulus_MPa"]["value"] == pytest.approx(E_MPA, rel=2e-3)


def test_balls_and_gels_that_a_fit_tries_share_few_tables() -> None:
    rng = np.random.default_rng(5)
    _table.cache_clear()
    for radius, thickness in rng.uniform(0.99, 1.01, (20, 2)):
        depth = np.array([0.05, 0.2, 0.5])
        got = _force_over_E(Ball(3.0 * radius), 3.0 * thickness, NU, depth)
        np.testing.assert_allclose(got, over_E(Ball(3.0 * radius), depth, 3.0 * thickness), rtol=2e-5)
    assert _table.cache_info().misses < 20
