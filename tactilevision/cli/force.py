"""`tactilevision force PATH --calibration calibration.json`: where the force goes, frame by frame."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tactilevision.cli import console, source


def force(
    path: Annotated[Path, typer.Argument(help="A recording, or a folder of frames.")],
    calibration: Annotated[Path, typer.Option(help="calibration.json, with E and nu.")],
    out: console.OutOption = Path("force_out"),
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into maps of traction on the gel (MPa) and resultants (N): tractions.npz and resultants.csv."""
    from tactilevision.force.calibrated import read_clock_offset, read_material
    from tactilevision.force.folder import force_folder

    recording = source.open_source(path, sensor, reference)
    material = read_material(calibration)
    with console.progress_bar("calibrating the light"):
        reconstructor = source.open_reconstructor(recording, method)
    console.warn([*recording.warnings, *reconstructor.warnings])
    with console.progress_bar("frames") as progress:
        rows = force_folder(
            recording, reconstructor, material, out,
            clock_offset_s=read_clock_offset(calibration), progress=progress,
        )  # fmt: skip
    found = [row for row in rows if row.found is not None]
    console.say(f"{len(found)} of {len(rows)} frames: {out / 'tractions.npz'}, {out / 'resultants.csv'}")
    console.say(*(f"  {row.frame}: {row.why}" for row in rows if row.found is None))
    beside = [row for row in found if row.found is not None and np.isfinite(row.measured_N).all()]
    if beside:
        difference = [
            row.found.resultant_N[2] - float(row.measured_N[2]) for row in beside if row.found is not None
        ]
        console.say(f"  fz less the force sensor's, rms over {len(beside)} frames: {_rms(difference):.3f} N")
    console.hand_over({"frames": len(rows), "read": len(found)}, json)


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
