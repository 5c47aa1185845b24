"""Read and write circles of ball presses: the table ball.csv."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactilevision.errors import InputError
from tactilevision.recording import layout
from tactilevision.recording.ball_folder import TABLE, is_gs_sdk_folder, place_of_balls, read_catalogue
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.pictures import list_images
from tactilevision.recording.tables import read_table
from tactilevision.recording.write import write_table

MIN_RADIUS_PX = 1.0  # px; a smaller circle is a slip of the hand
State = Literal["found", "not found", "drawn", "checked", "left out"]
Circle = tuple[float, float, float]  # x, y, radius in px of the rectified frame


@dataclass(frozen=True, slots=True)
class Label:
    """One press: its name in the table, its picture, the ball's radius, its circle, and who says so.

    "found" by the finder alone, "drawn" by hand, "checked" by a person, "left out" of the table; `why` it was
    not found.
    """

    frame: str
    path: Path
    radius_mm: float
    circle: Circle | None = None
    state: State = "not found"
    why: str = ""

    @property
    def used(self) -> bool:
        """Whether the fit takes it."""
        return self.circle is not None and self.state != "left out"


def table_of(recording: Recording) -> Path:
    """Where the labels of a recording, or of a bare folder of presses, are kept."""
    return _place(recording.path)[1]


def labels_of(recording: Recording) -> tuple[Label, ...]:
    """The presses of the table and, left out, the pictures beside them that it does not list.

    Raises InputError where there are no presses.
    """
    if not recording.balls:
        raise InputError(
            "no ball presses to label",
            where=recording.path,
            remedy="Put pictures of them into reference/ball, and state --ball-radius-mm.",
        )
    listed = [_label(ball) for ball in recording.balls]
    radius_mm = float(np.median([label.radius_mm for label in listed]))
    names = {label.frame for label in listed}
    others = [ball for ball in _unlisted(recording, radius_mm) if ball.name not in names]
    return (*listed, *(Label(b.name, b.path, b.ball_radius_mm, state="left out") for b in others))


def start_table(root: Path, radius_mm: float | None) -> None:
    """Write the table of a recording whose ball presses have none: all pictures, one radius."""
    folder, table = _place(root)
    names = list_images(folder)
    if radius_mm is not None and names and not table.exists() and (root / layout.SETTINGS).is_file():
        write_table(table, {"frame": names, "ball_radius_mm": [radius_mm] * len(names)})


def write_labels(table: Path, labels: Sequence[Label]) -> None:
    """Write the table: presses that are not left out, and the circles a person drew or checked.

    Columns that have no meaning here are kept.
    """
    kept = [label for label in labels if label.state != "left out"]
    nowhere = (math.nan, math.nan, math.nan)
    said = [label.circle or nowhere if label.state in ("drawn", "checked") else nowhere for label in kept]
    columns: dict[str, list[Any]] = {
        "frame": [label.frame for label in kept],
        "ball_radius_mm": [label.radius_mm for label in kept],
        **{name: [c[n] for c in said] for n, name in enumerate(layout.BALL_COLUMNS.maybe_numbers)},
    }
    write_table(table, columns | _further(table, kept))


def _further(table: Path, labels: Sequence[Label]) -> dict[str, list[Any]]:
    """Cells of columns without a meaning, of the table as it was."""
    if not table.is_file():
        return {}
    old = read_table(table, layout.BALL_COLUMNS)
    row = {name: number for number, name in enumerate(old.words["frame"])}
    return {
        name: [cells[row[one.frame]] if one.frame in row else "" for one in labels]
        for name, cells in old.extra.items()
    }


def _label(ball: BallPress) -> Label:
    if ball.centre_px is None or ball.contact_radius_px is None:
        return Label(ball.name, ball.path, ball.ball_radius_mm)
    circle = (*ball.centre_px, ball.contact_radius_px)
    return Label(ball.name, ball.path, ball.ball_radius_mm, circle, "checked")


def _unlisted(recording: Recording, radius_mm: float) -> Sequence[BallPress]:
    root = recording.path
    if is_gs_sdk_folder(root):
        return read_catalogue(root)[0]
    folder, flats = _place(root)[0], {flat.resolve() for flat in recording.flats}
    paths = [folder / name for name in list_images(folder)]
    return [BallPress(path, radius_mm) for path in paths if path.resolve() not in flats]


def _place(root: Path) -> tuple[Path, Path]:
    """The folder of presses and their table."""
    if (root / layout.SETTINGS).is_file():
        return root / layout.BALLS, root / layout.BALL_TABLE
    if is_gs_sdk_folder(root):
        return root, root / TABLE
    return place_of_balls(root) or (root, root / TABLE)
