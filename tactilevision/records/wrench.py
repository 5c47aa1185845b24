"""Records of wrenches: force and moment about a point, and contact patches.

Axes are those of the rectified picture: x right, y down, z into the gel, seen from the camera a left-handed set.
Forces act on the gel. A moment is r x F by components, mx = y fz - z fy, my = z fx - x fz, mz = x fy - y fx, with
r
from a point; places are on the untouched face, z = 0, so the lever of shear neglects the depth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Floats, Pair

Triple = tuple[float, float, float]
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
COMPONENTS = ("fx_N", "fy_N", "fz_N", "mx_Nmm", "my_Nmm", "mz_Nmm")
STDS = tuple(name.replace("_", "_std_") for name in COMPONENTS)
PAIRS = tuple((i, j) for i in range(6) for j in range(i + 1, 6))
PATCH_COLUMNS = (
    *("patch", *COMPONENTS, *STDS, "x_mm", "y_mm", "x_std_mm", "y_std_mm", "area_mm2", "depth_mm"),
    *("torsion_Nmm", "torsion_std_Nmm", *(f"cov_{AXES[i]}_{AXES[j]}" for i, j in PAIRS)),
    *("friction", "friction_std", "load_share", "load_share_std", "margin_N", "lagging_cells", "slipping"),
)


@dataclass(frozen=True, slots=True)
class Wrench:
    """Force (fx, fy, fz) N and moment (mx, my, mz) N mm about `point_mm`, each with its standard deviation.

    `point_mm` is from the pad's centre on the untouched face, along the same axes. `covariance` (6, 6) of force
    and moment in this order, N^2, N^2 mm and (N mm)^2. NaN: not measured, as fx and fy without marks or texture to
    track.
    """

    force_N: Triple
    force_std_N: Triple
    moment_Nmm: Triple
    moment_std_Nmm: Triple
    covariance: Floats | None = None
    point_mm: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, values: Floats, covariance: Floats, point_mm: Triple = (0.0, 0.0, 0.0)) -> Self:
        """Return the wrench of `values` (6,), N and N mm, and their `covariance` (6, 6)."""
        std = np.sqrt(np.diag(covariance))
        force, force_std, moment, moment_std = (triple(one) for one in (values[:3], std[:3], values[3:], std[3:]))
        return cls(force, force_std, moment, moment_std, np.asarray(covariance), point_mm)

    @property
    def values(self) -> Floats:
        """Return force and moment (6,), N and N mm."""
        return np.array([*self.force_N, *self.moment_Nmm])

    def at(self, point_mm: npt.ArrayLike, rotation: npt.ArrayLike | None = None) -> Wrench:
        """Return the same wrench about another point, its components along rotated axes.

            F' = R F,    M' = det(R) R (M + (p - p') x F),    covariance' = A covariance A^T

        `point_mm` (3,) p' along the present axes; `rotation` (3, 3) R, rows the new axes by the old ones; det(R) =
        -1 is a mirror, as from the left-handed axes of the picture to right-handed ones. A component that depends
        on one not measured is NaN. Raises InputError for a matrix that is not orthogonal.
        """
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
        if turn.shape != (3, 3) or np.abs(turn @ turn.T - np.eye(3)).max() > MICRO:
            raise InputError(
                "a rotation is an orthogonal matrix (3, 3)",
                where="Wrench.at",
                value=turn.tolist(),
                remedy="Give the rows of unit vectors of the new axes.",
            )
        x, y, z = np.subtract(self.point_mm, point_mm)
        lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        hand = float(np.sign(np.linalg.det(turn)))
        change = np.block([[turn, np.zeros((3, 3))], [hand * turn @ lever, hand * turn]])
        square = np.diag(np.square([*self.force_std_N, *self.moment_std_Nmm]))
        whole = square if self.covariance is None else self.covariance
        return Wrench.of(*_changed(change, self.values, whole), triple(turn @ np.asarray(point_mm, dtype=float)))


def _changed(change: Floats, values: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return `change` (6, 6) @ values and its covariance; NaN where what is unknown has a share."""
    values_unknown, unknown = (
        (np.abs(change) > MICRO**2) @ np.isnan(one) > 0 for one in (values, np.diag(covariance))
    )
    moved = np.where(values_unknown, np.nan, change @ np.nan_to_num(values))
    spread = change @ np.nan_to_num(covariance) @ change.T
    spread[unknown], spread[:, unknown] = np.nan, np.nan
    return moved, spread


@dataclass(frozen=True, slots=True)
class Slip:
    """How near a patch is to sliding.

    `friction` mu; `load_share` (Q/P)/mu, 1 where all slides; each with its deviation; `margin_N` the tangential
    force that is left, mu P - Q; `lagging` cells that slip. NaN where the share may be below .6: little slips, and
    friction is hardly told. `imminent`: the share exceeds .7. `why` states what hinders; then `lagging` counts
    nothing.
    """

    friction: float = math.nan
    friction_std: float = math.nan
    load_share: float = math.nan
    load_share_std: float = math.nan
    margin_N: float = math.nan
    lagging: int = 0
    imminent: bool = False
    why: str = ""

    @property
    def row(self) -> tuple[float, ...]:
        """Return the values of the last columns of PATCH_COLUMNS, in their units; NaN for what these data cannot
        tell.
        """
        counted = (math.nan, math.nan) if self.why else (float(self.lagging), float(self.imminent))
        return (
            self.friction,
            self.friction_std,
            self.load_share,
            self.load_share_std,
            self.margin_N,
            *counted,
        )


@dataclass(frozen=True, slots=True)
class Patch:
    """One contact patch.

    `number` identifies it over the frames of a stream or recording. `wrench` is about the pad's centre;
    `centre_mm` (x, y) the centre of pressure, (-my, mx) / fz, with its standard deviation; `area_mm2` of the
    pressed cells; `depth_mm` their mean depth; `torsion_Nmm` the moment about z through the centre of pressure.
    `slip` is None where shear was not measured.
    """

    number: int
    wrench: Wrench
    centre_mm: Pair
    centre_std_mm: Pair
    area_mm2: float
    depth_mm: float
    torsion_Nmm: float
    torsion_std_Nmm: float
    slip: Slip | None = None

    @property
    def row(self) -> tuple[float, ...]:
        """Return the values of PATCH_COLUMNS, in their units; those of `cov_` in N^2, N^2 mm or (N mm)^2."""
        own = self.wrench
        spread = np.full((6, 6), np.nan) if own.covariance is None else own.covariance
        place = (*self.centre_mm, *self.centre_std_mm, self.area_mm2, self.depth_mm)
        shared = (float(spread[pair]) for pair in PAIRS)
        wrench = (*own.force_N, *own.moment_Nmm, *own.force_std_N, *own.moment_std_Nmm)
        slip = (self.slip or Slip(why="shear not measured")).row
        return (float(self.number), *wrench, *place, self.torsion_Nmm, self.torsion_std_Nmm, *shared, *slip)


def patch_of(
    number: int, wrench: Wrench, *, area_mm2: float, depth_mm: float, place_mm: Sequence[float] | None = None
) -> Patch:
    """Return the patch of a wrench about the pad's centre, N and N mm, with the place and torsion that follow.

    `place_mm` (3,) is the centre of pressure on a curved surface; on a flat one it follows from the wrench.
    """
    fz, mx, my = wrench.force_N[2], wrench.moment_Nmm[0], wrench.moment_Nmm[1]
    if not fz > 0:
        nowhere = (math.nan, math.nan)
        return Patch(number, wrench, nowhere, nowhere, area_mm2, depth_mm, math.nan, math.nan)
    x, y = (-my / fz, mx / fz) if place_mm is None else (place_mm[0], place_mm[1])
    assert wrench.covariance is not None
    slopes = np.array([[-x, 0.0, -1.0], [-y, 1.0, 0.0]]) / fz  # of (x, y) by (fz, mx, my)
    spread = np.sqrt(np.diag(slopes @ wrench.covariance[2:5, 2:5] @ slopes.T))
    along, lever = [0, 1, 5], np.array([y, -x, 1.0])  # torsion by (fx, fy, mz)
    return Patch(
        number,
        wrench,
        (x, y),
        (float(spread[0]), float(spread[1])),
        area_mm2,
        depth_mm,
        float(lever @ wrench.values[along]),
        float(np.sqrt(lever @ wrench.covariance[np.ix_(along, along)] @ lever)),
    )


def triple(values: Floats) -> Triple:
    """Return values (3,) as three plain numbers, in their unit."""
    return (float(values[0]), float(values[1]), float(values[2]))
