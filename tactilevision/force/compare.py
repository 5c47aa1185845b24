"""Resultants beside the force/torque sensor's: what is left, and against what it stands out.

    residual = force from the picture - reading;   pull = residual / standard deviation of both

Frames in which nothing touches are left out: they compare nothing with nothing. Where the deviations are right,
95 % of the pulls lie within 1.96. A ratio that changes with depth points to the height map or to the gel's law,
one that changes with the place to the gel's sides or the light, one with the press to the F/T sensor's zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.force.frame import FrameForce, nothing_touches
from tactilevision.records import Floats

AXES = ("x", "y", "z")
MIN_N = 0.05  # a ratio of smaller forces says nothing
NO_READING = "the force sensor has no reading at their time"
AT_ITS_END = "the force sensor stood at the end of its range in their press"


@dataclass(frozen=True, slots=True)
class Residuals:
    """Frames with both forces: `row` (N,) in the recording; `force_N`, `measured_N` and `std_N` of their
    difference (N, 3), NaN: unknown; `depth_mm`, `time_s`, `press` (N,), `place_mm` (N, 2); `usable` (N,): nothing
    is known against them. `left_out`: how many of the `touched` frames are not compared, by why."""

    row: npt.NDArray[np.intp]
    force_N: Floats
    std_N: Floats
    measured_N: Floats
    depth_mm: Floats
    place_mm: Floats
    time_s: Floats
    press: npt.NDArray[np.str_]
    usable: npt.NDArray[np.bool_]
    touched: int
    left_out: Mapping[str, int]

    @property
    def residual_N(self) -> Floats:
        """(N, 3)."""
        return self.force_N - self.measured_N

    @property
    def ratio(self) -> Floats:
        """Force from the picture over the reading along z (N,); NaN where the reading is small."""
        read = self.measured_N[:, 2]
        found = np.divide(self.force_N[:, 2], read, out=np.full(len(read), np.nan), where=read > MIN_N)
        return np.asarray(found)

    @property
    def direction_deg(self) -> Floats:
        """Of the reading along the gel (N,), clockwise from x as the camera sees it; NaN where it is small."""
        x, y = self.measured_N[:, 0], self.measured_N[:, 1]
        return np.where(np.hypot(x, y) > MIN_N, np.degrees(np.arctan2(y, x)), np.nan)


def residuals(
    rows: Sequence[FrameForce], *, flagged: Sequence[str] = (), reading_std_N: Sequence[float] | None = None
) -> Residuals | None:
    """What can be compared; None where nothing can. `flagged`: words that make a frame unusable;
    `reading_std_N` (3,) of one reading, None where it is not known.
    """
    touched = [(number, row, _why_not(row, flagged)) for number, row in enumerate(rows) if touches(row)]
    kept = [(number, row) for number, row, why in touched if why != NO_READING]
    if not kept:
        return None
    why_not = [why for *_, why in touched]
    taken = [row for _, row in kept]
    return Residuals(
        row=np.array([number for number, _ in kept]),
        force_N=np.array([row.resultant_N for row in taken]),
        std_N=np.hypot([row.resultant_std_N for row in taken], reading_std_N or 0.0),
        measured_N=np.array([row.measured_N for row in taken]),
        depth_mm=np.array([row.depth_mm for row in taken]),
        place_mm=np.array([row.place_mm for row in taken]),
        time_s=np.array([row.time_s for row in taken]),
        press=np.array([row.press for row in taken]),
        usable=np.array([not why for why in why_not if why != NO_READING]),
        touched=len(touched),
        left_out=Counter(why for why in why_not if why),
    )


def touches(row: FrameForce) -> bool:
    """Whether the frame was read, and something touches in it."""
    return row.read and not nothing_touches(row) and bool(np.isfinite(row.resultant_N[2]))


def _why_not(row: FrameForce, flagged: Sequence[str]) -> str:
    """Why a frame that touches is not compared; empty where it is."""
    if not np.isfinite(row.measured_N[2]):
        return NO_READING
    return AT_ITS_END if row.reading_clipped else next((word for word in flagged if word in row.flags), "")


def summary(found: Residuals) -> dict[str, dict[str, float | int | None]]:
    """By axis: frames, rms and median residual in N, and the share of readings inside the 95 % interval; along z
    the ratio over all and over the deepest third."""
    said: dict[str, dict[str, float | int | None]] = {}
    for k, name in enumerate(AXES):
        left, std = found.residual_N[found.usable, k], found.std_N[found.usable, k]
        known = np.isfinite(left)
        if not known.any():
            said[name] = {"frames": 0, "rms_N": None, "median_N": None, "inside_interval95": None}
            continue
        said[name] = {
            "frames": int(known.sum()),
            "rms_N": float(np.sqrt(np.mean(left[known] ** 2))),
            "median_N": float(np.median(left[known])),
            "inside_interval95": float(np.mean(np.abs(left[known]) < 1.96 * std[known])),
        }
    ratio, deep = found.ratio, found.depth_mm >= np.quantile(found.depth_mm, 2 / 3)
    said["z"] |= {
        "ratio": _median(ratio[found.usable]),
        "ratio_deepest_third": _median(ratio[deep & found.usable]),
    }
    return said


def _median(values: Floats) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None
