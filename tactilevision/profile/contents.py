"""The names of the files in a profile, its format, and its hash. Said here and nowhere else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

SUFFIX = ".tvs"
FORMAT = 1  # version of a profile; newer ones are refused
ABOUT = "profile.json"
METHOD, CARD, NETWORK = "method.npz", "method.json", "method.onnx"
MAPS = "rectification.npz"
UNTOUCHED = "untouched.png"
CALIBRATION = "calibration.json"
FACE_LAW = "face_law.json"
LAMPS = "lamps.json"
UNDONE_FACE_LAW = "face_law_undone.json"
COMPLIANCE = "compliance.npz"
NEEDED = (ABOUT, METHOD, CARD, UNTOUCHED)
HASH = "sha256"  # key of profile.json: of all its other keys


def hash_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of profile.json without its own hash, whatever the order and the spaces."""
    rest = {key: value for key, value in content.items() if key != HASH}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def hash_of_bytes(content: bytes) -> str:
    """SHA-256 of a file in the profile."""
    return hashlib.sha256(content).hexdigest()
