"""A flat punch on a bonded gel pad, and the coordinate of friction in tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError

WIDE = 5.0  # thicknesses: radius from which a pad acts as an unbounded one


@dataclass(frozen=True, slots=True)
class FlatContact:
    """A cylinder of `radius_mm` whose face ends in a quarter circle of `edge_radius_mm` (0: sharp), on a gel disc.

    `friction` is Coulomb's, inf for no slip; `law` the gel's, by name. Raises InputError for impossible values.
    """

    radius_mm: float
    edge_radius_mm: float
    thickness_mm: float
    friction: float
    law: str = "neo-hooke"
    pad_radius_mm: float = float("inf")

    def __post_init__(self) -> None:
        sizes = (self.radius_mm, self.edge_radius_mm, self.thickness_mm)
        sound = np.isfinite(sizes).all() and self.thickness_mm > 0 and 0 <= self.edge_radius_mm < self.radius_mm
        if not sound:
            raise InputError(
                "radius and thickness lie above 0 mm, the edge's radius in [0, radius)",
                where="FlatContact",
                value=sizes,
            )
        if not self.radius_mm < self.pad_radius_mm:
            raise InputError(
                "the punch is not smaller than the gel pad",
                where="FlatContact",
                value=self.radius_mm,
                remedy=f"The pad reaches {self.pad_radius_mm:g} mm from its centre.",
            )
        if not self.friction >= 0:
            raise InputError("friction is 0 or more, inf for no slip", where="FlatContact", value=self.friction)

    @property
    def a_over_h(self) -> float:
        """Radius over thickness."""
        return self.radius_mm / self.thickness_mm

    @property
    def edge_over_h(self) -> float:
        """Edge radius over thickness."""
        return self.edge_radius_mm / self.thickness_mm


HALF_FRICTION = 3  # of mu/(mu + 3), nearly linear up to full friction, yet finite for no slip


def friction_place(friction: float) -> float:
    """Map a coefficient of friction to [0, 1); no slip is 1."""
    return 1.0 if math.isinf(friction) else friction / (friction + HALF_FRICTION)
