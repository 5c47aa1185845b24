"""An E that no gel has is warned of, and left as it was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_recordings import HEIGHTS_MM, Truth, draw, points_of

from calibration.inputs.observations import Measured
from calibration.laws.theory import FLAG, GEL_MODULUS_MPA, NU_FLAG, outside_gels
from calibration.report.diagnosis_report import verdict_sentence
from calibration.result.material import RADII_FLAG as APART
from calibration.tasks.calibrate import calibrate, observe
from calibration.tasks.diagnose import diagnose
from tactilevision.records.measured import Estimate
from tactilevision.records.rig import Gel

DEPTHS = np.array(HEIGHTS_MM)
FORCES = 3.5 * DEPTHS * (1 + DEPTHS / 3)
GEL = Gel(3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)


@each("law", ["default", "paper"])
@each("unit", [1e3, 1e-3])
def test_forces_in_another_unit_are_asked_about(unit: float, law: str) -> None:
    right, wrong = (calibrate(points_of(DEPTHS, k * FORCES, gel=GEL), law=law, test=False) for k in (1.0, unit))
    assert not any("no gel" in line for line in right.warnings)
    assert FLAG not in right.flags
    assert any("are forces in N" in line for line in wrong.as_json()["warnings"])
    assert FLAG in wrong.flags
    assert wrong.youngs_modulus.value == pytest.approx(unit * (right.youngs_modulus.value or 0), rel=0.02)


@each("nu, std, told", [(0.0, None, True), (0.2, 0.01, True), (0.25, 0.1, False), (0.4, None, False)])
def test_a_stated_nu_that_no_gel_has_is_flagged_and_said(nu: float, std: float | None, told: bool) -> None:
    gel = replace(GEL, poisson_ratio=nu, poisson_ratio_std=std)
    result = calibrate(points_of(DEPTHS, FORCES, gel=gel), test=False)
    assert (NU_FLAG in result.flags) is told
    assert any("rubbers and gels have" in line for line in result.warnings) is told


def test_a_diagnosis_says_that_its_modulus_rests_on_such_a_nu() -> None:
    data = observe([points_of(DEPTHS, FORCES, gel=replace(GEL, poisson_ratio=0.0))])
    found = diagnose(data, np.random.default_rng(0))
    assert NU_FLAG in found.flags
    assert "rubbers and gels have" in verdict_sentence(found)


def test_an_open_modulus_is_judged_by_its_interval() -> None:
    low, high = GEL_MODULUS_MPA
    across = Estimate(None, None, (low / 2, high / 2), "MPa", "open")
    assert outside_gels(across) == ""
    assert "12 to 30 MPa" in outside_gels(replace(across, interval95=(12.0, 30.0)))
    assert outside_gels(replace(across, interval95=None)) == ""
    assert outside_gels(Estimate(1.01 * low, None, None, "MPa")) == ""
    assert outside_gels(Estimate(0.99 * low, None, None, "MPa"))


def test_a_stated_modulus_that_the_result_contradicts_is_told() -> None:
    found = calibrate(points_of(DEPTHS, FORCES, gel=GEL), test=False).youngs_modulus.value or 0.0
    for stated, told in ((found, False), (3 * found, True)):
        gel = replace(GEL, youngs_modulus_MPa=stated, youngs_modulus_std_MPa=0.01 * found)
        result = calibrate(points_of(DEPTHS, FORCES, gel=gel), test=False)
        assert any("but [sensor.gel] states" in line for line in result.warnings) is told
        assert result.youngs_modulus.value == pytest.approx(found)


def test_a_slope_at_the_end_of_its_range_is_told() -> None:
    """A thickness a thousand times too large: no beta bends the force as these do."""
    thick = calibrate(points_of(DEPTHS, FORCES, gel=replace(GEL, thickness_mm=3000.0)))
    assert "beta_at_bound" in thick.flags
    assert any("stands at the end of its range" in line for line in thick.warnings)
    assert "beta_at_bound" not in calibrate(points_of(DEPTHS, FORCES, gel=GEL), test=False).flags


def test_a_diagnosis_is_not_adequate_where_the_slope_stands_at_its_end() -> None:
    """The paper's five points, and a thickness in micrometres: once ADEQUATE."""
    points = np.array([[0.15, 0.5636], [0.3, 1.2063], [0.4, 1.6786], [0.5, 2.186], [0.6, 2.7285]])
    data = observe([points_of(*points.T, gel=replace(GEL, thickness_mm=3000.0))])
    found = diagnose(data, np.random.default_rng(0))
    assert found.verdict == "AMBIGUOUS"
    assert "thickness" in found.candidates
    assert "or a wrong unit" in verdict_sentence(found)
    assert NU_FLAG not in found.flags
    assert "rubbers and gels have" not in verdict_sentence(found), "of a nu that gels have"


def of_three_radii(stated: dict[float, float]) -> Measured:
    """Presses of 1.5, 2.5 and 3.5 mm punches, some of which recording.toml states with another radius."""
    measured = draw(Truth(radii_mm=(1.5, 2.5, 3.5), repeats=1), np.random.default_rng(2))
    indenters = {
        name: replace(indenter, radius_mm=stated.get(indenter.radius_mm or 0.0, indenter.radius_mm))
        for name, indenter in measured.recording.indenters.items()
    }
    return replace(measured, recording=replace(measured.recording, indenters=indenters))


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        ({1.5: 0.75}, True),
        pytest.param({3.5: 7.0}, True, marks=pytest.mark.slow),
        pytest.param({1.5: 0.75, 2.5: 1.25, 3.5: 1.75}, True, marks=pytest.mark.slow),
        ({1.5: 1.55}, False),
    ],
)
def test_radii_that_no_one_gel_has_are_told(stated: dict[float, float], *, told: bool) -> None:
    result = calibrate(of_three_radii(stated), test=False)
    assert (APART in result.flags) is told
    assert any("is one a diameter?" in line for line in result.as_json()["warnings"]) is told
