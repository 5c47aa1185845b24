"""Whole presses as curves: the camera's depth and the force on the camera's clock, anchored at the certificate.

The camera reads the depth of a steep-walled face in a scale of its own, which depends on the depth. All
certified presses together give that scale (true over seen depth as a function of the seen one); each press is
then scaled so that its own event reads what certifies it.
"""

from __future__ import annotations

import numpy as np

from tactilevision.certificate.depth.depth_scale import DepthScale
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.records import CertifiedPoint, Curve

_SMOOTH = 5  # readings of the running mean


def press_curve(
    track: PressTrack,
    window: ForceWindow | None,
    *,
    point: CertifiedPoint,
    touch: ContactEvent | None,
    offset_s: float,
    depth_scale: DepthScale | None,
) -> Curve | None:
    """Curve of one press, rows are its frames; None without a force. `offset_s`: F/T clock minus camera clock."""
    if window is None:
        return None
    time = track.time_s + offset_s
    covered = (time >= window.time_s[0]) & (time <= window.time_s[-1])
    if covered.sum() < 2:
        return None
    depth = track.depth_mm * (depth_scale.scale(track.depth_mm) if depth_scale is not None else 1.0)
    if touch is not None and point.accepted and touch.depth_seen_mm > 0:
        seen = touch.depth_seen_mm
        read = seen * (float(depth_scale.scale(seen)) if depth_scale is not None else 1.0)
        depth = depth * (point.depth_mm / read)
    kernel = np.full(_SMOOTH, 1 / _SMOOTH)
    smooth = [
        np.convolve(np.pad(axis, _SMOOTH // 2, mode="edge"), kernel, mode="valid") for axis in window.force_N.T
    ]
    force = np.stack([np.interp(time[covered], window.time_s, axis) for axis in smooth], axis=1)
    phase = np.full(int(covered.sum()), "", dtype="<U6")
    if window.phases is not None:
        names = window.phases.names(window.time_s.size)
        phase = names[np.clip(np.searchsorted(window.time_s, time[covered]), 0, names.size - 1)]
    return Curve(point.press, track.time_s[covered], depth[covered], force, phase)
