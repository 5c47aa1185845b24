"""The outcome of a calibration, and its form on disk."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.result.poisson_routes import Route, apart
from tactilevision.records import Estimate, Floats, Material, Pair

NO_CLOCK = Estimate(None, None, None, "s", "points and curves come on one clock: there was none to align")
COVARIANCE_OF = ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "beta")


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """E, nu, c, beta with their intervals, what they rest on, and how well the law fits.

    `covariance` (4, 4) is of COVARIANCE_OF; `youngs_modulus_of_nu` pairs (nu, E) at the fitted c; `fitted` the fit
    behind it; `presses_rejected` pairs (press, reason); `by_radius` (radius, c, beta) where there are several;
    `routes` what each way to nu says, whether it was used or not. `held_out_N` the rms error on presses left out
    of the fit and `noise_floor_N` the repeatability: see tasks/fit_errors.py.
    """

    youngs_modulus: Estimate
    poisson_ratio: Estimate
    poisson_ratio_source: str
    c: Estimate
    beta: Estimate
    reduced_modulus: Estimate
    youngs_modulus_of_nu: tuple[Pair, ...]
    covariance: Floats
    law: str
    r_squared: float
    rms_error_N: float
    noise_floor_N: float
    clock_offset: Estimate
    fitted: Fit
    presses_accepted: tuple[str, ...]
    presses_rejected: tuple[Pair | tuple[str, str], ...] = ()
    by_radius: tuple[tuple[float, Estimate, Estimate], ...] = ()
    assumptions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    routes: tuple[Route, ...] = ()
    held_out_N: float = float("nan")

    @property
    def material(self) -> Material | None:
        """For the force side; None where E or nu has no value."""
        E, nu = self.youngs_modulus.value, self.poisson_ratio.value
        return None if E is None or nu is None else Material(E, min(nu, 0.4999), self.covariance[:2, :2])

    def as_json(self) -> dict[str, Any]:
        """The content of calibration.json."""
        gel = self.fitted.data.gel
        return {
            "law": self.law,
            "youngs_modulus_MPa": self.youngs_modulus.as_json(),
            "poisson_ratio": self.poisson_ratio.as_json(),
            "poisson_ratio_source": self.poisson_ratio_source,
            "c_N_per_mm": self.c.as_json(),
            "beta": self.beta.as_json(),
            "reduced_modulus_MPa": self.reduced_modulus.as_json(),
            "youngs_modulus_of_nu": [list(pair) for pair in self.youngs_modulus_of_nu],
            "poisson_ratio_routes": [
                {"route": route.name, "used": route.used, **route.poisson_ratio.as_json()} for route in self.routes
            ],
            "routes_apart_sigma": apart(self.routes),
            "clock_offset_s": self.clock_offset.as_json(),
            "covariance": {"of": list(COVARIANCE_OF), "matrix": self.covariance.tolist()},
            "by_radius": [
                {"radius_mm": radius, "c_N_per_mm": c.as_json(), "beta": beta.as_json()}
                for radius, c, beta in self.by_radius
            ],
            "r_squared": self.r_squared,
            "rms_error_N": self.rms_error_N,
            "held_out_N": self.held_out_N if np.isfinite(self.held_out_N) else None,
            "noise_floor_N": self.noise_floor_N,
            "presses_accepted": list(self.presses_accepted),
            "presses_rejected": [{"press": press, "reason": reason} for press, reason in self.presses_rejected],
            "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
            "effects": list(self.fitted.model.keys),
            "assumptions": list(self.assumptions),
            "warnings": list(self.warnings),
            "flags": list(self.flags),
            "versions": versions(),
        }


def versions() -> dict[str, str]:
    """What computed the result."""
    names = ("tactilevision", "numpy", "scipy")
    return {name: metadata.version(name) for name in names} | {"python": platform.python_version()}


def common_assumptions(fitted: Fit) -> list[str]:
    """What holds for every law."""
    data = fitted.data
    tared = "the force's zero is that of the free gel before and after each press"
    lines = [tared if data.shared.touch_mm else "the zeros of depth and force are taken as they were recorded"]
    if data.depth_source == "stage":
        lines.append("the depth is the stage's: the rig's give counts as the gel's unless an effect takes it out")
    if not data.is_curves and not data.shared.heights:
        lines.append(
            "the rig comes to each contact event at one pace (as stated, where speeds are; by the motion stage, "
            "where its place was recorded): depths lie on the travel scale this makes, fixed by the bevels within "
            f"{100 * data.shared.rise:.1f} % (std)"
        )
    thickness = next((p.prior for p in fitted.parameters if p.name == "thickness.relative"), None)
    if thickness is not None:
        lines.append(
            "the thickness is fitted, held to the stated one within "
            f"{100 * thickness.std:.1f} % (std; {thickness.source})"
        )
    elif not data.gel.thickness_std_mm:
        lines.append(
            f"the thickness, {data.gel.thickness_mm:g} mm, is taken as exact; 1 % of it is about 1 % of E"
        )
    if not fitted.noise.stated:
        lines.append("no noise was stated: it is estimated from the scatter about the law")
    return lines


def r_squared(fitted: Fit) -> float:
    """Of P/w against w/h for points, as published; of the force for curves."""
    data = fitted.data
    if data.is_curves:
        return fitted.r_squared
    per_depth, model = data.normal_N / data.depth_mm, fitted.force_N / data.depth_mm
    total = float(np.sum((per_depth - per_depth.mean()) ** 2))
    return 1 - float(np.sum((per_depth - model) ** 2)) / total if total > 0 else float("nan")
