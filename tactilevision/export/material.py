"""Export a calibrated gel to a program: the solid, the fitted contact law, intervals and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.export.laws import Fitted, fit
from tactilevision.export.programs import Program, Values, find_program
from tactilevision.export.shapes import Shape, check_depths, layer_force, other_shapes
from tactilevision.files.opening import number
from tactilevision.files.writing import write_json, write_text
from tactilevision.force.calibrated import material_of, read_calibration
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Estimate, Floats, Material, Pair

DEPTHS = 25  # depths, evenly spaced in their logarithm, at which a law is fitted and its error is stated
USUAL_DEPTHS = (0.05, 0.2)  # of the thickness: the fitted range where none is stated
GOAL = 0.05  # largest relative error of a law at the fitted shape, beyond which a warning is given


@dataclass(frozen=True, slots=True)
class ExportSettings:
    """What presses, and what nobody calibrated: shape, depths in mm, friction, density, mass, pitch of taxels.

    `depths_mm` None: .05 to .2 thicknesses. `friction` and `density_kg_m3` None: not known. `mass_kg`, of the
    pressing body, is for MuJoCo alone. `largest_nu` None: the program's own.
    """

    shape: Shape = field(default_factory=Shape)
    depths_mm: Pair | None = None
    friction: float | None = None
    density_kg_m3: float | None = None
    mass_kg: float = 0.1
    taxel_mm: float = 0.25
    largest_nu: float | None = None

    def __post_init__(self) -> None:
        stated = {"density": self.density_kg_m3, "mass": self.mass_kg, "taxel": self.taxel_mm}
        for name, value in stated.items():
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"the {name} is a finite number above 0", where="export", value=value)
        if self.friction is not None and not (np.isfinite(self.friction) and self.friction >= 0):
            raise InputError("friction is a finite number of 0 or more", where="export", value=self.friction)
        if self.largest_nu is not None and not 0 < self.largest_nu < 0.5:
            raise InputError("the largest nu lies between 0 and .5", where="export", value=self.largest_nu)


@dataclass(frozen=True, slots=True)
class Compared:
    """A shape's forces (n,) in N at depths (n,) in mm by layer and law; `why` states why there are none."""

    shape: Shape
    depth_mm: Floats
    layer_N: Floats
    law_N: Floats
    why: str = ""

    @property
    def largest_error(self) -> float:
        """Return the relative error of the law that is largest in size, with its sign; NaN where unknown."""
        error = self.law_N / self.layer_N - 1
        return float(error[np.argmax(np.abs(error))]) if error.size else float("nan")


@dataclass(frozen=True, slots=True)
class ExportedMaterial:
    """A gel for a program.

    `parameters` by name with their 95 % intervals, in the program's units; `fitted` the law with `compared`, the
    fitted shape first, both empty for a program that takes the solid alone; `text` is what the program reads.
    """

    program: Program
    version: str
    material: Material
    solid: Material
    thickness_mm: float
    settings: ExportSettings
    parameters: Mapping[str, Estimate]
    fitted: Fitted | None
    compared: tuple[Compared, ...]
    text: str
    assumptions: tuple[str, ...]
    warnings: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the content of material.json."""
        settings = self.settings
        rows = [
            {
                "shape": one.shape.name,
                "radius_mm": one.shape.radius_mm,
                "length_mm": one.shape.length_mm if one.shape.name == "ridge" else None,
                "depths_mm": [float(one.depth_mm[0]), float(one.depth_mm[-1])] if one.depth_mm.size else None,
                "largest_error": one.largest_error if one.depth_mm.size else None,
                **({"why": one.why} if one.why else {}),
            }
            for one in self.compared
        ]
        return {
            "program": self.program.title,
            "version": self.version,
            "checked": self.program.checked,
            "law": self.fitted.law if self.fitted else "solid",
            "parameters": {name: one.as_json() for name, one in self.parameters.items()},
            "fitted": rows[0] if rows else None,
            "other_shapes": rows[1:],
            "material": self.material.as_json(),
            "solid": {
                "youngs_modulus_MPa": self.solid.youngs_modulus_MPa,
                "poisson_ratio": self.solid.poisson_ratio,
            },
            "thickness_mm": self.thickness_mm,
            "friction": settings.friction,
            "density_kg_m3": settings.density_kg_m3,
            "assumptions": list(self.assumptions),
            "warnings": list(self.warnings),
        }

    def write(self, folder: Path | str) -> None:
        """Write the program's file and material.json into `folder`."""
        write_text(Path(folder) / self.program.file, self.text)
        write_json(Path(folder) / "material.json", self.as_json())


def export_material(
    calibration: Path | str | Mapping[str, Any], to: str, settings: ExportSettings | None = None
) -> ExportedMaterial:
    """Return the parameters with which a program reproduces the calibrated gel.

    `calibration` is calibration.json or its content; `to` a program, "drake", or one with its version,
    "drake==1.51". The contact law is fitted to the layer's force at E and nu on the shape and depths of
    `settings`, by least squares of the relative error. Parameters that are proportional to a power of E have E's
    relative interval to this power, which is wide rather than narrow: at a punch's stiffness, E falls where nu
    rises. The solid's nu is at most the largest that the program takes, with E at that nu from
    `youngs_modulus_of_nu`.

    Raises InputError for an unknown program or version, a calibration without E, nu or the gel's thickness, and
    depths or shapes outside the range of the layer's response.
    """
    program, version = find_program(to)
    where = "calibration" if isinstance(calibration, Mapping) else calibration
    content = calibration if isinstance(calibration, Mapping) else read_calibration(calibration)
    material, interval, thickness = _read(content, where)
    settings = settings or ExportSettings()
    if settings.depths_mm is None:
        low, high = (share * thickness for share in USUAL_DEPTHS)
        settings = replace(settings, depths_mm=(low, high))
    solid = capped(material, content, min(settings.largest_nu or program.largest_nu, program.largest_nu), where)
    fitted: Fitted | None = None
    compared: tuple[Compared, ...] = ()
    if program.law is not None:
        fitted, compared = _fit(program, material, thickness, settings)
    values = Values(
        solid,
        fitted.values if fitted else {},
        thickness / KILO,
        settings.shape.radius_mm / KILO,
        settings.taxel_mm / KILO,
        settings.friction,
        settings.density_kg_m3,
    )
    ends = (interval[0] / material.youngs_modulus_MPa, interval[1] / material.youngs_modulus_MPa)
    parameters = {
        name: Estimate(value, None, _interval(value, ends, power), unit)
        for name, value, unit, power in program.rows(values)
    }
    return ExportedMaterial(
        program,
        version,
        material,
        solid,
        thickness,
        settings,
        parameters,
        fitted,
        compared,
        program.text(values),
        _assumptions(program, settings),
        _warnings(program, material, solid, compared),
    )


def capped(material: Material, content: Mapping[str, Any], largest_nu: float, where: object) -> Material:
    """Return the material with nu of at most `largest_nu` and E at that nu, of the same punch's stiffness.

    E follows `youngs_modulus_of_nu` of the calibration. Raises InputError where these pairs do not reach that far.
    """
    if material.poisson_ratio <= largest_nu:
        return Material(material.youngs_modulus_MPa, material.poisson_ratio)
    try:
        nu, modulus = np.array(content.get("youngs_modulus_of_nu"), dtype=float).T
        known = nu.size > 1 and np.isfinite([nu, modulus]).all() and nu.min() <= largest_nu <= nu.max()
    except (TypeError, ValueError):
        known = False
    if not known:
        raise InputError(
            f"the program takes nu to {largest_nu:g}, and E at that nu is not known",
            where=where,
            value=material.poisson_ratio,
            remedy="youngs_modulus_of_nu has to reach it: calibrate again.",
        )
    order = np.argsort(nu)
    there, here = np.interp([largest_nu, material.poisson_ratio], nu[order], modulus[order])
    return Material(float(material.youngs_modulus_MPa * there / here), largest_nu)


def _interval(value: float, ends: Pair, power: float) -> Pair | None:
    """Return the interval of a value proportional to a power of E, whose relative interval is `ends`."""
    low, high = sorted(value * end**power for end in ends)
    return (low, high) if power else None


def _read(content: Mapping[str, Any], where: object) -> tuple[Material, Pair, float]:
    """Return the material, E's interval in MPa and the thickness in mm."""
    entry = content.get("youngs_modulus_MPa")
    if isinstance(entry, Mapping) and entry.get("value") is None:
        raise InputError(
            f"E is not determined: {entry.get('why') or 'no value'}", where=where, remedy="Calibrate again."
        )
    material = material_of(content, where=where)
    ends = entry.get("interval95") if isinstance(entry, Mapping) else None
    low = high = material.youngs_modulus_MPa
    if isinstance(ends, list | tuple) and len(ends) == 2:
        low, high = (number(end, what="the interval of E", where=where) or low for end in ends)
    gel = content.get("gel")
    thickness = number(gel.get("thickness_mm") if isinstance(gel, Mapping) else None, what="gel", where=where)
    if thickness is None or not thickness > 0:
        raise InputError(
            "the gel's thickness is missing", where=where, remedy="Take the calibration.json of this version."
        )
    return material, (low, high), thickness


def _fit(
    program: Program, material: Material, thickness_mm: float, settings: ExportSettings
) -> tuple[Fitted, tuple[Compared, ...]]:
    assert program.law is not None
    assert settings.depths_mm is not None
    check_depths(settings.depths_mm, thickness_mm)
    depth = np.geomspace(*settings.depths_mm, DEPTHS)
    gel: Any = {"material": material, "thickness_mm": thickness_mm, "friction": settings.friction or 0.0}
    force = layer_force(settings.shape, depth, **gel)
    fitted = fit(program.law, settings.shape, depth, force, mass_kg=settings.mass_kg)
    compared = [Compared(settings.shape, depth, force, fitted.force_N(settings.shape, depth))]
    for shape in other_shapes(settings.shape):
        try:
            force = layer_force(shape, depth, **gel)
            compared.append(Compared(shape, depth, force, fitted.force_N(shape, depth)))
        except InputError as fault:
            nothing = np.empty(0)
            compared.append(Compared(shape, nothing, nothing, nothing, fault.what))
    return fitted, tuple(compared)


def _assumptions(program: Program, settings: ExportSettings) -> tuple[str, ...]:
    unknown = [
        name
        for name, value in (("friction", settings.friction), ("density", settings.density_kg_m3))
        if value is None
    ]
    return (
        f"{program.title}: {program.checked}",
        *([f"{' and '.join(unknown)} not stated: the program's own are used"] if unknown else []),
        "damping was not measured",
        *(
            ["the layer reaches far beyond the contact; its response is that of slow first loading"]
            if program.law
            else []
        ),
    )


def _warnings(
    program: Program, material: Material, solid: Material, compared: tuple[Compared, ...]
) -> tuple[str, ...]:
    found = []
    if compared and abs(compared[0].largest_error) > GOAL:
        error = 100 * abs(compared[0].largest_error)
        found.append(
            f"the law of {program.title} misses the layer's force by {error:.1f} % at the fitted shape: "
            "fit fewer depths"
        )
    if solid.poisson_ratio < material.poisson_ratio:
        found.append(
            f"the solid has nu {solid.poisson_ratio:g} with E {solid.youngs_modulus_MPa:.4g} MPa, as stiff under "
            f"the calibrated punch as nu {material.poisson_ratio:.4g} with E {material.youngs_modulus_MPa:.4g} MPa"
        )
    return tuple(found)
