"""Read the material and its covariance from calibration.json; sensitivity of a force to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.documents import read_json
from tactilevision.files.opening import check_numbers, number
from tactilevision.force.field import ForceField
from tactilevision.force.mesh_compliance import MeshCompliance
from tactilevision.records.constants import MICRO, NU_MAX, TINY, Z95
from tactilevision.records.maps import HeightMap, ShearMap, TractionMap
from tactilevision.records.measured import REACH, Floats, Material
from tactilevision.records.rig import Gel

SAME_GEL = 0.01  # of the thickness: largest difference of one gel
TOGETHER = "both together"  # E and nu varied by their covariance
_UNITS = {"youngs_modulus_MPa": ("MPa",), "poisson_ratio": ("1", "")}  # as `calibrate` writes them


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Resultants (N) at the ends of one parameter's range; `force_N` (2, 3) by `values` (2,)."""

    parameter: str
    unit: str
    values: tuple[float, float]
    force_N: Floats

    def change_percent(self, found: TractionMap) -> tuple[float, float]:
        """Return the change of fz at either end, in percent of `found`."""
        now = found.resultant_N[2]
        low, high = (100 * (float(force) / now - 1) if now > 0 else 0.0 for force in self.force_N[:, 2])
        return low, high

    def as_json(self, found: TractionMap) -> dict[str, Any]:
        """Return the parameter's interval, the forces at its ends, and the change from `found`."""
        return {
            "parameter": self.parameter,
            "unit": self.unit,
            "interval95": list(self.values),
            "force_N": self.force_N.tolist(),
            "change_percent": list(self.change_percent(found)),
        }


def read_material(path: Path | str) -> Material:
    """Read E, nu and their covariance from calibration.json.

    Without a covariance, from the two standard deviations. A value that the calibration did not determine (null)
    is the middle of its interval, its std that of the interval's width. For an incompressible gel nu is .4999.
    Raises InputError for a file that is not a calibration or holds no possible number for E or nu.
    """
    return material_of(read_calibration(path), where=path)


def material_of(content: Mapping[str, Any], *, where: object) -> Material:
    """Read the material, as `read_material` does, from the content of calibration.json.

    `where` names the file in errors.
    """
    modulus, modulus_std = _estimate(content, "youngs_modulus_MPa", where)
    poisson, poisson_std = _estimate(content, "poisson_ratio", where)
    covariance = _covariance(content, where)
    if covariance is None:
        covariance = np.diag([modulus_std**2, poisson_std**2])
    check_numbers(covariance, what="the covariance of E and nu", where=where)
    reach = content.get("calibrated")
    ends = (number(reach.get(key), what=key, where=where) if isinstance(reach, dict) else None for key in REACH)
    try:
        return Material(modulus, NU_MAX if NU_MAX < poisson <= 0.5 else poisson, covariance, False, *ends)
    except InputError as fault:
        raise InputError(fault.what, where=where, value=fault.value, remedy=fault.remedy) from fault


def material_sensitivity(
    field: ForceField, found: TractionMap, height: HeightMap, shear: ShearMap | None = None
) -> tuple[Sensitivity, ...]:
    """Return the resultants (N) of a map (H, W) with E, then nu, at the ends of the material's own 95 % interval.

    Each is varied alone, then both together by their covariance (to first order). `found` is what `field` computed
    from the maps; it is proportional to E, and a compliance is computed for each end of nu. Empty where the
    material has no covariance.
    """
    material = field.material
    if material.covariance is None:
        return ()
    half = Z95 * np.sqrt(np.diag(material.covariance))
    moduli = tuple(max(material.youngs_modulus_MPa + s * half[0], TINY) for s in (-1, 1))
    ratios = tuple(float(np.clip(material.poisson_ratio + s * half[1], 0.0, NU_MAX)) for s in (-1, 1))

    def at(poisson_ratio: float) -> tuple[float, float, float]:
        changed = replace(material, poisson_ratio=poisson_ratio, covariance=None)  # no deviation is needed
        own = field.compliance.at(poisson_ratio) if isinstance(field.compliance, MeshCompliance) else None
        again = ForceField(field.gel, changed, field.mm_per_px, settings=field.settings, compliance=own)
        return again(height, shear).resultant_N

    by_modulus = np.outer(np.array(moduli) / material.youngs_modulus_MPa, found.resultant_N)
    by_ratio = np.array([at(value) for value in ratios])
    return (
        Sensitivity("youngs_modulus", "MPa", (moduli[0], moduli[1]), by_modulus),
        Sensitivity("poisson_ratio", "1", (ratios[0], ratios[1]), by_ratio),
        _both(np.stack([by_modulus, by_ratio]), np.array([moduli, ratios]), material.covariance),
    )


def _both(ends_N: Floats, values: Floats, covariance: Floats) -> Sensitivity:
    """Combine both parameters: `ends_N` (2, 2, 3) by parameter and end, `values` (2, 2).

    The change is small where the stiffness is well known although E and nu are not.
    """
    slope = (ends_N[:, 1] - ends_N[:, 0]) / np.maximum(values[:, 1] - values[:, 0], TINY)[:, None]
    half = Z95 * np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", slope, covariance, slope), 0))
    now = ends_N[0].mean(axis=0)  # the force is proportional to E
    return Sensitivity(TOGETHER, "", (float("nan"), float("nan")), np.stack([now - half, now + half]))


def _estimate(content: Mapping[str, Any], key: str, path: object) -> tuple[float, float]:
    entry = content.get(key)
    if not isinstance(entry, dict):
        alone = number(entry, what=key, where=path)
        if alone is not None:
            return alone, 0.0
    else:
        if entry.get("unit", _UNITS[key][0]) not in _UNITS[key]:
            raise InputError(f"{key} has another unit", where=path, value=str(entry["unit"])[:40])
        value = number(entry.get("value"), what=key, where=path)
        if value is not None:
            return value, number(entry.get("std"), what=f"the std of {key}", where=path) or 0.0
        interval = entry.get("interval95")
        if isinstance(interval, list) and len(interval) == 2:
            low, high = (number(end, what=f"the interval of {key}", where=path) for end in interval)
            if low is not None and high is not None:
                return (low + high) / 2, (high - low) / (2 * Z95)
        if entry.get("why"):
            raise InputError(f"{key} is not determined: {entry['why']}", where=path, remedy="Calibrate again.")
    raise InputError(f"{key} is missing", where=path, remedy="Take the calibration.json that `calibrate` wrote.")


def read_calibration(path: Path | str) -> dict[str, Any]:
    """Read the content of calibration.json. Raises InputError if it cannot be read."""
    try:
        return read_json(path)
    except FileNotFoundError as fault:
        remedy = "Make one with `tactilevision calibrate`."
        raise InputError("there is no such file", where=path, remedy=remedy) from fault
    except (OSError, InputError) as fault:
        raise InputError(
            "is not a readable calibration",
            where=path,
            value=str(fault),
            remedy="Make one with `tactilevision calibrate`.",
        ) from fault


def _covariance(content: Mapping[str, Any], path: object) -> Floats | None:
    """Read the covariance (2, 2) of E and nu from {"of": names, "matrix": rows}; None where it is not stated."""
    entry = content.get("covariance")
    if entry is None:
        return None
    remedy = "Take the calibration.json that `calibrate` wrote."
    try:
        if not all(name in entry["of"] for name in _UNITS):
            return None
        places = [entry["of"].index(name) for name in _UNITS]
        matrix = np.asarray(entry["matrix"], dtype=float)[np.ix_(places, places)]
    except (TypeError, ValueError, IndexError, KeyError, AttributeError) as fault:
        what = "the covariance is not a matrix of numbers with the names of its rows"
        raise InputError(what, where=path, value=str(entry)[:40], remedy=remedy) from fault
    if not np.isfinite(matrix).all():
        return None
    if np.diag(matrix).min() < 0 or abs(matrix[0, 1]) > (1 + MICRO) * np.sqrt(matrix[0, 0] * matrix[1, 1]):
        raise InputError(
            "the covariance of E and nu is not positive semidefinite",
            where=path,
            value=matrix.tolist(),
            remedy=remedy,
        )
    return matrix


def modulus_of(force_N: Floats, modulus_MPa: float, measured_N: Floats) -> tuple[float, float]:
    """Return E and its standard deviation, MPa, at which forces of a gel's own mesh agree with a force sensor's.

        E' = E sum(F . M) / sum(F . F)

    F (N, 3) are resultants solved with E, to which they are proportional; M (N, 3) the sensor's. NaN is left out.
    Raises InputError without a force to compare.
    """
    both = np.isfinite(force_N) & np.isfinite(measured_N)
    own, other = np.where(both, force_N, 0.0), np.where(both, measured_N, 0.0)
    square, used = float((own**2).sum()), int((own != 0).any(axis=1).sum())
    if not square > 0 or used < 2:
        raise InputError(
            "E needs two frames at least with a contact and a reading of the force sensor",
            where="modulus_of",
            value=used,
            remedy="Record forces.csv with the presses.",
        )
    share = float((own * other).sum()) / square
    spread = float(((other - share * own) ** 2).sum()) / (used - 1)
    return modulus_MPa * share, modulus_MPa * float(np.sqrt(spread / square))


def check_gel(path: Path | str, gel: Gel) -> None:
    """Raise InputError if calibration.json was made on a gel of another thickness: it is another sensor's."""
    thickness = read_thickness_mm(path)
    if thickness is not None and abs(thickness / gel.thickness_mm - 1) > SAME_GEL:
        raise InputError(
            "is the calibration of another gel",
            where=path,
            value=f"{thickness:g} mm thick, this one {gel.thickness_mm:g} mm",
            remedy="Calibrate this sensor: E and nu belong to one gel.",
        )


def read_thickness_mm(path: Path | str) -> float | None:
    """Read the thickness of the gel from calibration.json; None if it is not in it."""
    return _stated(path, "gel", "thickness_mm")


def read_clock_offset(path: Path | str) -> float | None:
    """Read F/T clock minus camera clock from a calibration.json that `read_material` accepts.

    None if it is not in it.
    """
    return _stated(path, "clock_offset_s", "value")


def _stated(path: Path | str, table: str, key: str) -> float | None:
    found = read_calibration(path).get(table)
    return number(found.get(key) if isinstance(found, dict) else found, what=table, where=path)
