"""Real frames of others that lie in public repositories, read out of clones of these; none is in this project.

| set | sensor | clone | commit | frames |
|---|---|---|---|---|
| E | GelSight Mini | taxim 1.4.1 (wheel) | | 24 balls, 640 by 480 |
| F | GelSight Mini | github.com/RuihanGao/16741-Proj-ShapeMap3D-GelSightMini | e6ea68e | 49 balls |
| G | DIGIT | github.com/vocdex/digit-depth | 2acf872 | 14 balls of 6 mm |
| H | another DIGIT | the same | 6d95047 | 5 balls |
| I | a third DIGIT | github.com/rohankotanu/3DCal-tests | 070c9c8 | 10 of 150 balls, one quarter of the gel |

F, G and H have no untouched picture: the median of their frames stands for it. I is stored mirrored, red and blue
changed; both are undone here. Balls' radii are stated for G and H alone; of the others directions have a truth.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.reference import Reference, make_reference
from tactilevision.records.measured import Bytes, Pair

Balls = tuple[Reference, list[BallPicture], Pair]  # untouched picture, ball presses, mm per px
_MINI_SCALE, _DIGIT_SCALE = (0.0634, 0.0634), (0.0583, 0.0583)
EVERY = 15  # of set I, whose balls stand ten to a place


def f_minis(clones: Path) -> Balls:
    clone = clones / "16741-Proj-ShapeMap3D-GelSightMini"
    names = [f"Taxim/data/Gel/11_19_2023/calib_ball/frame_{k}.jpg" for k in range(1, 50)]
    frames = [_picture(clone, "e6ea68e", name) for name in names]
    pictures = [BallPicture(rgb, 2.0, name=name) for rgb, name in zip(frames, names, strict=True)]
    return _median(frames), pictures, _MINI_SCALE


def g_digit(clones: Path) -> Balls:
    return _digit_depth(clones, "2acf872", [f"{k:04d}" for k in range(14)], "sphere.csv")


def h_digit(clones: Path) -> Balls:
    return _digit_depth(clones, "6d95047", ["0000", "0001", "0002", "0016", "0017"], "annotate.csv")


def i_digit(clones: Path) -> Balls:
    clone, folder = clones / "3DCal-tests", "sensor_calibration_data"
    listed = _git(clone, "ls-tree", "--name-only", "070c9c8", f"{folder}/probe_images/").decode().split()

    def read(name: str) -> Bytes:
        return np.ascontiguousarray(_picture(clone, "070c9c8", name)[:, ::-1, ::-1])

    pictures = [BallPicture(read(name), 4.0, name=name) for name in sorted(listed)[::EVERY]]
    return make_reference([read(f"{folder}/blank_images/blank.png")], may_have_marks=False), pictures, _DIGIT_SCALE


SETS: dict[str, Callable[[Path], Balls]] = {"F": f_minis, "G": g_digit, "H": h_digit, "I": i_digit}


def _digit_depth(clones: Path, commit: str, names: Sequence[str], table: str) -> Balls:
    clone = clones / "digit-depth"
    rows = [row.split(",")[-3:] for row in _git(clone, "show", f"{commit}:csv/{table}").decode().split()]
    circles = [tuple(map(float, row)) for row in rows if row[0].isdecimal()]
    frames = [_picture(clone, commit, f"qt_images/{name}.png") for name in names]
    pictures = [
        BallPicture(rgb, 3.0, (x, y), radius, name)
        for rgb, (x, y, radius), name in zip(frames, circles, names, strict=True)
    ]
    return _median(frames), pictures, _DIGIT_SCALE


def _median(frames: Sequence[Bytes]) -> Reference:
    return make_reference([np.median(frames, axis=0).round().astype(np.uint8)], may_have_marks=False)


def _picture(clone: Path, commit: str, name: str) -> Bytes:
    coded = np.frombuffer(_git(clone, "show", f"{commit}:{name}"), np.uint8)
    bgr = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    assert bgr is not None, name
    return np.ascontiguousarray(bgr[..., ::-1])


def _git(clone: Path, *words: str) -> bytes:
    return subprocess.run(["git", "-C", str(clone), *words], check=True, capture_output=True).stdout
