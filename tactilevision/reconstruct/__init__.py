"""Sensor in, frame in, height map out: the reconstructor, and the ways to build one."""

from __future__ import annotations

from tactilevision.reconstruct.build import build_reconstructor, calibrate_light, with_flats
from tactilevision.reconstruct.reconstructor import Reconstructor
from tactilevision.reconstruct.tuned import tuned, untouched_rms_mm

__all__ = ["Reconstructor", "build_reconstructor", "calibrate_light", "tuned", "untouched_rms_mm", "with_flats"]
