"""Shapes that press on the gel, and the layer's force on each: what contact laws are fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from tactilevision.errors import InputError, check_known
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.punch_equation import positive
from tactilevision.mechanics.ridge_contact import Ridge
from tactilevision.mechanics.round_contact import Ball, contact_curve
from tactilevision.mechanics.tables.cases import USUAL
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records.measured import Floats, Material

ShapeName = Literal["ball", "flat", "ridge"]
DEEPEST = 0.25  # of the thickness: the depth to which the layer's response is tabulated or checked
EDGE_OVER_H = USUAL.edges_over_h[0]  # rounding of a flat punch's edge over the thickness


@dataclass(frozen=True, slots=True)
class Shape:
    """A ball, a flat punch or a ridge (a cylinder lying on the gel over `length_mm`) of `radius_mm`."""

    name: ShapeName = "ball"
    radius_mm: float = 4.0
    length_mm: float = 10.0

    def __post_init__(self) -> None:
        check_known(self.name, get_args(ShapeName), what="there is no such shape", where="shape")
        positive("radius_mm", self.radius_mm)
        positive("length_mm", self.length_mm)

    def __str__(self) -> str:
        along = f", {self.length_mm:g} mm long" if self.name == "ridge" else ""
        name = "flat punch" if self.name == "flat" else self.name
        return f"{name} of {self.radius_mm:g} mm radius{along}"


def layer_force(
    shape: Shape, depth_mm: Floats, *, material: Material, thickness_mm: float, friction: float = 0.0
) -> Floats:
    """Return the gel's force (N) on the shape at depths (n,) in mm.

    Ball and ridge: the exact linear layer without friction. Flat punch: the table of finite elements (neo-Hooke,
    edge rounded by h/60) at this friction. Raises InputError beyond a quarter of the thickness or outside the
    table.
    """
    if shape.name == "flat":
        contact = FlatContact(shape.radius_mm, EDGE_OVER_H * thickness_mm, thickness_mm, friction)
        return punch_force(depth_mm, contact, material=material)
    body = Ball(shape.radius_mm) if shape.name == "ball" else Ridge(shape.radius_mm, shape.length_mm)
    curve = contact_curve(body, depth_mm, thickness_mm=thickness_mm, poisson_ratio=material.poisson_ratio)
    return material.youngs_modulus_MPa * curve.force_over_E_mm2


def other_shapes(fitted: Shape) -> tuple[Shape, ...]:
    """Return shapes of the same size that were not fitted: other balls, flat punches and ridges."""
    ball = 2 * fitted.radius_mm if fitted.name == "flat" else fitted.radius_mm
    every = (
        Shape("ball", ball / 2),
        Shape("ball", ball),
        Shape("ball", 2 * ball),
        Shape("flat", ball / 2),
        Shape("ridge", ball, fitted.length_mm),
    )
    return tuple(one for one in every if (one.name, one.radius_mm) != (fitted.name, fitted.radius_mm))


def check_depths(depths_mm: tuple[float, float], thickness_mm: float) -> None:
    """Raise InputError unless the two depths rise and lie in the range of the layer's response."""
    low, high = depths_mm
    if not (np.isfinite(depths_mm).all() and 0 < low < high):
        raise InputError("two depths above 0 mm are needed, the smaller first", where="depths", value=depths_mm)
    if high >= thickness_mm:
        raise InputError(
            "the depth exceeds the gel's thickness",
            where="depths",
            value=high,
            remedy=f"The gel is {thickness_mm:g} mm thick; give depths to {DEEPEST * thickness_mm:g} mm.",
        )
    if high > DEEPEST * thickness_mm:
        raise InputError(
            "the depth is beyond a quarter of the gel's thickness, where the layer's response is not known",
            where="depths",
            value=high,
            remedy=f"Give depths to {DEEPEST * thickness_mm:g} mm.",
        )
