"""The certified point of a press, and the wall law fitted to certified faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactilevision.records.measured import Pair
from tactilevision.records.ranges import Ranged

# The certified point of a press: depth and force at the contact event, and how they were certified.

REASONS = (
    "tangential",
    "tilt",
    "footprint",
    "bevel_not_touched",
    "dropped_frames",
    "saturated",
    "short_rest",
    "border",
)


@dataclass(frozen=True, slots=True)
class EdgeDrop(Ranged):
    """Drop of the gel's surface between two distances from the face's edge, as the picture reads it.

    `azimuth_deg` is the middle of a quarter (0 right, 90 down); `from_mm` and `to_mm` lie beyond the edge, to
    0.01 mm; `drop_mm` is the depth at the first less that at the second.
    """

    azimuth_deg: float
    from_mm: float
    to_mm: float
    drop_mm: float


@dataclass(frozen=True, slots=True)
class EdgeProfile(Ranged):
    """The gel's surface beside the face of one press, as drops by place.

    `slope_gain_std` is the relative std of the slopes of a quarter; `ball_slope` the steepest slope (mm/mm) that
    the light was calibrated with.
    """

    drops: tuple[EdgeDrop, ...]
    slope_gain_std: float = float("nan")
    ball_slope: float = float("nan")


@dataclass(frozen=True, slots=True)
class CertificationDetails(Ranged):
    """How the depth and the force of one press were certified; NaN, None or "" where it is not known.

    `pile_up_ratio` is the gel's rise at the bevel over the depth; `tilt_std_mm` what faces that tilt from press to
    press move the contact by. The contact event: `contact_std_s` of its time, `contact_shared_std_mm` what all
    events may be off by together, `contact_channel` that showed it, `contact_sigmas` above the noise;
    `force_readings` behind the force, `force_dwell` whether the rig stood still. `reconstructed_depth_mm` is the
    depth that the picture shows then, with its std. On a travel scale `travel_scale_std` is the scale's relative
    std, `contact_delay_mm` how far behind it the events were seen. Centre and radius (mm) and tilt (rad) are the
    face's; `findings` all that speaks against the press.
    """

    pile_up_ratio: float = float("nan")
    pile_up_ratio_std: float = float("nan")
    tilt_std_mm: float = float("nan")
    contact_std_s: float = float("nan")
    contact_shared_std_mm: float = float("nan")
    contact_channel: str = ""
    contact_sigmas: float = float("nan")
    force_readings: int | None = None
    force_dwell: bool | None = None
    reconstructed_depth_mm: float = float("nan")
    reconstructed_std_mm: float = float("nan")
    travel_scale_std: float = float("nan")
    contact_delay_mm: float = float("nan")
    contact_delay_std_mm: float = float("nan")
    centre_x_mm: float = float("nan")
    centre_y_mm: float = float("nan")
    face_radius_mm: float = float("nan")
    tilt_x: float = float("nan")
    tilt_y: float = float("nan")
    findings: str = ""


@dataclass(frozen=True, slots=True)
class CertifiedPoint(Ranged):
    """Certified depth of one press, and the force at that depth.

    `accepted` is False with a `reason` (one of REASONS) where the press cannot be trusted; its numbers, as
    far as they exist, are kept. `depth_uncorrected_mm` is the machined height;
    `depth_mm` is corrected for the gel's rise at the bevel. `lubricated` is 0, 1 or NaN (not known).
    `details` say how the point was certified, `edge_profile` what the picture shows beside the face (None:
    nothing); `extra` keeps the columns of points.csv that have no field here.
    """

    press: str
    indenter: str
    depth_mm: float
    fz_N: float
    depth_std_mm: float = float("nan")
    fz_std_N: float = float("nan")
    fx_N: float = float("nan")
    fy_N: float = float("nan")
    time_s: float = float("nan")
    depth_uncorrected_mm: float = float("nan")
    rest_s: float = float("nan")
    speed_mm_s: float = float("nan")
    x_mm: float = float("nan")
    y_mm: float = float("nan")
    accepted: bool = True
    reason: str = ""
    temperature_C: float = float("nan")
    lubricated: float = float("nan")
    hold_s: float = float("nan")
    details: CertificationDetails = field(default_factory=CertificationDetails)
    edge_profile: EdgeProfile | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


# What certified faces taught of walls: how much of a face's depth they hide, beside what their law finds.
#
#     change = hidden (share + growth (w/w0 - 1))     w0 = USUAL_MM
#
# hidden: what the law of steep walls finds missing in the slopes as read; w: depth of the face. Zero without a
# wall. The depth is held within that of the faces that taught.

USUAL_MM = 0.45  # mm: depth of a face at which `share` holds; benchmarks.rendered


@dataclass(frozen=True, slots=True)
class TaughtWalls:
    """`share` and `growth` without unit, their covariance (two variances, then the covariance), the depths taught.

    `scatter` is what faces elsewhere of the same sensor differ by, a part of their depth.
    """

    share: float
    growth: float
    covariance: tuple[float, float, float]
    limits_mm: Pair
    scatter: float

    def change_mm(self, hidden_mm: float, depth_mm: float) -> Pair:
        """What a wall hides beyond `hidden_mm` round a face of `depth_mm`, and the deviation of its step; mm.

        No wall hides less than nothing.
        """
        excess = self.excess(depth_mm)
        of_share, of_growth, between = self.covariance
        variance = of_share + 2.0 * excess * between + excess * excess * of_growth
        change = hidden_mm * max(self.share + self.growth * excess, -1.0)
        return change, float(np.hypot(hidden_mm * np.sqrt(max(variance, 0.0)), self.scatter * depth_mm))

    def excess(self, depth_mm: float) -> float:
        """The face's depth over the usual, less 1, held within the depths that taught."""
        return float(np.clip(depth_mm, *self.limits_mm)) / USUAL_MM - 1.0
