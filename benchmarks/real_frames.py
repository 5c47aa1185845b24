"""Real frames of others at ../shared/real (sets A to E), and the circles of balls that benchmarks judge by.

`public_frames.py` reads sets F to I.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.public_frames import Balls
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture, BallSearch
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes, Pair

ROOT = Path(__file__).parents[1]
REAL = ROOT / ".." / "shared" / "real"
GELSLIMS = {
    "A": "gelslim3_mcubelab/markerless",
    "B": "gelslim3_mcubelab/markers",
    "C": "gelslim_heightmap/dots1",
    "D": "gelslim_heightmap/test_data",
}
MINI = "taxim_gelsight_mini"
SETS = (*GELSLIMS, "E")
OBJECTS = {
    "A": ("gelslim3_mcubelab/markerless_objects", "*.jpg"),
    "B": ("gelslim3_mcubelab/objects", "*.jpg"),
    "D": ("gelslim_heightmap/test_data", "reconstruct*.jpg"),
}
SCALE, MINI_SCALE = (0.0634, 0.0634), (0.0317, 0.0317)
RADIUS_MM, MINI_RADIUS_MM = 3.8, 4.0  # assumed: no size is recorded; directions hardly depend on it


def real_balls(name: str) -> Balls:
    """The rectified ball presses of a set from A to E."""
    if name == "E":
        shots = sorted((REAL / MINI).glob("img_*.png"))
        flat = make_reference([_read(REAL / MINI / "f0.png")], may_have_marks=False)
        return flat, [BallPicture(_read(path), MINI_RADIUS_MM, name=path.name) for path in shots], MINI_SCALE
    folder = REAL / GELSLIMS[name]
    shots = sorted(folder.glob("sample_*.jpg"))
    pictures = [BallPicture(_rectified(path), RADIUS_MM, name=path.name) for path in shots]
    return make_reference([_rectified(folder / "ref.jpg")]), pictures, SCALE


def objects_of(name: str) -> list[Bytes]:
    """Rectified frames (H, W, 3) of other objects on the sensor of a set in OBJECTS."""
    folder, pattern = OBJECTS[name]
    return [_rectified(path) for path in sorted((REAL / folder).glob(pattern))]


def circles(change: ColourChange, pictures: Sequence[BallPicture], mm_per_px: Pair) -> list[Ball | None]:
    """The balls by the light of each other, as a calibration finds them; `labelled_circles` says why."""
    rng = np.random.default_rng(0)
    search = BallSearch(change, pictures, mm_per_px, rng)
    return list(search.refine(search.collect()).balls)


def _rectified(path: Path) -> Bytes:
    with np.load(path.parents[1] / "abe_corr.npz", allow_pickle=False) as table:
        return np.ascontiguousarray(_read(path)[table["x"], table["y"]])


def _read(path: Path) -> Bytes:
    raw = cv2.imread(str(path))
    assert raw is not None, path
    return np.ascontiguousarray(raw[..., ::-1])
