"""The picture's depth against the force sensor's reading, as a recording of curves for `tactilevision diagnose`.

Each press becomes a curve of the contact's depth, as the height map has it, against the sensor's force, with the
place of the pressure for the press's own where the protocol states none. So whatever separates the two, by depth,
place, direction, time or press, meets the same residual panels and the same effects as a calibration does.
`picture_fz_N` and its deviation are columns of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.force.compare import MIN_N
from tactilevision.force.field import CUT
from tactilevision.force.frame import FrameForce, nothing_touches
from tactilevision.recording import Recording, write_recording
from tactilevision.records import Curve, Press

MIN_COUNT = 4  # frames of a press that make a curve


def write_comparison(recording: Recording, rows: Sequence[FrameForce], *, folder: Path) -> Path | None:
    """Write the recording of curves into `folder`; None where no press has enough frames with both."""
    presses, curves = [], []
    for press in recording.presses:
        seen = [row for row in rows if row.press == press.press and _whole(row)]
        if len(seen) >= MIN_COUNT:
            curves.append(_curve(press.press, seen))
            presses.append(_placed(press, seen))
    if not curves:
        return None
    write_recording(
        replace(recording, path=folder, name=f"{recording.name}, picture beside sensor", presses=tuple(presses),
                curves=tuple(curves), points=(), forces=None, stage=None, frames_path=None, frame_names=(),
                frame_times_s=np.zeros(0), flats=(), balls=(), extra={}, depth_source="vision", depth_std_mm=None)
    )  # fmt: skip
    return folder


def _whole(row: FrameForce) -> bool:
    """Both forces are there, and neither a cut contact nor a slip of the map on a free gel."""
    touches = row.read and not nothing_touches(row) and CUT not in row.flags
    return touches and bool(np.isfinite([row.depth_mm, *row.measured_N]).all()) and row.measured_N[2] > MIN_N


def _curve(press: str, seen: Sequence[FrameForce]) -> Curve:
    return Curve(
        press=press,
        time_s=np.array([row.time_s for row in seen]),
        depth_mm=np.array([row.depth_mm for row in seen]),
        force_N=np.array([row.measured_N for row in seen]),
        phase=np.full(len(seen), "", dtype=np.str_),
        extra={
            "picture_fz_N": np.array([row.resultant_N[2] for row in seen]),
            "picture_fz_std_N": np.array([row.resultant_std_N[2] for row in seen]),
        },
    )


def _placed(press: Press, seen: Sequence[FrameForce]) -> Press:
    if np.isfinite([press.x_mm, press.y_mm]).all():
        return press
    x, y = np.median([row.place_mm for row in seen], axis=0)
    return replace(press, x_mm=float(x), y_mm=float(y))
