"""The lamps of a calibrated method as the arrays of its file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.illumination.lamps import MAX_LAMPS, MAX_POWER, Lamp, Lamps
from tactilevision.records.measured import Floats

PLACE = ("azimuth_rad", "distance_mm", "height_mm", "length_mm", "aim_mm")  # rad and mm; then three colours
OWN, REFINED = "lamps", "refined_lamps"  # what the names of arrays begin with
UNEXPLAINED = "lamps_unexplained"  # what files of before do not have
PARTS: Mapping[str, tuple[int, ...]] = {"places": (0, len(PLACE)), "colours": (0, 3), "camera": (2,)}
SHAPES: Mapping[str, tuple[int, ...]] = {
    **{f"{kind}_{part}": shape for kind in (OWN, REFINED) for part, shape in PARTS.items()},
    UNEXPLAINED: (),
}
FARTHEST_MM = 1e4  # mm: a lamp ten metres away is a mistake


def lamp_arrays(lamps: Lamps) -> dict[str, Floats]:
    """Places in rad and mm (lamps, 5) and colours (lamps, 3); the camera's power and the misfit (2,).

    What the lamps leave unexplained; and the same of the refined ones, where there are any.
    """
    own = _arrays(lamps, OWN) | {UNEXPLAINED: np.array(lamps.unexplained)}
    return own | (_arrays(lamps.refined, REFINED) if lamps.refined else {})


def _arrays(lamps: Lamps, kind: str) -> dict[str, Floats]:
    return {
        f"{kind}_places": np.array([[getattr(lamp, name) for name in PLACE] for lamp in lamps.lamps]),
        f"{kind}_colours": np.array([lamp.colour for lamp in lamps.lamps]),
        f"{kind}_camera": np.array([lamps.power, lamps.misfit]),
    }


def lamps_of(arrays: Mapping[str, npt.NDArray[Any]], *, where: Path) -> Lamps | None:
    """The lamps in rad and mm, which older files have none of; arrays (lamps, 5), (lamps, 3) and (2,), finite.

    Raises InputError for lamps that no sensor has.
    """
    lamps = _lamps(arrays, OWN, where=where)
    unexplained = float(arrays.get(UNEXPLAINED, 0.0))
    return lamps and replace(lamps, refined=_lamps(arrays, REFINED, where=where), unexplained=unexplained)


def _lamps(arrays: Mapping[str, npt.NDArray[Any]], kind: str, *, where: Path) -> Lamps | None:
    if f"{kind}_places" not in arrays:
        return None
    places, colours, (power, misfit) = (arrays[f"{kind}_{part}"] for part in PARTS)
    if len(places) != len(colours) or not 3 <= len(places) <= MAX_LAMPS:
        raise InputError(
            f"three to {MAX_LAMPS} lamps, each with a colour", where=where, value=(len(places), len(colours))
        )
    beside = places[:, 1:4]
    if beside.min() <= 0 or np.abs(places).max() > FARTHEST_MM:
        raise InputError(
            "a lamp stands beside and above the gel, at most 10 m away", where=where, value=places.tolist()
        )
    if not 0 < power <= MAX_POWER or misfit < 0 or colours.min() < 0 or np.any(colours.max(axis=1) <= 0):
        raise InputError(
            "the lamps' light is none: colours, power and misfit", where=where, value=[float(power), float(misfit)]
        )
    found = tuple(_lamp(place, colour) for place, colour in zip(places, colours, strict=True))
    return Lamps(found, float(power), float(misfit))


def _lamp(place: npt.NDArray[Any], colour: npt.NDArray[Any]) -> Lamp:
    azimuth_rad, distance_mm, height_mm, length_mm, aim_mm = (float(value) for value in place)
    red, green, blue = (float(value) for value in colour)
    return Lamp(azimuth_rad, distance_mm, height_mm, length_mm, aim_mm, (red, green, blue))
