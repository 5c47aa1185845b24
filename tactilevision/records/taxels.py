"""Readings on a grid of taxels, as simulators of tactile sensors give them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Bools, Floats, Pair

SEEN = 0.5  # share of a taxel's area that has to be seen


@dataclass(frozen=True, slots=True)
class TaxelGrid:
    """Taxels of `rows` (y, down) by `columns` (x, right), `pitch_mm` (x, y) apart; `centre_mm` is on the pad."""

    rows: int
    columns: int
    pitch_mm: Pair
    centre_mm: Pair = (0.0, 0.0)

    def __post_init__(self) -> None:
        sound = min(self.rows, self.columns) >= 1 and np.isfinite((*self.pitch_mm, *self.centre_mm)).all()
        if not (sound and min(self.pitch_mm) > 0):
            raise InputError(
                "a grid has at least one row and column, and pitches above 0 mm",
                where="TaxelGrid",
                value=(self.rows, self.columns, self.pitch_mm, self.centre_mm),
            )

    def places_mm(self) -> tuple[Floats, Floats]:
        """Return the middles of the columns (columns,) and rows (rows,) on the pad, mm."""
        x = self.centre_mm[0] + (np.arange(self.columns) - (self.columns - 1) / 2) * self.pitch_mm[0]
        y = self.centre_mm[1] + (np.arange(self.rows) - (self.rows - 1) / 2) * self.pitch_mm[1]
        return np.asarray(x, dtype=float), np.asarray(y, dtype=float)


@dataclass(frozen=True, slots=True)
class Taxels:
    """`penetration_m` (rows, columns); `traction_Pa` (3, rows, columns) on the gel, x, y, z, or None."""

    grid: TaxelGrid
    penetration_m: Floats
    traction_Pa: Floats | None

    @property
    def force_N(self) -> Floats | None:
        """Return the force (3, rows, columns) of each taxel, N: traction times area."""
        if self.traction_Pa is None:
            return None
        return self.traction_Pa * (self.grid.pitch_mm[0] * self.grid.pitch_mm[1] * MICRO)


def taxel_means(fields: Floats, valid: Bools, mm_per_px: Pair, first_mm: Pair, *, grid: TaxelGrid) -> Floats:
    """Return means (n, rows, columns), in their unit, of fields (n, H, W) over taxels, by overlapping area.

    `first_mm` is the place of pixel (0, 0). Only `valid` (H, W) pixels count; NaN where less than half is valid.
    """
    x, y = grid.places_mm()
    across = _overlap(x, grid.pitch_mm[0], first_mm[0], mm_per_px[0], fields.shape[2])
    down = _overlap(y, grid.pitch_mm[1], first_mm[1], mm_per_px[1], fields.shape[1])
    area = down @ valid @ across.T
    total = down @ np.where(valid, fields, 0.0) @ across.T
    enough = area >= SEEN * grid.pitch_mm[0] * grid.pitch_mm[1]
    return np.asarray(np.where(enough, total / np.where(enough, area, 1.0), np.nan))


def _overlap(middles: Floats, pitch: float, first: float, scale: float, count: int) -> Floats:
    """Return the length (taxels, pixels) in mm that each taxel shares with each pixel."""
    pixels = first + scale * np.arange(count)
    right = np.minimum(middles[:, None] + pitch / 2, pixels + scale / 2)
    left = np.maximum(middles[:, None] - pitch / 2, pixels - scale / 2)
    return np.asarray(np.maximum(right - left, 0.0))
