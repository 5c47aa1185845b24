"""Photometric methods by name, as for `--method` and `build_reconstructor(recording, method)`."""

from __future__ import annotations

from tactilevision.photometric.cross_validation import Fitter
from tactilevision.photometric.methods.lookup import fit_lookup
from tactilevision.photometric.methods.polynomial import AutoMethod, fit_polynomial
from tactilevision.photometric.network_training import NetworkFitter

PHOTOMETRIC: dict[str, Fitter] = {
    "polynomial": fit_polynomial,
    "auto": AutoMethod(),
    "lookup": fit_lookup,
    "network": NetworkFitter(),
}
