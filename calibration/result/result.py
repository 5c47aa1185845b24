"""The result of a calibration, determined or undetermined, and its form on disk."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.fit.identifiability import Identified
from calibration.fit.least_squares import Fit, r_squared
from calibration.laws.flat_punch import SILICONE_NU
from calibration.result.poisson_routes import Route, apart
from tactilevision.errors import library
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import NU_MAX, Z95
from tactilevision.records.display import Displayed, Summary, figure, mN
from tactilevision.records.measured import REACH, Estimate, Material, Pair
from tactilevision.records.rig import Gel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The outcome of a calibration, and its form on disk.

NO_CLOCK = Estimate(None, None, None, "s", "points and curves come on one clock: there was none to align")
COVARIANCE_OF = ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "beta")


@dataclass(frozen=True, slots=True)
class Suspect:
    """An effect that may be missing: its fitted `sizes` (name, value, unit), and E with it."""

    key: str
    sizes: tuple[tuple[str, float, str], ...]
    modulus_MPa: float


@dataclass(frozen=True, slots=True)
class ModelTest:
    """One test of all effects, covariates and presses: the smallest p, adjusted for all of them.

    Where that is significant the model is `insufficient`; `suspects` are the likeliest effects, `covariates` what
    the residual depends on, `presses` those unlike the others.
    """

    p: float
    suspects: tuple[Suspect, ...] = ()
    covariates: tuple[str, ...] = ()
    presses: tuple[str, ...] = ()
    insufficient: bool = False

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        suspects = [
            {
                "key": one.key,
                "parameters": {name: {"value": value, "unit": unit} for name, value, unit in one.sizes},
                "youngs_modulus_MPa": one.modulus_MPa,
            }
            for one in self.suspects
        ]
        lists = {"covariates": list(self.covariates), "presses": list(self.presses)}
        return {"p": self.p, "suspects": suspects, **lists}


@dataclass(frozen=True, slots=True, repr=False)
class CalibrationResult(Displayed, Identified):
    """E, nu, c, beta with their intervals and assumptions, and how well the law fits.

    `covariance` (4, 4) is of COVARIANCE_OF; `presses_rejected` pairs (press, reason); `by_radius` (radius, c,
    beta) where there are several; `routes` nu by each route, used or not; `held_out_N` the rms error on
    presses held out of the fit; `noise_floor_N` the repeatability; `model_test` whether the model is sufficient;
    `undiagnosed_MPa` the interval of E that a diagnosis widened.
    """

    c: Estimate
    beta: Estimate
    fitted: Fit
    noise_floor_N: float = float("nan")
    clock_offset: Estimate = NO_CLOCK
    presses_rejected: tuple[Pair | tuple[str, str], ...] = ()
    by_radius: tuple[tuple[float, Estimate, Estimate], ...] = ()
    warnings: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    routes: tuple[Route, ...] = ()
    held_out_N: float = float("nan")
    model_test: ModelTest | None = None
    undiagnosed_MPa: Pair | None = None

    def summary(self) -> Summary:
        """Return the material, the presses and the errors."""
        kept = len(self.presses_accepted)
        values: dict[str, str | Estimate] = {
            "E": self.youngs_modulus,
            "ν": self.poisson_ratio,
            "c": self.c,
            "β": self.beta,
            "presses": f"{kept} of {kept + len(self.presses_rejected)} accepted",
            "error on held-out presses": mN(self.held_out_N),
            "repeatability": mN(self.noise_floor_N),
        }
        return Summary(f"Calibration by the law {self.law}", values, self.warnings)

    def plot_fit(self) -> Figure:
        """Draw the fitted law through the measured forces over depth, and its residual."""
        return figure("plot_fit", self)

    def to_frame(self) -> Any:
        """Return a pandas.DataFrame, a row a press: its deepest sample, its rms residual, or why it is rejected.

        Raises InputError where pandas is missing (extra `notebook`).
        """
        pandas = library("pandas", extra="notebook", where="to_frame")
        data, fitted = self.fitted.data, self.fitted
        deepest = [one.start + int(np.argmax(data.depth_mm[one])) for one in data.spans]
        rms_N = np.sqrt(np.bincount(data.press, fitted.residual_N**2) / np.bincount(data.press))
        table = {
            "press": list(data.presses.label),
            "indenter": [data.indenters[k].name for k in data.presses.indenter.tolist()],
            "radius_mm": data.presses.radius_mm,
            "depth_mm": data.depth_mm[deepest],
            "force_N": data.normal_N[deepest],
            "fitted_N": fitted.force_N[deepest],
            "rms_residual_N": rms_N,
            "accepted": True,
            "reason": "",
        }
        rejected = [{"press": press, "accepted": False, "reason": why} for press, why in self.presses_rejected]
        rows = [*pandas.DataFrame(table).to_dict("records"), *rejected]
        return pandas.DataFrame(rows, columns=list(table))

    def noted(self, *warnings: str, flags: Sequence[str] = ()) -> CalibrationResult:
        """Return the result with more warnings and flags."""
        return replace(self, warnings=(*self.warnings, *warnings), flags=(*self.flags, *flags))

    def from_data(self, quantity: str) -> Pair | None:
        """Return the 95 % interval of `youngs_modulus` or `poisson_ratio` from the scatter of the data alone.

            value +- t std,    within the estimate's own interval, before a diagnosis

        The estimate's interval allows in addition for what may be unseen: friction, an edge that is not stated,
        effects too small to be significant. None without a value.
        """
        one: Estimate = getattr(self, quantity)
        if one.value is None or one.std is None or one.interval95 is None:
            return None
        reach = one.std * self.fitted.reach(np.eye(self.fitted.values.size)[0])
        widened = self.undiagnosed_MPa if quantity == "youngs_modulus" else None
        (low, high), value = widened or one.interval95, one.value
        return min(max(value - reach, low), value), max(min(value + reach, high), value)

    @property
    def law(self) -> str:
        """Key of the contact law."""
        return self.fitted.model.law.key

    @property
    def rms_error_N(self) -> float:
        """Rms error on the fitted presses."""
        return self.fitted.rms_error_N

    @property
    def presses_accepted(self) -> tuple[str, ...]:
        """Labels of the fitted presses."""
        return self.fitted.data.presses.label

    @property
    def r_squared(self) -> float:
        """R^2 of P/w against w/h for points, as published, and of the force for curves."""
        data = self.fitted.data
        unit = 1.0 if data.is_curves else data.depth_mm
        return r_squared(data.normal_N / unit, self.fitted.force_N / unit)

    @property
    def material(self) -> Material | None:
        """E and nu for `force`; None where one has no value."""
        E, nu = self.youngs_modulus.value, self.poisson_ratio.value
        return None if E is None or nu is None else Material(E, min(nu, NU_MAX), self.covariance[:2, :2])

    def _reach(self) -> dict[str, float | None]:
        """Return the depth of the deepest press and the speed of the fastest one, None where not recorded."""
        data = self.fitted.data
        speeds = data.presses.speed_mm_s[np.isfinite(data.presses.speed_mm_s)]
        fastest = float(speeds.max()) if speeds.size else None
        return dict(zip(REACH, (float(np.max(data.depth_mm)), fastest), strict=True))

    def as_json(self) -> dict[str, Any]:
        """Return the content of calibration.json."""
        gel = self.fitted.data.gel
        return {
            "law": self.law,
            "youngs_modulus_MPa": self.youngs_modulus.as_json(),
            "poisson_ratio": self.poisson_ratio.as_json(),
            "interval95_from_data": {
                "youngs_modulus_MPa": self.from_data("youngs_modulus"),
                "poisson_ratio": self.from_data("poisson_ratio"),
            },
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
            "model_test": None if self.model_test is None else self.model_test.as_json(),
            "presses_accepted": list(self.presses_accepted),
            "presses_rejected": [{"press": press, "reason": reason} for press, reason in self.presses_rejected],
            "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
            "calibrated": self._reach(),
            "effects": list(self.fitted.model.keys),
            "assumptions": list(self.assumptions),
            "warnings": list(self.warnings),
            "flags": list(self.flags),
            "versions": versions(),
        }


def versions() -> dict[str, str]:
    """Return the versions that computed the result."""
    names = ("tactilevision", "numpy", "scipy")
    return {name: metadata.version(name) for name in names} | {"python": platform.python_version()}


def common_assumptions(fitted: Fit) -> list[str]:
    """Return the assumptions that hold for every law."""
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


# calibration.json where the presses determine no material: the same keys, null with the reason.

Rejected = tuple[tuple[str, str], ...]
FIGURES_OF_FIT = ("r_squared", "rms_error_N", "held_out_N", "noise_floor_N")


def unfixed_as_json(
    gel: Gel | None,
    points: Sequence[CertifiedPoint],
    *,
    why: str,
    law: str,
    clock_offset: Estimate | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Return every key of calibration.json, without values.

    E and nu keep the interval that the recording states of its gel; an unstated nu that of silicones.
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
        **{name: [] for name in ("youngs_modulus_of_nu", "poisson_ratio_routes", "by_radius", "effects")},
        **dict.fromkeys(("routes_apart_sigma", "covariance", *FIGURES_OF_FIT, "model_test", "calibrated")),
        "interval95_from_data": {"youngs_modulus_MPa": None, "poisson_ratio": None},
        "clock_offset_s": (clock_offset or NO_CLOCK).as_json(),
        "presses_accepted": [point.press for point in points if point.accepted],
        "presses_rejected": [{"press": press, "reason": reason} for press, reason in rejected(points)],
        "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
        "assumptions": assumptions,
        "warnings": [why, *warnings],
        "flags": ["not_fixed"],
        "versions": versions(),
    }


def rejected(points: Sequence[CertifiedPoint]) -> Rejected:
    """Return (press, reason) of each rejected press."""
    return tuple((point.press, point.reason or "rejected") for point in points if not point.accepted)


def in_words(points: Sequence[CertifiedPoint]) -> list[str]:
    """Return how many presses were accepted, and the findings of each rejected one, in words."""
    refused = [point for point in points if not point.accepted]
    lines = [f"{len(points) - len(refused)} of {len(points)} presses accepted"]
    return lines + [f"  rejected {point.press}: {_findings(point)}" for point in refused]


def _findings(point: CertifiedPoint) -> str:
    return (point.details.findings or point.reason or "rejected").replace("_", " ")


def _open(unit: str, why: str, interval95: Pair | None = None) -> dict[str, Any]:
    return Estimate(None, None, interval95, unit, why).as_json()


def _interval(value: float | None, std: float | None) -> Pair | None:
    half = Z95 * (std or 0.0)
    return None if value is None else (max(value - half, 0.0), value + half)
