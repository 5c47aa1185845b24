"""Mechanics you can trust from vision-based tactile sensors.

The public names, gathered. Nothing heavy is loaded before it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactilevision.batch.folder import reconstruct_folder
    from tactilevision.certificate.certify import certify
    from tactilevision.errors import (
        ConvergenceError,
        InputError,
        NothingCertified,
        OutputError,
        RecordingError,
        TactilevisionError,
    )
    from tactilevision.exports.tiff import read_tiff, write_tiff
    from tactilevision.reconstruct import Reconstructor, build_reconstructor
    from tactilevision.recording import Recording, iter_frames, read_folder, read_frame, read_recording
    from tactilevision.records import (
        CertifiedPoint,
        Curve,
        Estimate,
        Footprint,
        ForceSeries,
        Frame,
        Gel,
        HeightMap,
        Indenter,
        Material,
        Press,
        Sensor,
        SlopeMap,
        TractionMap,
    )
    from tactilevision.sensors import get_sensor
    from tactilevision.synthetic import simulate

_PLACES = {
    "errors": ("ConvergenceError", "InputError", "NothingCertified", "OutputError", "RecordingError",
               "TactilevisionError"),
    "batch.folder": ("reconstruct_folder",),
    "exports.tiff": ("read_tiff", "write_tiff"),
    "certificate.certify": ("certify",),
    "reconstruct": ("Reconstructor", "build_reconstructor"),
    "recording": ("Recording", "iter_frames", "read_folder", "read_frame", "read_recording"),
    "records": ("CertifiedPoint", "Curve", "Estimate", "Footprint", "ForceSeries", "Frame", "Gel", "HeightMap",
                "Indenter", "Material", "Press", "Sensor", "SlopeMap", "TractionMap"),
    "sensors": ("get_sensor",),
    "synthetic": ("simulate",),
}  # fmt: skip
_HOME = {name: place for place, names in _PLACES.items() for name in names}

__all__ = [
    "CertifiedPoint",
    "ConvergenceError",
    "Curve",
    "Estimate",
    "Footprint",
    "ForceSeries",
    "Frame",
    "Gel",
    "HeightMap",
    "Indenter",
    "InputError",
    "Material",
    "NothingCertified",
    "OutputError",
    "Press",
    "Reconstructor",
    "Recording",
    "RecordingError",
    "Sensor",
    "SlopeMap",
    "TactilevisionError",
    "TractionMap",
    "build_reconstructor",
    "certify",
    "get_sensor",
    "iter_frames",
    "read_folder",
    "read_frame",
    "read_recording",
    "read_tiff",
    "reconstruct_folder",
    "simulate",
    "write_tiff",
]


def __getattr__(name: str) -> Any:
    """Load a public name's room when the name is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'tactilevision' has no attribute {name!r}")
    found = getattr(import_module(f"tactilevision.{_HOME[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
