"""The graded mesh of a gel pad: fine at the punch's edge, coarse far away. Axes r outward, z up from the base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skfem

from tactilevision.errors import InputError
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """How fine the mesh is.

    Elements of `edge_size_mm` lie along the surface, and under the punch's edge from `inside_mm` within it to
    `outside_mm` beyond it; from there each is at most `growth` times its neighbour, up to `largest_mm`.
    """

    edge_size_mm: float
    largest_mm: float
    inside_mm: float = 0.0
    outside_mm: float = 0.0
    growth: float = 1.5

    def __post_init__(self) -> None:
        if not (
            0 < self.edge_size_mm <= self.largest_mm
            and self.growth > 1
            and min(self.inside_mm, self.outside_mm) >= 0
        ):
            raise InputError(
                "a mesh needs 0 < edge_size_mm <= largest_mm, growth > 1 and inside_mm, outside_mm >= 0",
                where="MeshSettings",
                value=(self.edge_size_mm, self.largest_mm, self.growth, self.inside_mm, self.outside_mm),
            )


def sizes_from(first: float, length: float, *, settings: MeshSettings) -> Floats:
    """Element sizes (N,) mm over `length`, from about `first` growing; scaled so that they fill it exactly."""
    sizes, total = [first], first
    while total < length * (1 - 1e-9):
        sizes.append(min(sizes[-1] * settings.growth, settings.largest_mm))
        total += sizes[-1]
    return np.array(sizes) * (length / total)


def graded_lines(
    radius_mm: float, thickness_mm: float, *, pad_radius_mm: float, settings: MeshSettings
) -> tuple[Floats, Floats]:
    """The r (N,) and z (M,) mm of the mesh lines; one of them lies at r = radius_mm exactly."""
    fine = settings.edge_size_mm
    inner = min(settings.inside_mm, radius_mm / 2)
    outer = min(settings.outside_mm, (pad_radius_mm - radius_mm) / 2)
    zone_in = np.full(round(inner / fine), inner / max(round(inner / fine), 1))
    zone_out = np.full(round(outer / fine), outer / max(round(outer / fine), 1))
    inward = sizes_from(fine, radius_mm - zone_in.sum(), settings=settings)
    outward = sizes_from(fine, pad_radius_mm - radius_mm - zone_out.sum(), settings=settings)
    r = np.concatenate([[0.0], np.cumsum(np.concatenate([inward[::-1], zone_in, zone_out, outward]))])
    down = sizes_from(fine, thickness_mm, settings=settings)
    z = thickness_mm - np.concatenate([np.cumsum(down)[::-1], [0.0]])
    r[-1], z[0], z[-1] = pad_radius_mm, 0.0, thickness_mm
    return r, z


def graded_mesh(
    radius_mm: float, thickness_mm: float, *, pad_radius_mm: float, settings: MeshSettings
) -> skfem.MeshQuad:
    """Quadrilaterals over 0 <= r <= pad_radius_mm, 0 <= z <= thickness_mm. Raises InputError unless 0 < a < R, h
    > 0."""
    if not (thickness_mm > 0 and 0 < radius_mm < pad_radius_mm):
        raise InputError(
            "the punch's radius lies between 0 and the pad's, and the gel has a thickness",
            where="punch_fem",
            value={"radius_mm": radius_mm, "pad_radius_mm": pad_radius_mm, "thickness_mm": thickness_mm},
        )
    return skfem.MeshQuad.init_tensor(
        *graded_lines(radius_mm, thickness_mm, pad_radius_mm=pad_radius_mm, settings=settings)
    )
