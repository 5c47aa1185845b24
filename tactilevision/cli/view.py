"""`tactilevision view PATH`: look at a height map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console, source

if TYPE_CHECKING:
    from tactilevision.records import Bytes, HeightMap


def view(
    path: Annotated[Path, typer.Argument(help="A depth TIFF, a recording, or a folder of frames.")],
    out: console.OutOption = Path("view_out"),
    frame: Annotated[str | None, typer.Option(help="Name of the frame; the deepest of a few if left out.")] = None,
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    mm_per_px: Annotated[
        float | None, typer.Option(help="Scale of a depth TIFF that does not state its own.")
    ] = None,
    window: Annotated[bool, typer.Option("--window", help="Show the pictures in windows, too.")] = False,
) -> None:
    """Draw a height map: from above with scale bar and colour bar, cross-sections, and in perspective."""
    from tactilevision.plots import height as draw
    from tactilevision.plots import style

    rgb: Bytes | None = None
    if path.suffix.lower() in (".tif", ".tiff"):
        from tactilevision.height_files import read_tiff

        height = read_tiff(path, mm_per_px=None if mm_per_px is None else (mm_per_px, mm_per_px))
    else:
        height, rgb = _reconstruct(path, frame, sensor, reference=reference, method=method)
    figures = {"depth": draw.draw_height(height), "surface": draw.draw_surface(height)}
    if rgb is not None:
        figures["frame"] = draw.draw_overlay(rgb, height, None)
    for name, figure in figures.items():
        path_out = out / f"{Path(height.name).stem}_{name}.png"
        style.save_png(figure, path_out)
        console.say(f"wrote {path_out}")
    if window:
        style.show(list(figures.values()))


def _reconstruct(
    path: Path, frame: str | None, sensor: str | None, *, reference: Path | None, method: str | None
) -> tuple[HeightMap, Bytes]:
    import numpy as np

    from tactilevision.errors import InputError
    from tactilevision.recording import read_frame
    from tactilevision.sensors import rectify

    recording = source.open_source(path, sensor, reference)
    reconstructor = source.open_reconstructor(recording, method)
    names = recording.frame_names
    if frame is not None and frame not in names:
        raise InputError("has no such frame", where=path, value=frame, remedy=f"It has {names[0]} to {names[-1]}.")
    rows = [names.index(frame)] if frame is not None else np.linspace(0, len(names) - 1, 12).astype(int).tolist()
    frames = [read_frame(recording, row) for row in dict.fromkeys(rows)]
    heights = [reconstructor.height_map(one) for one in frames]
    best = int(np.argmax([np.percentile(h.depth_mm[h.valid], 99.9) if h.valid.any() else -1 for h in heights]))
    return heights[best], rectify(recording.sensor, frames[best].rgb)
