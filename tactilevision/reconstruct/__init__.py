"""Sensor in, frame in, height map out: the reconstructor, and the ways to build one."""

from __future__ import annotations

from tactilevision.reconstruct.build import build_reconstructor, tuned, untouched_rms_mm, with_flats
from tactilevision.reconstruct.reconstructor import Reconstructor

__all__ = ["Reconstructor", "build_reconstructor", "tuned", "untouched_rms_mm", "with_flats"]
