"""Routes to Poisson's ratio that contradict each other: forces by a contact theory of its own code path."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from made_recordings import points_of, recording_of
from scipy.stats import t

from benchmarks.others_curves.law import slope_N_per_mm
from calibration.fit.least_squares import fit
from calibration.fit.profile_likelihood import profile
from calibration.inputs.observations import Measured
from calibration.laws.flat_punch import SILICONE_NU, FlatPunch
from calibration.model.composition import Model
from calibration.result.poisson_routes import CONTRADICT, of_radii
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import calibrate, observe
from calibration.tasks.compare import completed, plain_law
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Pair
from tactilevision.records.rig import Gel, Indenter

NOISE_N = 0.004
TRUTH_MPA = 0.25


def punched(
    *, nu: float, h_mm: float = 3.0, radii_mm: tuple[float, ...] = (1.5, 2.5, 3.5), gel: Gel, seed: int = 3
) -> Measured:
    """Points of Lebedev and Ufliand's punches on a layer of h_mm, whatever `gel` states."""
    rng, depth, points = np.random.default_rng(seed), np.tile(np.linspace(0.1, 0.5, 8), 2), []
    for k, a in enumerate(radii_mm):
        force = slope_N_per_mm(TRUTH_MPA, nu, a, h_mm) * depth * (1 + 0.7 * depth / h_mm)
        made = points_of(depth, force + NOISE_N * rng.standard_normal(depth.size), gel=gel)
        points += [replace(p, press=f"{k}-{p.press}", indenter=f"R{k}") for p in made.points]
    indenters = {f"R{k}": Indenter(f"R{k}", radius_mm=a, edge_radius_mm=0.0) for k, a in enumerate(radii_mm)}
    return Measured(recording_of(made.recording.sensor, indenters), points=tuple(points))


def stated(nu: float | None = None, std: float | None = None, h_mm: float = 3.0) -> Gel:
    return Gel(h_mm, 0.02, "disc", 15.0, poisson_ratio=nu, poisson_ratio_std=std)


def holds(interval: Pair | None, value: float) -> bool:
    return interval is not None and interval[0] < value < interval[1]


@lru_cache
def compressible() -> CalibrationResult:
    return calibrate(punched(nu=0.35, gel=stated()))


@lru_cache
def thinner() -> Measured:
    return punched(nu=0.482, h_mm=2.4, gel=stated(0.48, 0.005))


@pytest.mark.parametrize("nu", [0.36, 0.47, 0.4998])
def test_the_profile_is_that_of_a_refit_at_each_nu(nu: float) -> None:
    """At a known nu the law is linear in E and E beta: no iteration, and another kappa."""
    data = observe([punched(nu=nu, gel=replace(stated(), thickness_std_mm=0.0))])
    fitted = fit(Model(FlatPunch(free_poisson_ratio=True)), data)
    found = profile(fitted, "poisson_ratio")
    radii, number = np.unique(data.radius_mm, return_inverse=True)

    def least(one: float) -> float:
        stiffness = np.array([slope_N_per_mm(1.0, one, float(a), 3.0) for a in radii])
        unit = stiffness[number] * data.depth_mm
        bent = [(number == k) * unit * data.depth_mm / 3.0 for k in range(radii.size)]
        return float(np.linalg.lstsq(np.column_stack([unit, *bent]), data.normal_N, rcond=None)[1][0])

    grid = np.round(
        np.clip(found.best + (found.interval95[1] - found.best + 0.002) * np.arange(-4, 5), 0.3, 0.4999), 6
    )
    best = min(least(float(one)) for one in np.linspace(found.best - 2e-4, min(found.best + 2e-4, 0.4999), 5))
    certain = (Z95 / t.ppf(0.975, fitted.noise.dof)) ** 2
    expected = certain * np.array([least(float(one)) - best for one in grid]) / fitted.noise.scale**2
    near = (expected < 60) & (expected > 1)
    assert np.count_nonzero(near) >= 2
    assert found(grid)[near] == pytest.approx(expected[near], rel=0.06, abs=0.1)
    low, high = found.interval95
    assert low <= found.best <= high


def test_at_the_end_of_its_range_the_interval_is_one_sided() -> None:
    (route,) = of_radii(fit(Model(FlatPunch()), observe([thinner()])))
    assert route.used
    low, high = route.poisson_ratio.interval95 or (0.0, 0.0)
    assert route.poisson_ratio.value == pytest.approx(0.4999, abs=1e-6)
    assert high == pytest.approx(0.4999)
    assert 0.48 < low < high


def test_radii_below_the_bound_of_elastomers_contradict_it() -> None:
    result = compressible()
    assert {CONTRADICT, "nu_below_bound"} <= set(result.flags)
    assert holds(result.poisson_ratio.interval95, 0.35)
    assert holds(result.poisson_ratio.interval95, 0.45)
    assert holds(result.youngs_modulus.interval95, TRUTH_MPA)
    (said,) = (line for line in result.warnings if "contradict" in line)
    assert "0.45 to 0.4999" in said
    assert "the several radii 0.3" in said
    assert not any("too little" in line for line in (result.poisson_ratio.why, *result.assumptions))


def test_without_the_bound_the_radii_alone_determine_it() -> None:
    result = calibrate(punched(nu=0.35, gel=stated()), bound=None)
    assert result.flags == ()
    assert result.poisson_ratio.value == pytest.approx(0.35, abs=0.02)
    assert holds(result.youngs_modulus.interval95, TRUTH_MPA)


def test_a_wrong_thickness_that_pushes_to_the_end_of_the_range_is_within_e() -> None:
    result = calibrate(thinner())
    assert CONTRADICT in result.flags
    assert holds(result.youngs_modulus.interval95, TRUTH_MPA)
    assert any("thickness" in line and "0.4800 ± 0.005" in line for line in result.warnings)
    compared = completed(plain_law(observe([thinner()])), np.random.default_rng(0)).models[0].material
    assert compared is not None
    assert CONTRADICT in compared.flags
    assert holds(compared.youngs_modulus.interval95, TRUTH_MPA)


@pytest.mark.parametrize("gel", [stated(), stated(0.482, 0.005)])
def test_routes_that_agree_stay_as_they_are(gel: Gel) -> None:
    result = calibrate(punched(nu=0.482, gel=gel))
    assert CONTRADICT not in result.flags
    assert holds(result.youngs_modulus.interval95, TRUTH_MPA)


def test_radii_whose_likelihood_is_flat_say_so() -> None:
    measured = punched(nu=0.48, radii_mm=(2.5, 2.52), gel=stated())
    (route,) = of_radii(fit(Model(FlatPunch(free_poisson_ratio=True)), observe([measured])))
    assert not route.used
    assert "flat" in route.poisson_ratio.why
    assert calibrate(measured).poisson_ratio.interval95 == SILICONE_NU
