"""Is the indenter tilted in its mount? All faces then stand askew by as much, however deep they are.

    tilt = t0 + k w      t0 (2,) rad: the mount; k: a map that misreads walls tilts a face by what the depth is

A tilted indenter tips its bevel as well, so that certified depths are off, by about as much in each press: it
looks like another depth zero. No press stands out of the others, so that none is rejected.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactilevision.certificate.rejection import TILT_READ, PressEvidence
from tactilevision.certificate.touch.press_track import face_tilt
from tactilevision.records import Floats

MIN_SPREAD = 1.5  # deepest press over the shallowest: fewer tell no mount from a map
SIGMA = 5.0  # how far beyond its own std the tilt has to stand


def mount_tilt(tilts: Floats, depth_mm: Floats) -> Floats | None:
    """t0 (2,) in rad of tilts (n, 2) in rad of faces at these depths (n,) in mm; None where none is to be told.

    Range: any n; fewer than four presses, or depths of less than 1.5 to 1, tell nothing.
    """
    known = np.isfinite(tilts).all(axis=1) & np.isfinite(depth_mm) & (depth_mm > 0)
    tilts, depth_mm = tilts[known], depth_mm[known]
    if depth_mm.size < 4 or depth_mm.max() < MIN_SPREAD * depth_mm.min():
        return None
    line = np.column_stack([np.ones_like(depth_mm), depth_mm])
    found, *_ = np.linalg.lstsq(line, tilts, rcond=None)
    left = np.sum((tilts - line @ found) ** 2) / (2 * (depth_mm.size - 2))
    std = float(np.sqrt(left * np.linalg.inv(line.T @ line)[0, 0]))
    size = float(np.hypot(*found[0]))
    return found[0] if size > max(TILT_READ, SIGMA * std) else None


def tilt_warning(presses: Sequence[PressEvidence]) -> str:
    """That the indenter is tilted in its mount, in a sentence; empty where it does not show."""
    seen = [one for one in presses if one.track.footprint is not None]
    tilts = np.array([face_tilt(one.track) for one in seen]).reshape(-1, 2)
    tilt = mount_tilt(tilts, np.array([one.depth_mm for one in seen]))
    if tilt is None:
        return ""
    right, down = tilt
    deeper = ("right" if right > 0 else "left") if abs(right) > abs(down) else "bottom" if down > 0 else "top"
    size, lever = float(np.hypot(right, down)), float(np.nanmedian([_lever_mm(one) for one in seen]))
    return (
        f"All faces stand askew by {np.degrees(size):.2f} degrees, deeper at the {deeper}, whatever their depth: "
        f"the indenter is tilted in its mount. Its bevel then tips by up to {1e3 * size * lever:.0f} µm, by which "
        "depths may be off beyond their intervals, and c and beta with them. Level the indenter."
    )


def _lever_mm(one: PressEvidence) -> float:
    """From the axis to the bevel, or to about where it usually is."""
    if one.distance_mm:
        return one.distance_mm
    return float("nan") if one.track.footprint is None else 2 * one.track.footprint.radius_mm
