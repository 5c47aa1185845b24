"""Physical ranges of numbers, by the name of a record's field, which is also that of a table's column or a key."""

from __future__ import annotations

import re
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError

Range = tuple[float, float]  # least and most, in the unit of the field's name

SCALE: Range = (1e-4, 100.0)  # mm per px: from below the resolution of light to a gel in one pixel
_SIZE: Range = (1e-6, 1e4)  # mm: from the tip of an atomic force microscope, 1 nm, to 10 m
_ERROR: Range = (0.0, 1e6)  # in any unit: no deviation and no distance is negative
_STEEPNESS: Range = (0.0, 90.0)  # degrees between a face and the gel
_DURATION: Range = (0.0, 1e11)  # s: nothing lasts less than no time

_BY_NAME: dict[str, Range] = {
    "thickness_mm": (1e-3, 1e4),  # from a film of 1 um to 10 m; a pad stated in um is then named by the fit
    **dict.fromkeys(("radius_mm", "ball_radius_mm", "size_mm", "height_mm", "bevel_distance_mm"), _SIZE),
    **dict.fromkeys(("edge_radius_mm", "from_mm", "to_mm", "width_px", "height_px", "contact_radius_px"), _ERROR),
    **dict.fromkeys(("bevel_angle_deg", "half_angle_deg"), _STEEPNESS),
    **dict.fromkeys(("rest_s", "hold_s"), _DURATION),
    "poisson_ratio": (0.0, 0.5),  # of solids that narrow when they are pulled, and gain no volume when pressed
    "mm_per_px": SCALE,
}
_FORCE: Range = (-1e6, 1e6)  # N, and N m: the weight of 100 t; more is another unit, or a broken file
_BY_UNIT: dict[str, Range] = {
    "mm": (-1e6, 1e6),  # 1 km to either side, since a logger's 9999 is excluded later, by name
    "mm_s": (-1e6, 1e6),  # 1 km/s
    "s": (-1e11, 1e11),  # 3000 years; milliseconds since 1970 are more
    "N": _FORCE,
    "Nm": _FORCE,
    "MPa": (1e-7, 1e7),  # from .1 Pa, softer than every hydrogel, to ten times diamond
    "deg": (0.0, 360.0),  # one turn
    "C": (-273.15, 2e3),  # from absolute zero to beyond every gel
    "px": (-1e6, 1e6),  # more than any picture has
}


def range_of(name: str) -> Range | None:
    """Return the range of a field, column or key in its unit; None where any finite number is possible."""
    if name in _BY_NAME or re.search("(^|_)std(_|$)", name):
        return _BY_NAME.get(name, _ERROR)
    found = re.search("_(mm_s|[^_]+)$", name)
    return _BY_UNIT.get(found[1]) if found else None


def outside(values: npt.ArrayLike, name: str) -> npt.NDArray[np.bool_]:
    """Return which numbers, of any shape and in the name's unit, are impossible; NaN, not known, is not."""
    array, (least, most) = np.asarray(values, dtype=float), range_of(name) or (-np.inf, np.inf)
    return np.asarray((array < least) | (array > most))


def impossible(name: str) -> str:
    """Return what is wrong with a number of this name that is outside."""
    least, most = range_of(name) or (-np.inf, np.inf)
    return f"{name} must lie between {least:g} and {most:g}"


@cache
def _ranges_of(record: type) -> tuple[tuple[str, Range], ...]:
    return tuple((one.name, found) for one in fields(record) if (found := range_of(one.name)))


def check_ranges(record: Any) -> None:
    """Raise InputError for the first field of a record with an impossible number, in the unit of its name."""
    for name, (least, most) in _ranges_of(record.__class__):
        value = getattr(record, name)
        if value is None or (isinstance(value, float) and not (value < least or value > most)):
            continue  # the usual case, fast
        if (bad := outside(value, name)).any():
            label = getattr(record, "press", getattr(record, "name", ""))
            where = f"{type(record).__name__.lower()} {label}".strip()
            raise InputError(impossible(name), where=where, value=float(np.asarray(value, float)[bad].flat[0]))


class Ranged:
    """Base of records whose constructor checks the ranges of all fields."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_ranges(self)
