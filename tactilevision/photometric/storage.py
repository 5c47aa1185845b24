"""A calibrated method on disk: NAME.npz with its numbers, NAME.json with its card.

The card says what the method is, what it was made from, how far it was off on balls left out, and the hash of the
numbers; a file that does not match its card is refused.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files import replacing, write_json
from tactilevision.photometric.lookup import Lookup
from tactilevision.photometric.marks import find_marks
from tactilevision.photometric.method import CalibratedMethod, ColourLaw
from tactilevision.photometric.polynomial import Polynomial
from tactilevision.photometric.quiet import Quiet
from tactilevision.photometric.reference import Reference

FORMAT = 1


def save_method(method: CalibratedMethod, path: Path | str) -> Path:
    """Write `path` (.npz) and the card beside it; returns the path of the numbers."""
    target = Path(path).with_suffix(".npz")
    held = {f"law_{name}": values for name, values in method.law.arrays().items()} | {
        "reference": method.reference.rgb,
        "noise_grey": np.asarray(method.reference.noise_grey),
        "usable": method.reference.usable,
        "marks": np.array(method.reference.marks is not None),
        "relative_error": np.array(method.relative_error),
    }
    if method.quiet is not None:
        held["quiet"] = np.stack([method.quiet.bias_x, method.quiet.bias_y, method.quiet.noise])
    with replacing(target) as temporary:
        np.savez_compressed(temporary, **held)  # type: ignore[arg-type]
    card = dict(method.card) | {"format": FORMAT, "method": method.name, "sha256": digest(target)}
    write_json(target.with_suffix(".json"), card)
    return target


def load_method(path: Path | str) -> CalibratedMethod:
    """Read a method written by `save_method`. Raises InputError where file and card do not belong together."""
    target = Path(path).with_suffix(".npz")
    card = _card(target.with_suffix(".json"))
    if not target.is_file():
        raise InputError("the method's numbers are missing", where=target)
    if card.get("format") != FORMAT or card.get("sha256") != digest(target):
        raise InputError(
            "the method does not match its card",
            where=target,
            remedy="Copy both files together, or calibrate again.",
        )
    try:
        with np.load(target, allow_pickle=False) as arrays:
            held = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile) as fault:
        raise InputError(f"the method cannot be read: {fault}", where=target) from fault
    red, green, blue = (float(value) for value in held["noise_grey"])
    marks = find_marks(np.rint(held["reference"]).astype(np.uint8)) if held.get("marks", False) else None
    reference = Reference(held["reference"], (red, green, blue), held["usable"], marks)
    quiet = Quiet(*held["quiet"]) if "quiet" in held else None
    law = _law(str(card["method"]), held, target)
    return CalibratedMethod(law, reference, float(held["relative_error"]), quiet, card)


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _law(name: str, held: Mapping[str, npt.NDArray[Any]], path: Path) -> ColourLaw:
    if name == Polynomial.name:
        return Polynomial(held["law_coefficients"], float(held["law_steepest"]))
    if name == Lookup.name:
        return Lookup(held["law_table"].astype(np.float32), held["law_lowest"], held["law_highest"])
    raise InputError("no photometric method of that name", where=path, value=name)


def _card(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise InputError(f"the method's card cannot be read: {fault}", where=path) from fault
    if not isinstance(content, dict):
        raise InputError("the method's card is not a table", where=path)
    return content
