"""Describe a flat punch on a bonded gel pad, with the coordinate of friction that tables share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError

# A flat punch on a bonded gel pad, as a record that tables and solvers share.

WIDE = 5.0  # thicknesses: a pad that reaches farther acts as an unbounded one


@dataclass(frozen=True, slots=True)
class FlatContact:
    """A cylinder of `radius_mm` whose face ends in a quarter circle of `edge_radius_mm` (0: sharp), on a gel disc.

    `friction` is Coulomb's, inf for no slip; `law` the gel's, by its name. Raises InputError for what cannot be.
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
                "the punch is as wide as the gel pad",
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


# The coordinate of friction in every table: mu/(mu + 3), finite where the gel sticks.

HALF_FRICTION = 3.0  # far above where friction has all its effect: nearly straight in mu, yet finite for no slip


def friction_place(friction: float) -> float:
    """Map a coefficient of friction to [0, 1); no slip is 1."""
    return 1.0 if math.isinf(friction) else friction / (friction + HALF_FRICTION)
