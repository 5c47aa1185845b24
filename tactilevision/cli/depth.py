"""`tactilevision depth PATH`: frames into height maps."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console, source


def depth(
    path: Annotated[Path, typer.Argument(help="A recording, or a folder of frames.")],
    out: console.OutOption = Path("depth_out"),
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if left out.")] = None,
    json: console.JsonOption = None,
) -> None:
    """Turn frames into height maps: depth/NAME.tiff in mm (float32, NaN where invalid), and depth.csv."""
    from tactilevision.folder import reconstruct_folder

    recording = source.open_source(path, sensor, reference)
    with console.progress_bar("calibrating the light"):
        reconstructor = source.open_reconstructor(recording, method)
    console.warn([*recording.warnings, *reconstructor.warnings])
    with console.progress_bar("frames") as progress:
        rows = reconstruct_folder(recording, reconstructor, out, workers=workers, progress=progress)
    counts = Counter(row.status.split(":")[0] for row in rows)
    bad = [row for row in rows if row.status != "ok"]
    console.say(
        f"{counts['ok']} of {len(rows)} frames became height maps: {out / 'depth'}/NAME.tiff, {out / 'depth.csv'}"
    )
    console.say(*(f"  {row.frame}: {row.status}" for row in bad[:10]))
    if len(bad) > 10:
        console.say(f"  ... and {len(bad) - 10} more, all in {out / 'depth.csv'}")
    best = max((row for row in rows if row.status == "ok"), key=lambda row: row.peak_mm, default=None)
    if best is not None:
        console.say(f"  deepest: {best.frame}, {best.peak_mm:.3f} mm over {best.contact_area_mm2:.1f} mm²")
    console.hand_over(
        {"frames": len(rows), "statuses": dict(counts), "bad": {r.frame: r.status for r in bad}}, json
    )
