"""Force from whole frames: every frame of a recording beside its own F/T sensor, by band of depth.

The recording's calibration is made first, as a user would. Presses that `calibrate` rejects are left out, and of
the others the frames in which a contact is cut by the border.

python -m benchmarks.force_frames [recording] [calibration.json]
"""

from __future__ import annotations

import json
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from tactilevision.force.calibrated import read_clock_offset, read_material
from tactilevision.force.comparison import residuals
from tactilevision.force.frame import FrameForce, force_folder, force_job
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording

BANDS_MM = (0.03, 0.12, 0.2, 0.3, 0.4, 0.8)
FREE_N, MIN_N = 0.02, 0.05
SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def calibrated(path: Path, folder: Path) -> Path:
    """calibration.json of the recording, made as a user makes it."""
    from tactilevision.cli import main as command

    sys.argv = ["tactilevision", "calibrate", str(path), "--out", str(folder)]
    if command() != 0:
        raise SystemExit(1)
    return folder / "calibration.json"


def beside_the_sensor(recording: Recording, calibration: Path, out: Path) -> tuple[FrameForce, ...]:
    """Forces of every frame, with the reading of its time."""
    job = force_job(recording, build_reconstructor(recording), material=read_material(calibration), out=out)
    return force_folder(recording, job, clock_offset_s=read_clock_offset(calibration))


def report(
    rows: Sequence[FrameForce], accepted: Sequence[str], reading_std_N: Sequence[float] | None = None
) -> None:
    """The table; the F/T sensor states `reading_std_N` (3,) of a reading."""
    free = [row for row in rows if row.read and abs(row.measured_N[2]) < FREE_N]
    pushed = np.array([row.resultant_N[2] for row in free])
    print(f"{len(free)} frames read below {FREE_N} N: {np.mean(pushed == 0):.0%} show no contact")
    print(f"    the largest force of the others, touched or not, {pushed.max():.3f} N")
    left = residuals(rows, reading_std_N)
    assert left is not None
    good = left.usable & np.isin(left.press, accepted) & (left.measured_N[:, 2] > MIN_N)
    pull = left.residual_N[:, 2] / left.std_N[:, 2]
    for low, high in pairwise(BANDS_MM):
        band = good & (left.depth_mm >= low) & (left.depth_mm < high)
        if band.any():
            ratio, says = left.ratio[band], np.median(left.std_N[band, 2] / left.force_N[band, 2])
            inside = np.mean(np.abs(pull[band]) < 1.96)
            print(f"read {low} to {high} mm deep: {band.sum():3d} frames, force/reading {np.median(ratio):.3f}")
            print(
                f"    {ratio.min():.2f} to {ratio.max():.2f}; std {says:.1%}; {inside:.0%} inside 95 %", flush=True
            )
    inside, rms = np.mean(np.abs(pull[good]) < 1.96), np.sqrt(np.mean(pull[good] ** 2))
    print(f"all {good.sum()}: {inside:.0%} inside; rms pull {rms:.2f}")


def main(arguments: Sequence[str]) -> None:
    """Print the table of a recording (first argument) with its calibration.json (second; made if left out)."""
    path = Path(arguments[0]) if arguments else SAMPLE
    with tempfile.TemporaryDirectory() as folder:
        calibration = Path(arguments[1]) if len(arguments) > 1 else calibrated(path, Path(folder) / "calibration")
        recording, accepted = read_recording(path), json.loads(calibration.read_text())["presses_accepted"]
        rows = beside_the_sensor(recording, calibration, Path(folder) / "out")
        report(rows, accepted, recording.force_std_N)


def quick() -> None:
    """A press of the sample on an unbounded gel, by the true material: sides take half a minute to work out."""
    truth, recording = tomllib.loads((SAMPLE / "truth.toml").read_text()), read_recording(SAMPLE)
    good = [press["press"] for press in truth["press"] if press["good"]][-1:]
    spans = [(press.start_s, press.end_s) for press in recording.presses if press.press in good]
    kept = [k for k, time_s in enumerate(recording.frame_times_s) if any(a <= time_s <= b for a, b in spans)]
    names = tuple(recording.frame_names[k] for k in kept)
    assert recording.sensor.gel is not None
    sensor = replace(recording.sensor, gel=replace(recording.sensor.gel, shape="unbounded"))
    few = replace(recording, sensor=sensor, frame_names=names, frame_times_s=recording.frame_times_s[kept])
    material = {
        key: {"value": truth[key], "std": 0.01 * truth[key]} for key in ("youngs_modulus_MPa", "poisson_ratio")
    }
    with tempfile.TemporaryDirectory() as folder:
        calibration = Path(folder) / "calibration.json"
        calibration.write_text(json.dumps(material | {"clock_offset_s": {"value": truth["clock_offset_s"]}}))
        report(beside_the_sensor(few, calibration, Path(folder) / "out"), good, few.force_std_N)


if __name__ == "__main__":
    main(sys.argv[1:])
