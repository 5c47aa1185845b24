"""Forecast the uncertainty of a calibration before anything is pressed.

    covariance = (J^T W^T W J + priors)^-1,    J = d force/d parameter at the guessed material

Presses without errors at the guess are fitted with the stated noise, by the law, tolerances, friction and edges of
`calibrate`. n repeats of a face are one press with std smaller by sqrt(n). Linear about the guess.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from calibration.fit.least_squares import Fit, fit, linearise
from calibration.fit.tolerances import with_tolerances
from calibration.inputs.checks import check
from calibration.inputs.observations import (
    TYPICAL_FORCE_N,
    TYPICAL_GAIN,
    TYPICAL_ZERO_MM,
    Observations,
    Presses,
    Shared,
)
from calibration.model.composition import Model
from calibration.noise.model import STATED_DOF, Noise
from calibration.result.material import determine_material
from calibration.result.uncertainty import allow_for_edge
from calibration.tasks.compare import base_model
from tactilevision.errors import InputError
from tactilevision.records.measured import Estimate, Floats, Pair
from tactilevision.records.rig import Gel, Indenter

USUAL_MODULUS_MPA: Pair = (0.2, 0.2)  # MPa: guess of E where none is given; soft silicone gels lie about it
USUAL_NU: Pair = (0.48, 0.48)  # guess of Poisson's ratio where none is given


@dataclass(frozen=True, slots=True)
class PressNoise:
    """Standard deviations of one press: its depth (mm), its force (N), and its force relative to itself."""

    depth_std_mm: float = TYPICAL_ZERO_MM
    force_std_N: float = TYPICAL_FORCE_N
    gain: float = TYPICAL_GAIN


@dataclass(frozen=True, slots=True)
class Design:
    """Presses that could be made: `repeats` of each face, which is an indenter's `radius_mm` and `height_mm`.

    What is stated of gel and indenters (tolerances, edges, nu with its std) is known beforehand; `shared` what all
    depths have wrong together. E and nu are ranges in which the material may lie: the worst of their ends counts.
    """

    gel: Gel
    indenters: tuple[Indenter, ...]
    repeats: int = 3
    youngs_modulus_MPa: Pair = USUAL_MODULUS_MPA
    poisson_ratio: Pair = USUAL_NU
    noise: PressNoise = field(default=PressNoise())
    lubricated: bool = False
    shared: Shared = field(default=Shared())

    @property
    def heights_mm(self) -> tuple[float, ...]:
        """The distinct step heights, ascending."""
        return tuple(sorted({float(one.height_mm or 0.0) for one in self.indenters}))

    @property
    def radii_mm(self) -> tuple[float, ...]:
        """The distinct radii, ascending."""
        return tuple(sorted({one.radius_mm for one in self.indenters}))

    @property
    def presses(self) -> int:
        """The number of presses."""
        return self.repeats * len(self.indenters)


@dataclass(frozen=True, slots=True)
class Margin:
    """`std` and `half_width` of the 95 % interval (the farther end) that a calibration would give.

    `std` is None where it would give no value; `half_width` is then half of the open interval.
    """

    std: float | None
    half_width: float

    def as_json(self) -> dict[str, Any]:
        """Return both numbers."""
        return {"std": self.std, "half_width_95": self.half_width}


@dataclass(frozen=True, slots=True)
class Forecast:
    """A design and the margins of c and E (relative) and of nu (1); nu and E have no std where nu stays open."""

    design: Design
    c: Margin
    youngs_modulus: Margin
    poisson_ratio: Margin

    @property
    def nu_is_open(self) -> bool:
        """Whether nothing in the design determines Poisson's ratio."""
        return self.poisson_ratio.std is None

    def as_json(self) -> dict[str, Any]:
        """Return one entry of plan.json."""
        return {
            "heights_mm": list(self.design.heights_mm),
            "radii_mm": list(self.design.radii_mm),
            "repeats": self.design.repeats,
            "presses": self.design.presses,
            "c_relative": self.c.as_json(),
            "youngs_modulus_relative": self.youngs_modulus.as_json(),
            "poisson_ratio": self.poisson_ratio.as_json(),
            "poisson_ratio_open": self.nu_is_open,
        }


def forecast(design: Design) -> Forecast:
    """Return the worst margins of a design over its ranges of E and nu. Raises InputError if impossible."""
    check_design(design)
    places = sorted(set(product(design.youngs_modulus_MPa, design.poisson_ratio)))
    rows = [_margins(design, modulus, nu) for modulus, nu in places]
    c, modulus, nu = (
        max(column, key=lambda m: (m.std is None, m.half_width)) for column in zip(*rows, strict=True)
    )
    return Forecast(design, c, modulus, nu)


def forecast_fit(design: Design, modulus_MPa: float, *, poisson_ratio: float) -> Fit:
    """Return the fit to presses without errors for a gel of this E (MPa) and nu."""
    data = forecast_data(design, modulus_MPa, poisson_ratio=poisson_ratio)
    model = base_model(data)
    check(data)
    free = sum(not p.fixed and p.prior is None for p in model.parameters(data))
    noise = Noise(1.0, dof=max(design.presses - free, 0) + STATED_DOF)
    start = _truth(model, data, modulus_MPa, poisson_ratio)
    return fit(model, data, noise=noise, starts=_with_tolerances_at_rest(model, data, start))


def forecast_data(design: Design, modulus_MPa: float, *, poisson_ratio: float) -> Observations:
    """Return one sample (N,) a face: depth (mm) and the law's force (N), with the noise of its repeats' mean."""
    data = _faces(design)
    model = base_model(data)
    about, _ = linearise(model, _truth(model, data, modulus_MPa, poisson_ratio), data=data)
    noise, root = design.noise, np.sqrt(design.repeats)
    return replace(
        data.with_force(about.force_N),
        depth_std_mm=np.full(data.size, noise.depth_std_mm / root),
        force_std_N=np.hypot(noise.force_std_N, noise.gain * about.force_N) / root,
    )


def check_design(design: Design) -> None:
    """Raise InputError, with one sentence, for a design that cannot be pressed."""
    thickness = design.gel.thickness_mm
    _positive("gel thickness", thickness)
    _positive("repeats", design.repeats)
    for name, numbers in (("E", design.youngs_modulus_MPa), ("Poisson's ratio", design.poisson_ratio)):
        for number in numbers:
            _positive(name, number)
    if not max(design.poisson_ratio) < 0.5:
        raise InputError("Poisson's ratio lies in (0, 0.5)", where="plan", value=max(design.poisson_ratio))
    noise = design.noise
    _positive("the noise of depth", noise.depth_std_mm)
    _positive("the noise of force", noise.force_std_N)
    _no_less_than_0("the relative noise of force", noise.gain)
    _no_less_than_0("the standard deviation of the thickness", design.gel.thickness_std_mm)
    _no_less_than_0("the standard deviation of nu", design.gel.poisson_ratio_std or 0.0)
    _check_faces(design)


def _check_faces(design: Design) -> None:
    for one in design.indenters:
        _positive("radius", one.radius_mm)
        _positive("step height", float("nan") if one.height_mm is None else one.height_mm)
        _no_less_than_0("the standard deviation of a radius", one.radius_std_mm)
        _no_less_than_0("the standard deviation of a height", one.height_std_mm)
        _no_less_than_0("the radius of an edge", one.edge_radius_mm or 0.0)
    for radius in design.radii_mm:
        heights = {one.height_mm for one in design.indenters if one.radius_mm == radius}
        if len(heights) < 2:
            raise InputError(
                "a radius needs two step heights at least, to distinguish stiffness from curvature",
                where=f"radius {radius:g} mm",
                value=sorted(h for h in heights if h is not None),
                remedy="Give a second height, about twice the first.",
            )
    if not design.indenters:
        raise InputError("there is nothing to press", where="plan", remedy="Give radii and step heights.")
    if design.heights_mm[-1] >= design.gel.thickness_mm:
        raise InputError(
            "a step height reaches through the gel",
            where="plan",
            value=design.heights_mm[-1],
            remedy=f"The gel is {design.gel.thickness_mm:g} mm thick; heights are in mm.",
        )


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} must be above 0", where="plan", value=value)


def _no_less_than_0(name: str, value: float) -> None:
    if not (np.isfinite(value) and value >= 0):
        raise InputError(f"{name} is 0 or more", where="plan", value=value)


def _margins(design: Design, modulus: float, nu: float) -> tuple[Margin, Margin, Margin]:
    found = allow_for_edge(determine_material(forecast_fit(design, modulus, poisson_ratio=nu)))
    return _margin(found.c), _margin(found.youngs_modulus), _margin(found.poisson_ratio, relative=False)


def _margin(found: Estimate, *, relative: bool = True) -> Margin:
    low, high = found.interval95 or (-np.inf, np.inf)
    centre = (low + high) / 2 if found.value is None else found.value
    size = abs(centre) if relative else 1.0
    std = None if found.value is None or found.std is None else found.std / size
    return Margin(std, max(high - centre, centre - low) / size)


def _truth(model: Model, data: Observations, modulus: float, nu: float) -> Floats:
    values = model.defaults(data)
    values[:2] = modulus, nu
    return values


def _with_tolerances_at_rest(model: Model, data: Observations, start: Floats) -> Floats:
    """Return the law's values (p,), then the tolerances' defaults, as `fit` adds them."""
    whole = with_tolerances(model, data).defaults(data)
    whole[: start.size] = start
    return whole


def _faces(design: Design) -> Observations:
    """Return one press a face, without force."""
    faces, count = design.indenters, len(design.indenters)
    unknown, order = np.full(count, np.nan), np.arange(float(count))
    presses = Presses(
        label=tuple(f"press {k + 1}" for k in range(count)),
        recording=np.zeros(count, dtype=np.int64),
        indenter=np.arange(count),
        radius_mm=np.array([one.radius_mm for one in faces]),
        x_mm=unknown,
        y_mm=unknown,
        rest_s=unknown,
        speed_mm_s=unknown,
        hold_s=unknown,
        temperature_C=unknown,
        lubricated=np.full(count, 1.0 if design.lubricated else np.nan),
        day=np.zeros(count),
        order=order,
    )
    return Observations(
        gel=design.gel,
        indenters=faces,
        presses=presses,
        press=np.arange(count),
        time_s=60 * order,
        depth_mm=np.array([one.height_mm for one in faces], dtype=float),
        force_N=np.ones((count, 3)),
        phase=np.full(count, "load"),
        temperature_C=unknown,
        depth_std_mm=np.full(count, design.noise.depth_std_mm),
        force_std_N=np.full(count, design.noise.force_std_N),
        depth_source="gauge",
        shared=design.shared,
    )
