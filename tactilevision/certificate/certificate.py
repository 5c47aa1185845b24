"""What certifying a recording yields: points, curves, the clocks, and the evidence for each press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tactilevision.certificate.depth.depth_scale import DepthScale
from tactilevision.certificate.depth.pile_up import PileUp
from tactilevision.certificate.rejection import Finding
from tactilevision.certificate.touch.contact_event import ContactEvent
from tactilevision.records import CertifiedPoint, Curve, Estimate, Floats, Footprint, HeightMap, Pair


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What the report draws of one press.

    `frame_index` (into the recording's frames) and `frame_name` are of the frame nearest to the event (the deepest
    where the force does not tell when it was), `height_map` its reconstruction; `touch` is None where none is
    sure; `bevel_window_mm` is ((x0, y0), (x1, y1)) on the pad; `signal_mm` (N,) is the height map's bevel signal
    against `depth_mm` (N,), both as the camera read them, at `time_s` (N,) of the camera's clock; `force_time_s`
    (T,) is on the same clock, `force_N` (T, 3) tared.
    """

    press: str
    frame_index: int | None
    frame_name: str
    footprint: Footprint | None
    height_map: HeightMap | None
    bevel_window_mm: tuple[Pair, Pair] | None
    time_s: Floats
    depth_mm: Floats
    signal_mm: Floats | None
    touch: ContactEvent | None
    event_s: float
    force_time_s: Floats
    force_N: Floats
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Depth and force of every press of a recording, and what they rest on.

    `points` holds every press, in the recording's order, accepted or with its reason; `curves` the presses that
    could be followed; `clock_offset` is F/T minus camera; `pile_ups` the gel's rise at the bevel, by press;
    `bevel_distance_mm` where that is (given or found, None: neither).
    """

    points: tuple[CertifiedPoint, ...]
    curves: tuple[Curve, ...]
    clock_offset: Estimate
    evidence: Mapping[str, Evidence]
    pile_ups: Mapping[str, PileUp] = field(default_factory=dict)
    bevel_distance_mm: float | None = None
    depth_scale: DepthScale | None = None
    warnings: tuple[str, ...] = field(default=())
    flags: tuple[str, ...] = ()
