"""What calibration.json says where these presses fix no material: the same keys, null with the reason why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calibration.laws.flat_punch import SILICONE_NU
from calibration.result.result import NO_CLOCK, versions
from tactilevision.records import CertifiedPoint, Estimate, Gel, Pair

Rejected = tuple[tuple[str, str], ...]


def unfixed_as_json(
    gel: Gel | None,
    points: Sequence[CertifiedPoint],
    *,
    why: str,
    law: str,
    clock_offset: Estimate | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Every key of a calibration that found something, so that one program reads both.

    E and nu keep the interval that the recording states of its gel beforehand; an unstated nu that of silicones.
    """
    gel = gel or Gel(float("nan"))
    modulus = _interval(gel.youngs_modulus_MPa, gel.youngs_modulus_std_MPa)
    poisson = _interval(gel.poisson_ratio, gel.poisson_ratio_std)
    stated = [name for name, found in (("E", modulus), ("nu", poisson)) if found]
    assumptions = [f"the interval of {name} is what the recording states beforehand" for name in stated]
    if poisson is None:
        assumptions.append("the interval of nu is what silicones have")
    return {
        "law": law,
        "youngs_modulus_MPa": _open("MPa", why, modulus),
        "poisson_ratio": _open("1", why, poisson or SILICONE_NU),
        "poisson_ratio_source": "prior",
        "c_N_per_mm": _open("N/mm", why),
        "beta": _open("1", why),
        "reduced_modulus_MPa": _open("MPa", why),
        "youngs_modulus_of_nu": [],
        "poisson_ratio_routes": [],
        "routes_apart_sigma": None,
        "clock_offset_s": (clock_offset or NO_CLOCK).as_json(),
        "covariance": None,
        "by_radius": [],
        "r_squared": None,
        "rms_error_N": None,
        "held_out_N": None,
        "noise_floor_N": None,
        "presses_accepted": [point.press for point in points if point.accepted],
        "presses_rejected": [{"press": press, "reason": reason} for press, reason in rejected(points)],
        "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
        "effects": [],
        "assumptions": assumptions,
        "warnings": [why, *warnings],
        "flags": ["not_fixed"],
        "versions": versions(),
    }


def rejected(points: Sequence[CertifiedPoint]) -> Rejected:
    """(press, reason) of each press that is not trusted."""
    return tuple((point.press, point.reason or "rejected") for point in points if not point.accepted)


def in_words(points: Sequence[CertifiedPoint]) -> list[str]:
    """How many presses were accepted, and of each other one what speaks against it."""
    refused = [point for point in points if not point.accepted]
    lines = [f"{len(points) - len(refused)} of {len(points)} presses accepted"]
    return lines + [f"  rejected {point.press}: {_findings(point)}" for point in refused]


def _findings(point: CertifiedPoint) -> str:
    return (point.details.findings or point.reason or "rejected").replace("_", " ")


def _open(unit: str, why: str, interval95: Pair | None = None) -> dict[str, Any]:
    return Estimate(None, None, interval95, unit, why).as_json()


def _interval(value: float | None, std: float | None) -> Pair | None:
    half = 1.96 * (std or 0.0)
    return None if value is None else (max(value - half, 0.0), value + half)
