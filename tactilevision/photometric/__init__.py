"""Frames to slopes.

PHOTOMETRIC lists the methods that come along; any `method.PhotometricMethod` works as well.
"""

from __future__ import annotations

from tactilevision.photometric.ball.cross_validation import Fitter
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.found_balls import BallPicture
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.inverse_shading import AutoMethod
from tactilevision.photometric.methods.lookup import fit_lookup
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.reference import Reference, make_reference
from tactilevision.photometric.storage import load_method, load_network, save_method
from tactilevision.photometric.training.network_training import NetworkFitter


class Methods(dict[str, Fitter]):
    """Methods by name; "either", the older name of "auto", is still found but no longer listed."""

    def __missing__(self, name: str) -> Fitter:
        if name == "either":
            return self["auto"]
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return name == "either" or super().__contains__(name)


PHOTOMETRIC = Methods(
    polynomial=fit_polynomial,
    auto=AutoMethod(),
    lookup=fit_lookup,
    network=NetworkFitter(),
)

__all__ = [
    "PHOTOMETRIC",
    "BallPicture",
    "CalibratedMethod",
    "Calibration",
    "PhotometricMethod",
    "Reference",
    "calibrate_from_balls",
    "load_method",
    "load_network",
    "make_reference",
    "save_method",
]
