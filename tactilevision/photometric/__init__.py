"""Frames to slopes.

PHOTOMETRIC lists the methods that come along; any `method.PhotometricMethod` works as well.
"""

from __future__ import annotations

from tactilevision.photometric.ball.cross_validation import Fitter
from tactilevision.photometric.calibrate import BallPicture, Calibration, calibrate_from_balls
from tactilevision.photometric.method import CalibratedMethod, PhotometricMethod
from tactilevision.photometric.methods.inverse_shading import AutoMethod
from tactilevision.photometric.methods.lookup import fit_lookup
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.reference import Reference, make_reference
from tactilevision.photometric.storage import load_method, load_network, save_method
from tactilevision.photometric.training.network_training import NetworkFitter

PHOTOMETRIC: dict[str, Fitter] = {
    "polynomial": fit_polynomial,
    "either": AutoMethod(),
    "lookup": fit_lookup,
    "network": NetworkFitter(),
}

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
