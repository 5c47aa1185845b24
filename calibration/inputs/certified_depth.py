"""What a certified depth's deviation is made of: its own part, and what all presses share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from calibration.inputs.observations import DepthSource, Measured, RecordingLike, Shared
from tactilevision.records import CertifiedPoint, Indenter

NAN = float("nan")


def own_depth_std(point: CertifiedPoint, indenter: Indenter, *, recording: RecordingLike) -> float:
    """The part of the depth's std that no other press shares: without the machined height's and the rise's."""
    whole = point.depth_std_mm
    if not np.isfinite(whole):
        return finite_or(recording.depth_std_mm, NAN)
    height = (
        0.0 if on_travel_scale(point) else indenter.height_std_mm / (1 + finite_or(point.details.pile_up_ratio))
    )
    shared = math.hypot(height, relative_shared_std(point) * point.depth_mm)
    if is_certified(point):  # made up of just these parts
        return math.sqrt(max(whole**2 - shared**2, 0.0))
    return math.sqrt(whole**2 - shared**2) if whole > shared > 0 else whole


def on_travel_scale(point: CertifiedPoint) -> bool:
    """Whether the recording's travel scale placed its contact event."""
    return bool(np.isfinite(point.details.travel_scale_std))


def relative_shared_std(point: CertifiedPoint) -> float:
    """Relative std of the depth that the gel's rise at the bevel, and the ruler, bring to all presses alike."""
    rise = finite_or(point.details.pile_up_ratio_std) / (1 + finite_or(point.details.pile_up_ratio))
    return math.hypot(rise, finite_or(point.details.travel_scale_std))


def shared_errors(sets: Sequence[Measured]) -> Shared:
    """What certified depths share by the way in which they were certified."""
    points = [p for m in sets for p in m.points if p.accepted]
    touch = [finite_or(p.details.contact_shared_std_mm) for p in points]
    rise = [relative_shared_std(p) for p in points]
    if not points:
        return Shared()
    return Shared(
        float(np.median(touch)), float(np.median(rise)), heights=not all(on_travel_scale(p) for p in points)
    )


def depth_source(sets: Sequence[Measured]) -> DepthSource:
    """Where the depths come from: what a certificate of our own says is a gauge's, whatever the curves are."""
    certified = [is_certified(p) for m in sets for p in m.points if p.accepted]
    if certified and all(certified) and not any(m.curves for m in sets):
        return "gauge"
    return cast(DepthSource, sets[0].recording.depth_source or "vision")


def is_certified(point: CertifiedPoint) -> bool:
    """Whether it comes from a certificate of our own, which took the gel's rise off and says how well."""
    return bool(np.isfinite(point.details.pile_up_ratio_std))


def finite_or(value: float | None, instead: float = 0.0) -> float:
    """The value; `instead` where it is not stated or not finite."""
    return float(value) if value is not None and np.isfinite(value) else instead
