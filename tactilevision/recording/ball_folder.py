"""Read a folder of ball presses without a recording.toml, including that of gs_sdk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.errors import RecordingError, found_in
from tactilevision.files.arrays import read_arrays
from tactilevision.files.opening import check_numbers, inside, real_path
from tactilevision.recording import layout
from tactilevision.recording.folder import read_folder
from tactilevision.recording.layout import Columns
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.pictures import list_images, read_balls
from tactilevision.recording.tables import Table, read_table
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Sensor

# The calibration folder of gs_sdk: catalogue, picture of the untouched gel, labels.
#
#     catalog.csv            experiment_reldir, diameter(mm)      one row for each press
#     background.png         the mean of ten pictures of the untouched gel
#     4.000mm/0/gelsight.png one press
#     4.000mm/0/label.npz    center (x, y) and radius of the contact, px
#
# Labels are initial values of the fitted circle. A ball.csv in the folder (frame: 4.000mm/0/gelsight.png), which
# the guide writes, takes precedence. Source: collect_data.py, label_data.py of gs_sdk.

CATALOGUE = "catalog.csv"
UNTOUCHED = "background.png"
PICTURE = "gelsight.png"
LABEL = "label.npz"
DIAMETER = "diameter(mm)"
COLUMNS = Columns(words=("experiment_reldir",), numbers=(DIAMETER,))


def is_gs_sdk_folder(root: Path) -> bool:
    """Return whether gs_sdk has collected presses there."""
    return (root / CATALOGUE).is_file() and not (root / CATALOGUE).is_symlink()


def read_catalogue(root: Path) -> tuple[tuple[BallPress, ...], tuple[str, ...]]:
    """Read the presses in the order of the catalogue, with their labels; return them and warnings.

    Raises RecordingError for an impossible diameter and a missing picture, InputError for a name that leads out of
    the folder and a label without a circle.
    """
    table = read_table(root / CATALOGUE, COLUMNS)
    balls = tuple(_press(root, table, row) for row in range(len(table.lines)))
    labelled = sum(ball.contact_radius_px is not None for ball in balls)
    return balls, (f"gs_sdk: {len(balls)} presses, {labelled} of them labelled; diameters halved to radii",)


def _press(root: Path, table: Table, row: int) -> BallPress:
    diameter = float(table.numbers[DIAMETER][row])
    name = table.words["experiment_reldir"][row].replace("\\", "/").rstrip("/")
    folder = inside(root, name, where=table.path)
    picture = inside(folder, PICTURE, where=table.path)
    if not picture.is_file():
        raise table.fault(
            row, "the press has no picture", value=f"{name}/{PICTURE}", remedy="Copy it, or remove its row."
        )
    label = inside(folder, LABEL, where=table.path)
    centre, radius = read_label(label) if label.is_file() else (None, None)
    with found_in(f"{table.path}, line {table.lines[row]}"):
        return BallPress(picture, 0.5 * diameter, centre, radius, f"{name}/{PICTURE}")


def read_label(path: Path) -> tuple[tuple[float, float], float]:
    """Read centre (x, y) and radius of a contact, px of the picture.

    Raises RecordingError if there is no circle.
    """
    arrays = read_arrays(path)
    numbers = [np.ravel(arrays.get(name, np.zeros(0))) for name in ("center", "radius")]
    if [len(one) for one in numbers] != [2, 1] or any(one.dtype.kind not in "iuf" for one in numbers):
        raise RecordingError(
            "the label holds no circle: center (2 numbers) and radius (1)",
            where=path,
            value=sorted(arrays),
            remedy="Label the press again, or remove the file.",
        )
    circle: Floats = np.concatenate([one.astype(np.float64) for one in numbers])
    check_numbers(circle, what="a number of the label", where=path)
    if not np.isfinite(circle).all() or circle[2] <= 0:
        raise RecordingError("the label's circle is impossible", where=path, value=circle.tolist())
    return (float(circle[0]), float(circle[1])), float(circle[2])


# Four forms of folders: `reference` of a recording, or one that holds it (flat/, ball/, ball.csv); pictures next
# to a ball.csv; pictures that are all presses of one ball of a given radius; the calibration folder of gs_sdk. Any
# other folder is read as a bare one, without balls.

BALL, FLAT, TABLE = (Path(name).name for name in (layout.BALLS, layout.FLATS, layout.BALL_TABLE))


def read_ball_folder(
    path: Path | str,
    sensor: Sensor | Path | str | None = None,
    *,
    reference: Path | str | None = None,
    mm_per_px: float | None = None,
    ball_radius_mm: float | None = None,
) -> Recording:
    """Read the pictures of a bare folder, with its ball presses and its pictures of the untouched gel.

    The arguments are those of `read_folder`; `ball_radius_mm` is that of all presses, if there is no table. Raises
    RecordingError as `read_folder` does, and for ball presses without a picture of the untouched gel.
    """
    root = Path(path)
    collected = is_gs_sdk_folder(root)
    place = None if collected else place_of_balls(root)
    if place is None and ball_radius_mm is None and not collected:
        return read_folder(root, sensor, reference=reference, mm_per_px=mm_per_px)
    folder, table = place or (root, root / TABLE)
    usual = root / UNTOUCHED if collected else folder.parent / FLAT
    flats = reference or (usual if collected or usual.is_dir() else None)
    found = read_folder(folder, sensor, reference=flats, mm_per_px=mm_per_px)
    if found.flat_frames:
        raise RecordingError(
            "ball presses need a picture of the untouched gel",
            where=root,
            remedy="Name it with --reference.",
        )
    if table.is_file():
        balls, notes = read_balls(folder, table)
    elif collected:
        balls, notes = read_catalogue(root)
        if found.sensor.rectification is not None:
            balls = tuple(replace(ball, centre_px=None, contact_radius_px=None) for ball in balls)
            notes += ("labels of gs_sdk are ignored: they are not in the rectified frame",)
    else:
        balls, notes = _alike(folder, found, ball_radius_mm), ()
    return replace(found, path=root, name=real_path(root).name, balls=balls, warnings=found.warnings + notes)


def place_of_balls(root: Path) -> tuple[Path, Path] | None:
    """Find the folder of presses and the path of their table; None if there is neither."""
    for reference in (root, root / layout.BALLS.split("/")[0]):
        if (reference / BALL).is_dir():
            return reference / BALL, reference / TABLE
    return (root, root / TABLE) if (root / TABLE).is_file() else None


def _alike(folder: Path, found: Recording, radius_mm: float | None) -> tuple[BallPress, ...]:
    """Return all pictures but those of the untouched gel as presses of one ball."""
    if radius_mm is None:
        raise RecordingError(
            "the radius of the balls is not known",
            where=folder,
            remedy=f"State it with --ball-radius-mm, or in {TABLE} (frame, ball_radius_mm).",
        )
    flats = {real_path(flat) for flat in found.flats}
    names = [name for name in list_images(folder) if real_path(folder / name) not in flats]
    return tuple(BallPress(folder / name, radius_mm) for name in names)
