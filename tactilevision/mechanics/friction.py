"""The coordinate of friction in every table: mu/(mu + 3), finite where the gel sticks."""

from __future__ import annotations

import math

HALF_FRICTION = 3.0  # far above where friction has all its effect: nearly straight in mu, yet finite for no slip


def friction_place(friction: float) -> float:
    """mu -> [0, 1), no slip -> 1."""
    return 1.0 if math.isinf(friction) else friction / (friction + HALF_FRICTION)
