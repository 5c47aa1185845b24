"""Contact laws of simulators, each fitted to the layer's force on one shape over a range of depths.

Three kinds are in use. All are local: each place, or each point of contact, answers to its own penetration alone,
which a layer near nu = .5 does not. No parameter serves a ball and a punch alike.

- `pressure` (Drake, Newton): p = c d over the indenter's surface, d its depth below the pad's surface.
- `taxels` (Genesis, Isaac Lab): a spring of k = c pitch^2 on each taxel, d the distance of the taxel to the
  surface of the indenter that it is in, the force along that surface's normal.
- `point` (MuJoCo): one force of each point of contact, at rest
  f = m s w g(w)^2/(g_max^2 (1 - g(w))), with solref = (-s, -b), the impedance g of solimp, and the mass m.

In the first two the pad's surface lies `offset` above the gel's: contact begins early by the offset, and the force
grows from there with the power of two of a ball on springs. With the right offset this is the layer's force, whose
power lies between 1.5 (half-space) and 3 (thin incompressible layer). All lengths are in m and forces in N here.

Sources: MuJoCo documentation, Computation, "Impedance" and "Reference"; Elandt et al., IROS 2019 (Drake); Newton,
`ShapeConfig.kh`; Genesis, `KinematicTaxel`; Isaac Lab, `VisuoTactileSensorCfg`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactilevision.export.shapes import Shape
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Floats

LawName = Literal["pressure", "taxels", "point"]
POINTS: Mapping[str, int] = {"ball": 1, "flat": 4, "ridge": 2}  # of contact with a plane in MuJoCo
WIDTH = 1.25  # of the deepest fitted depth: where MuJoCo's impedance stops growing


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted law: `values` by name, in SI units; `scaling` names the one proportional to E."""

    law: LawName
    values: Mapping[str, float]
    scaling: str

    def force_N(self, shape: Shape, depth_mm: Floats) -> Floats:
        """Return the program's force (N) on a shape at depths (n,) in mm."""
        return np.asarray(FORCE[self.law](shape, depth_mm / KILO, self.values))


def pressure_force(shape: Shape, depth_m: Floats, values: Mapping[str, float]) -> Floats:
    """Return the force (n,) in N of a pressure c d at depths (n,) in m: c times the volume below the surface."""
    w, r = np.maximum(depth_m + values["offset"], 0), shape.radius_mm / KILO
    if shape.name == "ball":
        volume = np.pi * w**2 * (r - w / 3)
    elif shape.name == "flat":
        volume = np.pi * r**2 * w
    else:
        half = np.sqrt(w * (2 * r - w))
        volume = shape.length_mm / KILO * (r**2 * np.arccos(1 - w / r) - (r - w) * half)
    return np.asarray(values["per_depth"] * volume)


def taxel_force(shape: Shape, depth_m: Floats, values: Mapping[str, float]) -> Floats:
    """Return the force (n,) in N of springs to the nearest surface, on a dense grid, at depths (n,) in m."""
    w, r = np.maximum(depth_m + values["offset"], 0), shape.radius_mm / KILO
    if shape.name == "ball":
        volume = np.pi * w**2 * (r - w)
    elif shape.name == "flat":
        volume = np.pi * w * np.maximum(r - w, 0) ** 2  # next to the edge the side is nearer than the face
    else:
        below = r - w
        volume = 2 * shape.length_mm / KILO * below * (r * np.arccosh(r / below) - np.sqrt(w * (2 * r - w)))
    return np.asarray(values["per_depth"] * volume)


def point_force(shape: Shape, depth_m: Floats, values: Mapping[str, float]) -> Floats:
    """Return the force (n,) in N of MuJoCo's points of contact at rest, at depths (n,) in m."""
    x = np.clip(depth_m / values["width"], 0, 1)
    middle, power = values["midpoint"], values["power"]
    rising = x**power / middle ** (power - 1)
    falling = 1 - (1 - x) ** power / (1 - middle) ** (power - 1)
    share = np.where(x <= middle, rising, falling)
    g = values["dmin"] + share * (values["dmax"] - values["dmin"])
    spring = values["mass"] * values["stiffness"] * depth_m * g**2 / (values["dmax"] ** 2 * (1 - g))
    return np.asarray(POINTS[shape.name] * spring)


FORCE = {"pressure": pressure_force, "taxels": taxel_force, "point": point_force}


def fit(law: LawName, shape: Shape, depth_mm: Floats, force_N: Floats, *, mass_kg: float = 1.0) -> Fitted:
    """Fit a law to forces (n,) in N at rising depths (n,) in mm, by least squares of the relative error."""
    from scipy.optimize import least_squares

    depth_m = depth_mm / KILO
    first, deepest = float(depth_m[0]), float(depth_m[-1])
    forms: dict[LawName, Form] = dict.fromkeys(
        ("pressure", "taxels"), Form("per_depth", {"offset": (-first / 2, 0.0, deepest)}, {})
    )
    fixed = {"width": WIDTH * deepest, "mass": mass_kg}
    forms["point"] = Form("stiffness", IMPEDANCE, fixed)
    form = forms[law]

    def error(free: Floats) -> Floats:
        ratio = FORCE[law](shape, depth_m, form.values(1.0, free)) / force_N
        return np.asarray(ratio * (ratio.sum() / (ratio @ ratio)) - 1)

    low, start, high = np.array(list(form.free.values())).T
    free = least_squares(error, start, bounds=(low, high), x_scale=high - low, xtol=1e-12, ftol=1e-12).x
    ratio = FORCE[law](shape, depth_m, form.values(1.0, free)) / force_N
    scale = float(ratio.sum() / (ratio @ ratio))  # least squares of scale x ratio - 1
    return Fitted(law, form.values(scale, free), form.scaling)


@dataclass(frozen=True, slots=True)
class Form:
    """What of a law is fitted: the value proportional to E, the `free` ones (least, start, most), the `fixed`."""

    scaling: str
    free: Mapping[str, tuple[float, float, float]]
    fixed: Mapping[str, float]

    def values(self, scale: float, free: Floats) -> dict[str, float]:
        """Return all values of the law; `free` (k,) in SI units."""
        return {self.scaling: scale, **dict(zip(self.free, map(float, free), strict=True)), **self.fixed}


# MuJoCo's solimp but the width: least, start and greatest value; MuJoCo clips impedances to [.0001, .9999].
IMPEDANCE = {
    "dmin": (0.2, 0.3, 0.95),
    "dmax": (0.2, 0.7, 0.98),
    "midpoint": (0.01, 0.3, 0.99),
    "power": (1.0, 1.5, 8.0),
}
