"""One press as MuJoCo's tactile sensor and as the camera see it, on one grid.

`python -m benchmarks.taxels PROFILE` reads a ball press of sample_frames/gelslim3 with the profile that
`calibrate-sensor --calibration` made of this recording, presses the same ball as deep in MuJoCo, prints their
differences and draws docs/images/taxels.png.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from benchmarks.simulators import ask, interpreter
from tactilevision import TaxelGrid, load_sensor, rectify
from tactilevision.plots import style
from tactilevision.recording.images import read_image
from tactilevision.records.constants import KILO

ROOT = Path(__file__).parents[1]
FRAME, RADIUS_MM = "reference/ball/01.png", 4.0
COUNT, PITCH_MM = 17, 0.4


def compare(profile: str, out: Path = ROOT / "docs" / "images" / "taxels.png") -> None:
    """Press, print, draw."""
    frame = read_image(ROOT / "sample_frames" / "gelslim3" / FRAME)
    sensor = load_sensor(profile)
    seen = sensor.read(frame)
    rows, columns = np.nonzero(seen.contact)
    scale, size = seen.height.mm_per_px, seen.height.depth_mm.shape
    middle = ((columns.mean() - (size[1] - 1) / 2) * scale[0], (rows.mean() - (size[0] - 1) / 2) * scale[1])
    found = seen.at_taxels(TaxelGrid(COUNT, COUNT, (PITCH_MM, PITCH_MM), middle))
    deepest = float(seen.height.depth_mm[seen.contact].max())
    task = {"program": "tactile", "count": COUNT, "pitch_m": PITCH_MM / KILO, "centre_m": (0, 0)}
    python = interpreter("mujoco")
    assert python is not None
    there = ask(python, task | {"radius_m": RADIUS_MM / KILO, "depth_m": deepest / KILO})
    simulated = np.array(there).reshape(COUNT, COUNT)
    both = (simulated > 0) & (found.penetration_m > 0)
    apart = 1e6 * (found.penetration_m - simulated)[both]
    print(f"depth {deepest:.3f} mm; {both.sum()} taxels in both, {(simulated > 0).sum()} in MuJoCo's contact")
    print(f"penetration differs by {apart.mean():+.1f} um on average, {apart.std():.1f} um (rms)")
    assert found.traction_Pa is not None
    assert seen.wrench is not None
    force = np.nansum(found.force_N[2]) if found.force_N is not None else float("nan")
    print(f"force of the taxels {force:.3f} N, of the wrench {seen.wrench.force_N[2]:.3f} N")
    maps = [(1e6 * simulated, "MuJoCo: depth (µm)"), (1e6 * found.penetration_m, "camera: depth (µm)")]
    maps.append((found.traction_Pa[2] / KILO, "camera: traction (kPa)"))
    half = COUNT * PITCH_MM / 2
    left, top = (int(c - half / s) for c, s in ((columns.mean(), scale[0]), (rows.mean(), scale[1])))
    wide, high = (int(2 * half / s) for s in scale)
    draw(rectify(sensor.profile.sensor, np.asarray(frame))[top : top + high, left : left + wide], maps, out)


@style.house_look
def draw(frame: np.ndarray, maps: list[tuple[np.ndarray, str]], out: Path) -> None:
    """The frame, and the grids next to each other."""
    figure, panels = style.new_figure(width_in=8, columns=4, height_in=3)
    style.as_map(panels[0], "", "", "camera: frame")
    half = COUNT * PITCH_MM / 2
    panels[0].imshow(frame, extent=(-half, half, half, -half))
    panels[0].set(xlabel="x (mm)", ylabel="y (mm)")
    top = max(float(np.nanmax(field)) for field, _ in maps[:2])
    for axes, (field, title) in zip(panels[1:], maps, strict=True):
        style.as_map(axes, "x (mm)", "", title)
        limit = top if "depth" in title else float(np.nanmax(field))
        image = style.show_map(axes, field, (-half, half, half, -half), limits=(0, limit))
        figure.colorbar(image, ax=axes, shrink=0.7, orientation="horizontal")
    style.save_figure(figure, out)


if __name__ == "__main__":
    compare(sys.argv[1])
