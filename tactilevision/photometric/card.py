"""Card of a photometric method: provenance, errors, and how to evaluate it.

On disk a card is a JSON table whose keys are the fields of `MethodCard`. Other keys are kept in `other`, so that a
card of another version is written as it was read.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

from tactilevision.errors import InputError, installed_version
from tactilevision.files.opening import number
from tactilevision.records.measured import Pair

MAX_RATIO = 1_000_000  # of a deviation to the depth: the square of more may overflow
PACKAGES = ("numpy", "torch", "kornia", "onnxruntime")

Rows = list[Any]  # (h, w) or (h, w, 3), over blocks of the picture


def _float(value: Any) -> float:
    found = number(value, what="a number", where="the method's card")
    if found is None:
        raise TypeError("it is no number")
    return found


def _pair(value: Any) -> Pair:
    x, y = map(_float, value)
    return x, y


def _floats(value: Any) -> tuple[float, ...]:
    return tuple(map(_float, value))


def _ratios(value: Any, most: float = MAX_RATIO) -> Rows:
    """Return rows (h, w) of ratios from 0 to `most`, all as long as the first."""
    rows = [list(_floats(row)) for row in value]
    if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("it is no rectangle of numbers")
    if not all(0.0 <= one <= most for row in rows for one in row):
        raise ValueError(f"a number in it is not from 0 to {most:g}")
    return rows


_READERS: dict[str, Callable[[Any], Any]] = {
    "str": str,
    "int": lambda value: int(_float(value)),
    "float": _float,
    "Pair": _pair,
    "Rows": list,
    "tuple[float, ...]": _floats,
    "dict[str, float]": lambda value: {str(name): _float(one) for name, one in value.items()},
    "dict[str, Any]": dict,
    "Mapping[str, Any]": dict,
    "place_gain_std": _ratios,
    "extrapolated_gain_std": partial(_ratios, most=1.0),
}  # JSON value to a field, by the type or the name of the field


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodCard:
    """Card of one method; None is unknown. Slopes and gains have no unit."""

    # provenance
    method: str | None = None
    balls: int | None = None
    balls_left_out: int | None = None
    balls_cover: tuple[float, ...] | None = None  # of the picture, across and down
    sensor: str | None = None
    light: Rows | None = None  # grey levels of the blocks that it was made in

    # errors
    held_out_direction_error_deg: float | None = None  # median
    held_out_slope_rms: float | None = None
    held_out_relative_error: float | None = None
    held_out_gain_std: float | None = None
    seen_gain_std: float | None = None  # over the balls of the fit
    place_gain_std: Rows | None = None
    extrapolated_gain_std: Rows | None = None  # beyond the outermost balls
    coverage_factor: float | None = None
    min_slope_noise: float | None = None  # best direction
    max_slope_noise: float | None = None  # worst direction
    frame_noise: float | None = None  # relative to the noise of the reference
    untouched_depth_rms_mm: float | None = None
    untouched_std_mm: Rows | None = None
    depth_terms_mm: dict[str, Any] | None = None  # of ball presses, by term and depth
    baseline: dict[str, float] | None = None  # misfit, zero_std_mm
    contact_in_reference_px: Pair | None = None  # x, y
    balls_at_that_contact: float | None = None  # share of those found

    # evaluation
    fitted_by: str | None = None
    ridge: float | None = None
    steepest_slope: float | None = None
    response: Mapping[str, Any] | None = None  # of the camera: power, answers
    tile_px: int | None = None  # side of the blocks that untouched gel is averaged over

    # files
    format: int | None = None
    sha256: str | None = None
    onnx_sha256: str | None = None
    onnx_opset: int | None = None

    other: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> MethodCard:
        """Return the card of a JSON table. Raises InputError for a value of the wrong type."""
        rest, known = dict(content), dict[str, Any]()
        for name, kind in _entries().items():
            value = rest.pop(name, None)
            if value is not None:
                try:
                    known[name] = _READERS.get(name, _READERS[kind])(value)
                except (TypeError, ValueError, AttributeError) as fault:
                    raise InputError(
                        "the method's card cannot be read",
                        where=name,
                        value=str(value)[:40],
                        remedy=f"{_why(fault)}. Restore the original file, or calibrate again.",
                    ) from fault
        return cls(**known, other=rest)

    def to_json(self) -> dict[str, Any]:
        """Return the card as a JSON table without unknown entries."""
        known = {name: getattr(self, name) for name in _entries()}
        return {name: value for name, value in known.items() if value is not None} | dict(self.other)

    def extended(self, entries: Mapping[str, Any]) -> MethodCard:
        """Return the card with further `entries`, by their keys on disk."""
        return MethodCard.from_json(self.to_json() | dict(entries))


def _why(fault: Exception) -> str:
    """Return the fault of a value, as a sentence without its full stop."""
    why = fault.what if isinstance(fault, InputError) else str(fault)
    return why[:1].upper() + why[1:]


def _entries() -> dict[str, str]:
    """Return the types of the fields by name, without `other`."""
    return {one.name: str(one.type).removesuffix(" | None") for one in fields(MethodCard) if one.name != "other"}


def provenance(data: str, *, licence: str) -> dict[str, Any]:
    """Return entries of a card: date, versions, `licence` of the file, and `data` it was made from."""
    return {
        "data": data,
        "date": datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        "licence": licence,
        "versions": {name: found for name in ("tactilevision", *PACKAGES) if (found := installed_version(name))},
    }
