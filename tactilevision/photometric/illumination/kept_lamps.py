"""The lamps of a calibrated method as the arrays of its file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.illumination.lamps import MAX_POWER, Lamp, Lamps
from tactilevision.records import Floats

PLACE = ("azimuth_rad", "distance_mm", "height_mm", "length_mm", "aim_mm")  # rad and mm; then three colours
SHAPES: Mapping[str, tuple[int, ...]] = {
    "lamps_places": (3, len(PLACE)),
    "lamps_colours": (3, 3),
    "lamps_camera": (2,),
}
FARTHEST_MM = 1e4  # mm: a lamp ten metres away is a mistake


def lamp_arrays(lamps: Lamps) -> dict[str, Floats]:
    """Places in rad and mm (3, 5) and colours (3, 3) of the lamps; the camera's power and the misfit (2,)."""
    return {
        "lamps_places": np.array([[getattr(lamp, name) for name in PLACE] for lamp in lamps.lamps]),
        "lamps_colours": np.array([lamp.colour for lamp in lamps.lamps]),
        "lamps_camera": np.array([lamps.power, lamps.misfit]),
    }


def lamps_of(arrays: Mapping[str, npt.NDArray[Any]], *, where: Path) -> Lamps | None:
    """The lamps in rad and mm, which older files have none of; arrays (3, 5), (3, 3) and (2,), finite.

    Raises InputError for lamps that no sensor has.
    """
    if "lamps_places" not in arrays:
        return None
    places, colours, (power, misfit) = (arrays[name] for name in SHAPES)
    beside = places[:, 1:4]
    if beside.min() <= 0 or np.abs(places).max() > FARTHEST_MM:
        raise InputError(
            "a lamp stands beside and above the gel, at most 10 m away", where=where, value=places.tolist()
        )
    if not 0 < power <= MAX_POWER or misfit < 0 or colours.min() < 0 or np.any(colours.max(axis=1) <= 0):
        raise InputError(
            "the lamps' light is none: colours, power and misfit", where=where, value=[float(power), float(misfit)]
        )
    first, second, third = (_lamp(place, colour) for place, colour in zip(places, colours, strict=True))
    return Lamps((first, second, third), float(power), float(misfit))


def _lamp(place: npt.NDArray[Any], colour: npt.NDArray[Any]) -> Lamp:
    azimuth_rad, distance_mm, height_mm, length_mm, aim_mm = (float(value) for value in place)
    red, green, blue = (float(value) for value in colour)
    return Lamp(azimuth_rad, distance_mm, height_mm, length_mm, aim_mm, (red, green, blue))
