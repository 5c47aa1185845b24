"""The calibration folder of gs_sdk as ball presses: its catalogue, its picture of the untouched gel, its labels.

    catalog.csv            experiment_reldir, diameter(mm)      one row for each press
    background.png         the mean of ten pictures of the untouched gel
    4.000mm/0/gelsight.png one press; label.npz beside it: center (x, y) and radius of the contact, px

Labels are a start from which the circle is fitted, as those of any ball.csv are. A ball.csv in the folder itself
(frame: 4.000mm/0/gelsight.png) comes before them: the guide writes one. Source: collect_data.py, label_data.py of
gs_sdk.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactilevision.door.arrays import read_arrays
from tactilevision.door.names import inside
from tactilevision.door.numbers import check_numbers
from tactilevision.errors import RecordingError
from tactilevision.recording.layout import Columns
from tactilevision.recording.model import BallPress
from tactilevision.recording.tables import Table, read_table
from tactilevision.records import Floats

CATALOGUE = "catalog.csv"
UNTOUCHED = "background.png"
PICTURE = "gelsight.png"
LABEL = "label.npz"
DIAMETER = "diameter(mm)"
COLUMNS = Columns(words=("experiment_reldir",), numbers=(DIAMETER,))


def is_gs_sdk_folder(root: Path) -> bool:
    """Whether gs_sdk has collected presses there."""
    return (root / CATALOGUE).is_file() and not (root / CATALOGUE).is_symlink()


def read_catalogue(root: Path) -> tuple[tuple[BallPress, ...], tuple[str, ...]]:
    """The presses in the order of the catalogue, with their labels, and warnings.

    Raises RecordingError for a diameter that is none and a picture that is missing, InputError for a name that
    leads out of the folder and a label that holds no circle.
    """
    table = read_table(root / CATALOGUE, COLUMNS)
    balls = tuple(_press(root, table, row) for row in range(len(table.lines)))
    labelled = sum(ball.contact_radius_px is not None for ball in balls)
    told = f"gs_sdk: {len(balls)} presses, {labelled} of them labelled; diameters halved to radii"
    return balls, (told,)


def _press(root: Path, table: Table, row: int) -> BallPress:
    diameter = float(table.numbers[DIAMETER][row])
    if diameter <= 0:
        raise table.fault(row, f"{DIAMETER} must be above 0", value=diameter)
    name = table.words["experiment_reldir"][row].replace("\\", "/").rstrip("/")
    folder = inside(root, name, where=table.path)
    picture = inside(folder, PICTURE, where=table.path)
    if not picture.is_file():
        raise table.fault(
            row, "the press has no picture", value=f"{name}/{PICTURE}", remedy="Copy it, or take out its row."
        )
    label = inside(folder, LABEL, where=table.path)
    centre, radius = read_label(label) if label.is_file() else (None, None)
    return BallPress(picture, 0.5 * diameter, centre, radius, f"{name}/{PICTURE}")


def read_label(path: Path) -> tuple[tuple[float, float], float]:
    """Centre (x, y) and radius of a contact, px of the picture. Raises RecordingError where there is no circle."""
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
        raise RecordingError("the label's circle is none", where=path, value=circle.tolist())
    return (float(circle[0]), float(circle[1])), float(circle[2])
