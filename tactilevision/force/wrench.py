"""Resultant and moment of a field of tractions, and the update of the field by a measured force.

    F = sum_cells d^2 t,    M = sum_cells r x d^2 t  about the pad's centre, r in the gel's face

    t' = t + P W^T (W P W^T + S)^-1 (f - W t)

W maps tractions to the force. A measured force corrects mainly an error common to the whole contact (the modulus,
the scale of the depth), so P is rank one per axis: the pressure as the pattern, scaled to the resultant's standard
deviation. S is the variance of the measured force; S = 0 makes it an equality. The mismatch of the unconstrained
force over its expected deviation is kept as a check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactilevision.errors import InputError
from tactilevision.force.nodes import NodeGrid
from tactilevision.records.maps import TractionMap
from tactilevision.records.measured import Floats

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeasuredForce:
    """Measured force (fx, fy, fz) and its standard deviation; 0 makes it an equality."""

    force_N: Triple
    std_N: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.force_N).all() and np.isfinite(self.std_N).all() and min(self.std_N) >= 0):
            raise InputError(
                "a measured force is three finite numbers, its standard deviations at or above 0",
                where="MeasuredForce",
                value=(self.force_N, self.std_N),
            )


def wrench_weights(grid: NodeGrid, cells: np.ndarray[tuple[int], np.dtype[np.intp]], *, parts: int) -> Floats:
    """Return (6, parts * C): force and moment by the tractions; parts is 3, or 1 for the normal one alone."""
    row, column = np.divmod(cells, grid.shape[1])
    x, y, one, none = grid.x_mm[column], grid.y_mm[row], np.ones(len(cells)), np.zeros(len(cells))
    along_x = np.stack([one, none, none, none, none, -y])
    along_y = np.stack([none, one, none, none, none, x])
    along_z = np.stack([none, none, one, y, -x, none])
    return grid.cell_mm2 * np.concatenate([along_x, along_y, along_z][3 - parts :], axis=1)


def constrain(found: TractionMap, measured: MeasuredForce) -> TractionMap:
    """Move the map towards `measured`; the mismatch of the free map is kept.

    Unknown axes (NaN) stay unknown. A map without contact is returned with the mismatch and a flag.
    """
    own, theirs = np.asarray(found.resultant_std_N), np.asarray(measured.std_N)
    mismatch = np.asarray(found.resultant_N) - np.asarray(measured.force_N)
    spread = np.hypot(own, theirs)
    sigma = np.abs(mismatch) / np.where(spread > 0, spread, np.inf)
    health = float(np.nanmax(sigma)) if np.isfinite(sigma).any() else float("nan")
    pressure = np.nan_to_num(found.t_z)
    total = float(pressure.sum()) * found.mm_per_px[0] * found.mm_per_px[1]
    if not total > 0:
        return replace(
            found,
            mismatch_N=triple(mismatch),
            mismatch_sigma=health,
            flags=(*found.flags, "measured force not used: no contact"),
        )
    share = np.divide(own**2, spread**2, out=np.zeros(3), where=spread > 0)
    step = -share * mismatch
    fields = [t + s * pressure / total for t, s in zip((found.t_x, found.t_y, found.t_z), step, strict=True)]
    return replace(
        found,
        t_x=fields[0],
        t_y=fields[1],
        t_z=fields[2],
        resultant_N=triple(np.asarray(found.resultant_N) + step),
        resultant_std_N=triple(own * np.sqrt(1 - share)),
        moment_Nmm=moment(fields, found),
        mismatch_N=triple(mismatch),
        mismatch_sigma=health,
    )


def moment(fields: list[Floats], place: TractionMap) -> Triple:
    """Return (mx, my, mz) about the pad's centre, N mm, of tractions on the nodes of `place`."""
    x = place.first_mm[0] + place.mm_per_px[0] * np.arange(fields[0].shape[1])[None, :]
    y = place.first_mm[1] + place.mm_per_px[1] * np.arange(fields[0].shape[0])[:, None]
    cell = place.mm_per_px[0] * place.mm_per_px[1]
    sums = (y * fields[2], -x * fields[2], x * fields[1] - y * fields[0])
    return triple(np.array([cell * float(s.sum()) for s in sums]))


def triple(values: Floats) -> Triple:
    """Return values (3,) as three plain numbers, in their N or N mm."""
    return (float(values[0]), float(values[1]), float(values[2]))
