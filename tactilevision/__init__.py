"""Mechanics you can trust from vision-based tactile sensors.

The public names, gathered. Nothing heavy is loaded before it is used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactilevision.renamed import PublicPackage, install

if TYPE_CHECKING:
    from tactilevision.batch.folder import reconstruct_folder
    from tactilevision.certificate.certify import certify
    from tactilevision.contact.region import find_contact
    from tactilevision.errors import (
        ConvergenceError,
        InputError,
        NothingCertified,
        OutputError,
        RecordingError,
        TactilevisionError,
    )
    from tactilevision.exports.tiff import read_tiff, write_tiff
    from tactilevision.force.calibrated import read_material
    from tactilevision.force.field import ForceField
    from tactilevision.live import Stream
    from tactilevision.mechanics.export import write_material
    from tactilevision.mechanics.flat_contact import FlatContact
    from tactilevision.mechanics.kappa import kappa
    from tactilevision.mechanics.punch_curve import punch_curve
    from tactilevision.profile.seen import Seen, SeenBatch
    from tactilevision.profile.sensor import CalibratedSensor, load_sensor
    from tactilevision.reconstruct import Reconstructor, build_reconstructor
    from tactilevision.recording import BadFrame, Recording, iter_frames, read_folder, read_frame, read_recording
    from tactilevision.records import (
        CertifiedPoint,
        Curve,
        Estimate,
        Floats,
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
        Wrench,
    )
    from tactilevision.sensors import (
        find_grid,
        get_sensor,
        rectify,
        save_rectification,
        sensor_from_corners,
        sensor_from_grid,
    )
    from tactilevision.shear.measure import read_untouched
    from tactilevision.synthetic import simulate

_PLACES = {
    "batch.folder": ("reconstruct_folder",),
    "certificate.certify": ("certify",),
    "contact.region": ("find_contact",),
    "errors": (
        "ConvergenceError",
        "InputError",
        "NothingCertified",
        "OutputError",
        "RecordingError",
        "TactilevisionError",
    ),
    "exports.tiff": (
        "read_tiff",
        "write_tiff",
    ),
    "force.calibrated": ("read_material",),
    "force.field": ("ForceField",),
    "live": ("Stream",),
    "mechanics.export": ("write_material",),
    "mechanics.flat_contact": ("FlatContact",),
    "mechanics.kappa": ("kappa",),
    "mechanics.punch_curve": ("punch_curve",),
    "profile.seen": ("Seen", "SeenBatch"),
    "profile.sensor": ("CalibratedSensor", "load_sensor"),
    "reconstruct": (
        "Reconstructor",
        "build_reconstructor",
    ),
    "recording": (
        "BadFrame",
        "Recording",
        "iter_frames",
        "read_folder",
        "read_frame",
        "read_recording",
    ),
    "records": (
        "CertifiedPoint",
        "Curve",
        "Estimate",
        "Floats",
        "Footprint",
        "ForceSeries",
        "Frame",
        "Gel",
        "HeightMap",
        "Indenter",
        "Material",
        "Press",
        "Sensor",
        "SlopeMap",
        "TractionMap",
        "Wrench",
    ),
    "sensors": (
        "find_grid",
        "get_sensor",
        "rectify",
        "save_rectification",
        "sensor_from_corners",
        "sensor_from_grid",
    ),
    "shear.measure": ("read_untouched",),
    "synthetic": ("simulate",),
}
_HOME = {name: place for place, names in _PLACES.items() for name in names}

__all__ = [
    "BadFrame",
    "CalibratedSensor",
    "CertifiedPoint",
    "ConvergenceError",
    "Curve",
    "Estimate",
    "FlatContact",
    "Floats",
    "Footprint",
    "ForceField",
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
    "Seen",
    "SeenBatch",
    "Sensor",
    "SlopeMap",
    "Stream",
    "TactilevisionError",
    "TractionMap",
    "Wrench",
    "build_reconstructor",
    "certify",
    "find_contact",
    "find_grid",
    "get_sensor",
    "iter_frames",
    "kappa",
    "load_sensor",
    "punch_curve",
    "read_folder",
    "read_frame",
    "read_material",
    "read_recording",
    "read_tiff",
    "read_untouched",
    "reconstruct_folder",
    "rectify",
    "save_rectification",
    "sensor_from_corners",
    "sensor_from_grid",
    "simulate",
    "write_material",
    "write_tiff",
]


install()  # old names, for one version
sys.modules[__name__].__class__ = PublicPackage


def __getattr__(name: str) -> Any:
    """Load a public name's room when the name is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'tactilevision' has no attribute {name!r}")
    found = getattr(import_module(f"tactilevision.{_HOME[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
