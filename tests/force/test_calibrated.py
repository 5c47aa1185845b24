"""Materials out of calibration files, whole and broken."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.force.calibrated import read_material

E = {"value": 0.2, "std": 0.01, "interval95": [0.18, 0.22], "unit": "MPa"}
NU = {"value": 0.48, "std": 0.005, "interval95": [0.47, 0.49], "unit": ""}


def written(folder: Path, content: Any) -> Path:
    path = folder / "calibration.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_the_joint_covariance_is_taken_by_name(tmp_path: Path) -> None:
    names = ["c_N_per_mm", "poisson_ratio", "youngs_modulus_MPa"]
    matrix = [[1.0, 0.0, 0.0], [0.0, 2.5e-5, -3e-5], [0.0, -3e-5, 1e-4]]
    material = read_material(
        written(
            tmp_path, {"youngs_modulus_MPa": E, "poisson_ratio": NU, "covariance": {"of": names, "matrix": matrix}}
        )
    )
    assert (material.youngs_modulus_MPa, material.poisson_ratio) == (0.2, 0.48)
    assert material.covariance is not None
    assert material.covariance.tolist() == [[1e-4, -3e-5], [-3e-5, 2.5e-5]]


def test_without_covariance_the_deviations_stand_in_and_what_was_not_fixed_is_wide(tmp_path: Path) -> None:
    free = {"value": None, "std": None, "interval95": [0.45, 0.4999], "unit": "", "why": "one punch"}
    material = read_material(written(tmp_path, {"youngs_modulus_MPa": E, "poisson_ratio": free}))
    assert material.poisson_ratio == pytest.approx(0.47495)
    assert material.covariance is not None
    assert np.sqrt(material.covariance[1, 1]) == pytest.approx(0.0499 / 3.92)
    plain = read_material(written(tmp_path, {"youngs_modulus_MPa": 0.3, "poisson_ratio": 0.5}))
    assert plain.poisson_ratio == 0.4999


@pytest.mark.parametrize("nu", [0.5011, 0.6, -0.1])
def test_a_ratio_that_no_gel_has_is_not_made_to_fit(tmp_path: Path, nu: float) -> None:
    with pytest.raises(InputError, match="Poisson's ratio"):
        read_material(written(tmp_path, {"youngs_modulus_MPa": E, "poisson_ratio": nu}))


@each("content", ["not json", "[1, 2]", {"youngs_modulus_MPa": E}, {"poisson_ratio": NU}])
def test_what_is_no_calibration_is_refused(tmp_path: Path, content: Any) -> None:
    with pytest.raises(InputError):
        read_material(written(tmp_path, content))
    with pytest.raises(InputError, match="no such file"):
        read_material(tmp_path / "absent.json")
