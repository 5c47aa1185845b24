"""Save and load a calibrated method: arrays in NAME.npz, card in NAME.json."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.arrays import unpack_arrays
from tactilevision.files.documents import read_json
from tactilevision.files.opening import check_numbers, damage, read_bytes
from tactilevision.files.writing import as_json, pack_arrays, replacing, write_json
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.cross_validation import LightLaw
from tactilevision.photometric.markers import find_marks
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.lookup import CELLS, Lookup
from tactilevision.photometric.methods.network import OPSET, Network, open_bytes, run_network
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial
from tactilevision.photometric.methods.two_colours import COLOURS, TwoColourLaws
from tactilevision.photometric.protocols import ColourLaw, Stored
from tactilevision.photometric.reference import Reference, light_of
from tactilevision.photometric.shading_law import TERMS
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.measured import Floats

# Wall corrections from certified faces as an array of a method's file.

WALL_NUMBERS = 8  # share, growth; their two variances and covariance; least and greatest depth in mm; scatter
MAX_WALL_CHANGE = 3  # of the depth that a wall hides: beyond, the light is to be calibrated again


def wall_numbers(walls: TaughtWalls) -> Floats:
    """Return the numbers (8,) of wall corrections, depths in mm."""
    return np.array([walls.share, walls.growth, *walls.covariance, *walls.limits_mm, walls.scatter])


def taught_walls(numbers: npt.NDArray[Any], *, where: Path) -> TaughtWalls:
    """Return the wall corrections of numbers (8,), depths in mm. Raises InputError for impossible ones."""
    share, growth, of_share, of_growth, between, low, high, scatter = (float(one) for one in numbers)
    known = max(abs(share), abs(growth)) <= MAX_WALL_CHANGE and 0 < low <= high and scatter >= 0
    if not known or min(of_share, of_growth) < 0 or between**2 > of_share * of_growth:
        raise InputError("the wall corrections are out of range", where=where, value=numbers.tolist())
    return TaughtWalls(share, growth, (of_share, of_growth, between), (low, high), scatter)


# A calibrated method on disk: NAME.npz with its arrays, NAME.json with its card, which contains the hash of the
# arrays.

_Record = TypeVar("_Record", bound=Stored)
FORMAT = 1  # version of a method's card; cards of another are refused

_SHAPES: Mapping[str, tuple[int, ...]] = {
    "law_coefficients": (2, len(PRODUCTS), len(POWERS)),
    "law_steepest": (),
    "law_table": (CELLS, CELLS, CELLS, 2),
    "law_lowest": (3,),
    "law_highest": (3,),
    "reference": (0, 0, 3),
    "noise_grey": (3,),
    "usable": (0, 0),
    "marks": (),
    "relative_error": (),
    "quiet": (3, 0, 0),
    "two_colours_coefficients": (COLOURS, 2, len(PRODUCTS), len(POWERS)),
    "two_colours_steepest": (COLOURS,),
    "two_colours_errors": (COLOURS,),
    "light_terms": (len(TERMS), COLOURS),
    "light_noise": (COLOURS, 0, 0),
    "light_share": (),
    "light_limit": (),
    "walls": (WALL_NUMBERS,),
}  # sides of each array; 0: any


def save_method(method: CalibratedMethod, path: Path | str) -> Path:
    """Write `path` (.npz) and the card next to it; return the path of the arrays."""
    target = Path(path).with_suffix(".npz")
    for suffix, content in pack_method(method).items():
        with replacing(target.with_suffix(suffix)) as temporary:
            temporary.write_bytes(content)
    return target


def pack_method(method: CalibratedMethod, *, small: bool = True) -> dict[str, bytes]:
    """Return the files of a method by their endings, the card last: .npz, .onnx for a network, .json.

    `small` takes longer.
    """
    arrays = {f"law_{name}": values for name, values in method.law.arrays().items()} | {
        "reference": method.reference.rgb,
        "noise_grey": np.asarray(method.reference.noise_grey),
        "usable": method.reference.usable,
        "marks": np.array(method.reference.marks is not None),
        "relative_error": np.array(method.relative_error),
    }
    if method.background is not None:
        arrays["quiet"] = method.background
    if method.two_colours is not None:
        arrays |= {f"two_colours_{name}": values for name, values in method.two_colours.arrays().items()}
    if method.light_law is not None and np.isfinite(method.light_law.limit):
        arrays |= {f"light_{name}": values for name, values in method.light_law.arrays().items()}
    if method.walls is not None:
        arrays["walls"] = wall_numbers(method.walls)
    numbers = pack_arrays(arrays, small=small)
    files = {".npz": numbers}
    entries: dict[str, Any] = {
        "format": FORMAT,
        "method": method.name,
        "sha256": hashlib.sha256(numbers).hexdigest(),
    }
    if isinstance(method.law, Network):
        light = np.round(light_of(method.reference), 1).tolist()  # a network may be copied without its arrays
        files[".onnx"] = method.law.content
        entries |= _about_network(method.law) | {"light": light}
    return files | {".json": as_json(method.card.to_json() | entries).encode()}


def load_method(path: Path | str) -> CalibratedMethod:
    """Read a method written by `save_method`. Raises InputError where file and card do not belong together."""
    target = Path(path).with_suffix(".npz")
    card = read_card(target.with_suffix(".json"))
    if not target.is_file():
        raise InputError("the arrays of the method are missing", where=target)
    network = target.with_suffix(".onnx")
    needed = card.method == Network.name and network.is_file()
    return unpack_method(card, read_bytes(target), read_bytes(network) if needed else None, where=target)


def unpack_method(card: MethodCard, numbers: bytes, network: bytes | None, *, where: Path) -> CalibratedMethod:
    """Return the method of a card, the bytes of its .npz file, and those of its network, None without.

    `where`: the file, for error messages. Raises InputError where they do not belong together.
    """
    if card.format != FORMAT or card.sha256 != hashlib.sha256(numbers).hexdigest():
        raise InputError(
            "the method does not match its card",
            where=where,
            remedy="Copy both files together, or calibrate again.",
        )
    arrays = unpack_arrays(numbers, where=where)
    remedy = "Copy it again, or calibrate again."
    with damage(where, what="the arrays of the method are inconsistent", remedy=remedy):
        return _method(card, arrays, network, where)


def _method(
    card: MethodCard, arrays: Mapping[str, npt.NDArray[Any]], network: bytes | None, path: Path
) -> CalibratedMethod:
    for name, array in arrays.items():
        _check_array(name, array, path)
    size = arrays["usable"].shape
    if size != arrays["reference"].shape[:2] or min(size) < 2:
        raise InputError("the method's reference has different sizes, or under 2 px", where=path, value=size)
    if arrays["reference"].min() < 0 or arrays["reference"].max() > 255 or arrays["noise_grey"].min() <= 0:
        raise InputError("the method's reference has grey levels out of range", where=path)
    red, green, blue = (float(value) for value in arrays["noise_grey"])
    marks = find_marks(np.rint(arrays["reference"]).astype(np.uint8)) if arrays.get("marks", False) else None
    reference = Reference(arrays["reference"], (red, green, blue), arrays["usable"].astype(bool), marks)
    law, error = _law(card, arrays, network, path), float(arrays["relative_error"])
    if error < 0:
        raise InputError("the method's relative error is negative", where=path, value=error)
    walls = taught_walls(arrays["walls"], where=path) if "walls" in arrays else None
    two_colours = _stored(TwoColourLaws, "two_colours", arrays) if "two_colours_errors" in arrays else None
    light_law = _stored(LightLaw, "light", arrays) if "light_terms" in arrays else None
    return CalibratedMethod(law, reference, error, arrays.get("quiet"), card, two_colours, light_law, walls)


def _stored(kind: type[_Record], prefix: str, arrays: Mapping[str, npt.NDArray[Any]]) -> _Record:
    """Return the record whose fields are the arrays named by them after `prefix`."""
    values = [arrays[f"{prefix}_{one.name}"] for one in fields(kind)]
    return kind(*(value if value.ndim else value.item() for value in values))


def _check_array(name: str, array: npt.NDArray[Any], path: Path) -> None:
    """Raise InputError for an array of the wrong type or shape for its name."""
    sides = _SHAPES.get(name)
    if sides is None:
        raise InputError(
            "the method holds what this version does not read",
            where=path,
            value=name,
            remedy="Calibrate the light again.",
        )
    fits = array.ndim == len(sides) and all(
        n == side or (not side and n) for n, side in zip(array.shape, sides, strict=True)
    )
    if not fits or array.dtype.kind not in "fiub":
        raise InputError(
            f"the method's {name} has another shape", where=path, value=(array.shape, str(array.dtype))
        )
    check_numbers(array, what=f"a number of the method's {name}", where=path)
    if not np.isfinite(array).all():
        raise InputError(f"the method's {name} has a value that is not finite", where=path)


def save_network(network: Network, card: Mapping[str, Any], *, path: Path | str) -> Path:
    """Write a network without a reference: `path` (.onnx) and the card next to it."""
    target = Path(path).with_suffix(".onnx")
    with replacing(target) as temporary:
        temporary.write_bytes(network.content)
    content = dict(card) | {"format": FORMAT, "method": network.name} | _about_network(network)
    write_json(target.with_suffix(".json"), content)
    return target


def load_network(path: Path | str, reference: Reference) -> CalibratedMethod:
    """Return a network written by `save_network` as a method with `reference`.

    Raises InputError where file and card do not belong together, or the file is no such network.
    """
    target = Path(path).with_suffix(".onnx")
    card = read_card(target.with_suffix(".json"))
    law = _network(card, read_bytes(target) if target.is_file() else None, target)
    error = 1.0 if card.held_out_relative_error is None else card.held_out_relative_error
    return CalibratedMethod(law, reference, error, None, card)


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(read_bytes(path)).hexdigest()


def _law(card: MethodCard, arrays: Mapping[str, npt.NDArray[Any]], network: bytes | None, path: Path) -> ColourLaw:
    name = card.method
    if name == Network.name:
        return _network(card, network, path.with_suffix(".onnx"))
    kinds: Mapping[str | None, Any] = {kind.name: kind for kind in (Polynomial, Lookup)}
    if name not in kinds:
        raise InputError("no photometric method of that name", where=path, value=name)
    law: ColourLaw = _stored(kinds[name], "law", arrays)
    return law


def _about_network(network: Network) -> dict[str, Any]:
    """Return the entries of a network's card."""
    return {"onnx_sha256": network.sha256, "onnx_opset": OPSET, "steepest_slope": network.steepest}


def _network(card: MethodCard, content: bytes | None, path: Path) -> Network:
    """Return the network of a card after a test on one pixel."""
    if card.method != Network.name or card.onnx_sha256 is None or card.steepest_slope is None:
        raise InputError("the card is not that of a network", where=path, value=card.method)
    if content is None:
        raise InputError("the network is missing", where=path, remedy="Copy it together with its card.")
    session = open_bytes(content, card.onnx_sha256, where=path)
    slopes = run_network(session, np.zeros((1, 5, 1, 1), np.float32))
    if slopes.shape != (1, 2, 1, 1):
        raise InputError("the network does not give slopes", where=path, value=slopes.shape)
    return Network(content, card.steepest_slope, path)


def read_card(path: Path) -> MethodCard:
    """Return the card of a method. Raises InputError where it is missing or no table."""
    try:
        content = read_json(path)
    except OSError as fault:
        raise InputError(f"the method's card cannot be read: {fault}", where=path) from fault
    return MethodCard.from_json(content)
