"""Height maps and forces of a recording, as `depth` and `force` wrote them, into a log of ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactilevision.door.names import inside
from tactilevision.errors import InputError
from tactilevision.exports.tiff import read_tiff
from tactilevision.logs.write import depth_message, open_writer, wrench_message
from tactilevision.recording import Recording
from tactilevision.recording.layout import Columns
from tactilevision.recording.tables import read_table
from tactilevision.records import Floats

DEPTH_TOPIC, WRENCH_TOPIC = "/tactile/depth", "/tactile/wrench"
PAD = "gel_pad"  # frame of reference: x right, y down, z into the gel, from the pad's centre
_COMPONENTS = ("fx_N", "fy_N", "fz_N", "mx_Nmm", "my_Nmm", "mz_Nmm")
_RESULTANTS = Columns(words=("frame",), maybe_numbers=_COMPONENTS)


@dataclass(frozen=True, slots=True)
class Exported:
    """How many messages of each kind were written, and how many frames had no map."""

    depths: int
    wrenches: int
    without: int


def export_log(
    recording: Recording, out: Path, *, depth: Path | None = None, force: Path | None = None, frame_id: str = PAD
) -> Exported:
    """Write `out` from the folders that `depth` and `force` wrote for this recording; whole or not at all.

    Times are the recording's, after the start that its [log] states. Raises InputError where neither folder
    holds anything of its frames, or frames have no time.
    """
    times = recording.frame_times_s
    if not len(times) or np.isnan(times).any():
        raise InputError(
            "frames have no time, which messages need", where=recording.path, remedy="Add frames.csv."
        )
    wrenches = {} if force is None else _wrenches(force / "resultants.csv")
    counts = {"depth": 0, "wrench": 0}
    with open_writer(out) as (put, encoding):
        for name, time_ns in zip(recording.frame_names, _times_ns(recording), strict=True):
            path = None if depth is None else _map(depth, name)
            if path is not None:
                message = depth_message(read_tiff(path), time_ns=time_ns, frame_id=frame_id, encoding=encoding)
                put(DEPTH_TOPIC, message, time_ns)
                counts["depth"] += 1
            if name in wrenches:
                whole = wrenches[name]
                wrench = wrench_message(
                    whole[:3], whole[3:], time_ns=time_ns, frame_id=frame_id, encoding=encoding
                )
                put(WRENCH_TOPIC, wrench, time_ns)
                counts["wrench"] += 1
        if not any(counts.values()):
            raise InputError(
                "there is neither depth nor force of the recording's frames",
                where=depth or force or recording.path,
                remedy="Give --depth the folder that `tactilevision depth` wrote (TIFF), --force that of `force`.",
            )
    without = 0 if depth is None else len(times) - counts["depth"]
    return Exported(counts["depth"], counts["wrench"], without)


def _map(folder: Path, name: str) -> Path | None:
    """The map of a frame: under its stem, or its whole name where stems are not enough."""
    for stem in (Path(name).stem, name):
        path = inside(folder / "depth", f"{stem}.tiff", where=folder)
        if path.is_file():
            return path
    return None


def _wrenches(path: Path) -> Mapping[str, Floats]:
    """Force and moment (6,), N and N mm, of each frame with a normal force; NaN what was not measured."""
    table = read_table(path, _RESULTANTS)
    missing = [name for name in _COMPONENTS if name not in table.numbers]
    if missing:
        raise InputError("a column is missing", where=path, value=missing[0])
    numbers = np.column_stack([table.numbers[name] for name in _COMPONENTS])
    pairs = zip(table.words["frame"], numbers, strict=True)
    return {name: row for name, row in pairs if np.isfinite(row[2])}


def _times_ns(recording: Recording) -> list[int]:
    origin_ns = int(recording.settings.get("log", {}).get("origin_ns", 0))
    return [origin_ns + round(float(one) * 1e9) for one in recording.frame_times_s]
