"""nu from the gel beside the flat faces of rendered sets: by the picture, and by the drawn surface in its place.

python -m benchmarks.rendered --nu FOLDER...

Places and depths of the faces are the truth's, and only gel beyond the zone of shadows is read: what the two
differ by is the picture's error, and what the second is off by the fit's.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rendered.judge import true_depth_mm
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.press.poisson_from_rise import average_slopes, fit_nu, surface_view
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import SlopeMap
from tactilevision.records.rig import SHADOW_ZONE, Indenter

DEPTH_STD = 0.01  # of the depth, one sigma: as well as bevels certify it


def report(folders: Sequence[Path]) -> None:
    """A row for each radius of each set."""
    print("| set | nu | reflectance | radius | nu off by the picture | off by the drawn surface | presses alone |")
    print(7 * "|---" + "|")
    for folder in folders:
        recording, truth = read_recording(folder), tomllib.loads((folder / "truth.toml").read_text())
        reader = build_reconstructor(recording)
        views = _views(folder, recording, reader, truth["step"])
        nu, ink = truth["gel"]["poisson_ratio"], truth["rig"]["ink"]["reflectance"]
        for radius in sorted({seen.radius_mm for seen, _ in views}):
            seen, drawn = (
                fit_nu(recording, reader, views=[pair[k] for pair in views if pair[k].radius_mm == radius])
                for k in (0, 1)
            )
            assert seen is not None
            assert drawn is not None
            each = [fit_nu(recording, reader, views=[view]) for view, _ in views if view.radius_mm == radius]
            alone = ", ".join("none" if fit is None else f"{fit.values[0] - nu:+.4f}" for fit in each)
            off, std = (f"{fit.values[0] - nu:+.4f}" for fit in (seen, drawn)), seen.poisson_ratio.std or np.nan
            row = f"{folder.name} | {nu:.4f} | {ink:.2f} | {radius:g} mm | {next(off)} ± {std:.4f} | {next(off)}"
            print(f"| {row} | {alone} |", flush=True)


def _views(
    folder: Path, recording: Recording, reader: Reconstructor, steps: Sequence[dict[str, Any]]
) -> list[tuple[SurfaceView, SurfaceView]]:
    """The surface beside each step from the picture's slopes, and from those of the drawn surface."""
    scale, views = recording.sensor.mm_per_px, []
    for number, step in enumerate(steps, start=1):
        frame, drawn = read_frame(recording, number), true_depth_mm(folder, f"frame_{number:05d}")
        seen = reader.slope_map(frame)
        q, p = map(np.asarray, np.gradient(drawn, scale[1], scale[0]))
        views.append(
            (_view(seen, step, recording, number), _view(replace(seen, dz_dx=p, dz_dy=q), step, recording, number))
        )
    return views


def _view(slopes: SlopeMap, step: dict[str, Any], recording: Recording, number: int) -> SurfaceView:
    scale = recording.sensor.mm_per_px
    averaged = average_slopes([(slopes, step["face_mm"])], scale)
    assert averaged is not None
    return surface_view(
        averaged,
        Indenter("step", "flat_cylinder", step["radius_mm"]),
        centre_mm=(step["centre_mm"][0], step["centre_mm"][1]),
        depth_std_mm=DEPTH_STD * step["face_mm"],
        mm_per_px=scale,
        shape=slopes.dz_dx.shape,
        name=str(number),
        clear_mm=SHADOW_ZONE.reach * step["face_mm"],
    )
