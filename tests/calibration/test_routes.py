"""Routes to Poisson's ratio: weighed by what each is worth, none dropped, none used that cannot tell."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from made_recordings import Truth, draw

from calibration.inputs.observations import Measured
from calibration.laws import theory as admissible_range
from calibration.laws.flat_punch import SILICONE_NU
from calibration.result.material import joint_region
from calibration.result.poisson_routes import informed, of_beta
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import calibrate, observe
from calibration.tasks.compare import completed, plain_law
from calibration.tasks.diagnose import diagnose
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records.measured import Estimate, Material

OPEN = Truth(extra={"lubricated": 1.0}, thickness_std_mm=0.0, radius_std_mm=0.0, states_poisson=False)
STATED = replace(OPEN, states_poisson=True, poisson_std=0.01)


def bulge(value: float, std: float) -> Estimate:
    return Estimate(value, std, (value - 1.96 * std, value + 1.96 * std), "1")


def drawn(truth: Truth) -> Measured:
    return draw(truth, np.random.default_rng(11))


def test_the_picture_fixes_what_one_punch_leaves_open() -> None:
    result = calibrate(drawn(OPEN), bulge=bulge(0.478, 0.003))
    assert result.poisson_ratio_source == "bulge"
    assert result.poisson_ratio.value == pytest.approx(0.478, abs=1e-3)
    low, high = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert low < OPEN.modulus_MPa < high < 1.15 * low
    assert [route.name for route in result.routes if route.used] == ["bulge"]


@pytest.mark.parametrize(("std", "source"), [(0.003, "bulge"), (0.03, "prior")])
def test_the_source_is_the_tightest_route(std: float, source: str) -> None:
    measured = drawn(STATED)
    gel = measured.recording.sensor.gel
    assert gel is not None
    result = calibrate(measured, bulge=bulge((gel.poisson_ratio or 0) - 0.001, std))
    assert result.poisson_ratio_source == source
    assert (result.poisson_ratio.std or 1) < min(std, STATED.poisson_std)
    content = result.as_json()
    assert {r["route"]: r["used"] for r in content["poisson_ratio_routes"]} == {
        "bulge": True,
        "prior": True,
        "beta": False,
    }
    assert content["routes_apart_sigma"] < 3


def test_a_diagnosis_names_the_source_as_calibrate_does() -> None:
    measured, rng = drawn(OPEN), np.random.default_rng(0)
    found = diagnose(observe([measured]), rng, bulge=bulge(0.478, 0.003))
    assert (found.material.before.poisson_ratio_source, found.material.after.poisson_ratio_source) == (
        "bulge",
        "bulge",
    )
    stated = diagnose(observe([drawn(STATED)]), rng)
    assert stated.material.after.poisson_ratio_source == "prior"


def test_routes_that_contradict_each_other_widen_the_interval_and_say_so() -> None:
    result = calibrate(drawn(STATED), bulge=bulge(0.42, 0.003))
    assert any("contradict" in line for line in result.warnings)
    alone = calibrate(drawn(STATED), bulge=bulge(0.478, 0.003))
    assert (result.poisson_ratio.std or 0) > 3 * (alone.poisson_ratio.std or 1)


def test_pictures_and_a_statement_that_contradict_each_other_are_both_in_what_is_handed_on() -> None:
    """What `diagnose` and `compare` fit with."""
    gel = informed(observe([drawn(STATED)]), bulge(0.42, 0.003)).gel
    assert gel.poisson_ratio is not None
    assert gel.poisson_ratio_std is not None
    far = max(abs(gel.poisson_ratio - nu) for nu in (0.42, STATED.poisson_ratio))
    assert far < 1.96 * gel.poisson_ratio_std


@lru_cache
def stated_wrongly() -> Measured:
    """Three radii on a gel of another nu than is stated as sure."""
    several = drawn(replace(OPEN, radii_mm=(1.5, 2.5, 3.5)))
    sensor = several.recording.sensor
    assert sensor.gel is not None
    gel = replace(sensor.gel, poisson_ratio=0.40, poisson_ratio_std=0.004)
    return replace(several, recording=replace(several.recording, sensor=replace(sensor, gel=gel)))


@lru_cache
def calibrated_wrongly() -> CalibrationResult:
    return calibrate(stated_wrongly(), test=False)


def test_a_comparison_reaches_to_each_route_as_a_calibration_does() -> None:
    compared = completed(plain_law(observe([stated_wrongly()])), np.random.default_rng(0))
    found = compared.models[0].material
    alone = calibrated_wrongly()
    assert found is not None
    assert any("widened to reach to each" in line for line in found.warnings)
    assert found.poisson_ratio.interval95 == pytest.approx(alone.poisson_ratio.interval95, abs=0.003)
    assert found.youngs_modulus.interval95 == pytest.approx(alone.youngs_modulus.interval95, rel=0.02)


def test_a_stated_nu_that_the_radii_contradict_is_in_the_interval_beside_theirs() -> None:
    """A wrong nu, stated as sure: it and the radii's own, which is right, are held; E reaches as far."""
    result = calibrated_wrongly()
    assert any("widened to reach to each" in line for line in result.warnings)
    low, high = result.poisson_ratio.interval95 or (0.0, 0.0)
    known = [r.poisson_ratio.value for r in result.routes if r.used and r.poisson_ratio.value]
    assert low < min(known) < max(known) < high
    assert max(known) == pytest.approx(OPEN.poisson_ratio, abs=0.01)
    lowest, highest = result.youngs_modulus.interval95 or (0.0, 0.0)
    assert lowest < dict(result.youngs_modulus_of_nu)[0.48] < highest


def test_a_picture_that_cannot_tell_changes_nothing() -> None:
    nothing = Estimate(None, None, (0.3, 0.5), "1", "the rise around the punch is below the noise of the maps")
    result, plain = (calibrate(drawn(STATED), bulge=b) for b in (nothing, None))
    assert result.poisson_ratio == plain.poisson_ratio
    assert result.poisson_ratio_source == "prior"
    assert any("below the noise" in line for line in result.assumptions)


def test_the_bound_of_elastomers_cuts_off_what_lies_below_it_and_no_more() -> None:
    wide = calibrate(drawn(OPEN), bulge=bulge(0.46, 0.03))
    open_ = calibrate(drawn(OPEN), bulge=bulge(0.46, 0.03), bound=None)
    assert (wide.poisson_ratio.std or 1) < 0.8 * (open_.poisson_ratio.std or 0)
    assert (wide.poisson_ratio.value or 0) > 0.47
    assert [route.name for route in wide.routes if route.used] == ["bulge", "prior"]
    assert wide.poisson_ratio_source == "bulge"
    assert any("a bound of elastomers, no measurement" in line for line in wide.assumptions)
    near, free = (calibrate(drawn(OPEN), bulge=bulge(0.478, 0.003), bound=b) for b in (SILICONE_NU, None))
    assert near.poisson_ratio == free.poisson_ratio
    assert [route.name for route in free.routes] == ["bulge", "beta"]


def test_a_nu_below_the_bound_is_kept_widened_and_flagged() -> None:
    low = calibrate(drawn(OPEN), bulge=bulge(0.42, 0.003))
    assert low.poisson_ratio.value == pytest.approx(0.42, abs=0.002)
    assert low.poisson_ratio.std == pytest.approx(0.015, rel=0.1)
    assert "nu_below_bound" in low.flags
    assert any("--no-prior" in line for line in low.warnings)
    alone = calibrate(drawn(OPEN), bulge=bulge(0.42, 0.003), bound=None)
    assert alone.poisson_ratio.std == pytest.approx(0.003, rel=0.1)
    assert "nu_below_bound" not in alone.flags


def test_a_stated_nu_takes_the_place_of_the_bound() -> None:
    stated = calibrate(drawn(STATED), bulge=bulge(0.42, 0.02))
    without = calibrate(drawn(STATED), bulge=bulge(0.42, 0.02), bound=None)
    assert stated.poisson_ratio == without.poisson_ratio


def test_where_nothing_fixes_nu_the_bound_is_all_that_holds_it() -> None:
    held, open_ = (calibrate(drawn(OPEN), bound=b) for b in (SILICONE_NU, None))
    assert held.poisson_ratio.value is None
    assert open_.poisson_ratio.interval95 == (0.3, 0.4999)
    low, high = held.youngs_modulus.interval95 or (0.0, 0.0)
    lower, higher = open_.youngs_modulus.interval95 or (0.0, 0.0)
    assert lower < high < higher
    assert higher - lower > 1.5 * (high - low)


def test_radii_stand_beside_the_picture() -> None:
    several = replace(OPEN, radii_mm=(1.5, 2.5, 3.5))
    result = calibrate(drawn(several), bulge=bulge(several.poisson_ratio, 0.003))
    assert {route.name for route in result.routes} == {"bulge", "prior", "radii", "beta"}
    low, high = result.poisson_ratio.interval95 or (0.0, 0.0)
    assert low < several.poisson_ratio < high


def test_beta_is_shown_and_never_used() -> None:
    (route,) = of_beta(Estimate(1.5071, 0.05, (1.41, 1.61), "1"))
    assert route.poisson_ratio.value == pytest.approx(0.4797, abs=1e-4)
    assert not route.used
    assert of_beta(Estimate(0.1, 0.2, (-0.3, 0.5), "1")) == ()


def test_the_joint_region_follows_the_curve_and_is_narrower_than_either_interval_says() -> None:
    result = calibrate(drawn(OPEN), bulge=bulge(0.478, 0.005))
    _, region = joint_region(result)
    assert result.material is not None
    nu, modulus = region.T
    assert nu.min() < 0.478 < nu.max()
    assert np.corrcoef(nu, modulus)[0, 1] < -0.5, "E falls as nu grows"
    area = 0.5 * abs(float(nu @ np.roll(modulus, 1) - modulus @ np.roll(nu, 1)))
    box = np.ptp(nu) * np.ptp(modulus)
    assert area < 0.7 * box


def test_the_joint_region_spans_what_silicones_span_where_nothing_fixes_nu() -> None:
    result = calibrate(drawn(OPEN))
    _, region = joint_region(result)
    assert result.material is None
    assert (region[:, 0].min(), region[:, 0].max()) == pytest.approx((0.45, 0.4999))
    valued = [route for route in result.routes if route.poisson_ratio.value is not None]
    assert [route.used for route in valued] == [False], "beta is drawn, and not used"


def test_the_largest_beta_is_looked_for_over_the_whole_range_of_nu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admissible_range, "HIGHEST", (1.0, 1.0, 1.0, 1.3, 1.0))
    assert admissible_range.beta_range((0.45, 0.495), 0.83) == (admissible_range.LOWEST[-1], 1.3)
    least, largest = admissible_range.beta_range((0.485, 0.495), 0.83) or (0.0, 0.0)
    assert least == admissible_range.LOWEST[-1]
    assert largest == pytest.approx(1.2)
    assert admissible_range.beta_range((0.45, 0.495), 2.0) is None


def test_a_sharp_punch_that_slides_freely_is_within_theory() -> None:
    """The tables' own force: without friction a nearly incompressible gel gives way as it is pressed."""
    contact, material = FlatContact(1.5, 0.0, 3.0, 0.0), Material(0.2, 0.48)
    strain = np.linspace(0.05, 0.2, 8)
    slope, start = np.polyfit(strain, punch_force(3 * strain, contact, material=material) / strain, 1)
    allowed = admissible_range.beta_range((0.475, 0.485), 0.5)
    assert allowed is not None
    assert allowed[0] <= slope / start < 0
