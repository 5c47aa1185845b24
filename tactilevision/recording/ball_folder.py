"""A folder of ball presses and pictures of the untouched gel, without a recording.toml, as a recording.

Four forms: the folder `reference` of a recording, or one that holds it (flat/, ball/, ball.csv); pictures beside
a ball.csv; pictures that are all presses of one ball, whose radius is then said; the calibration folder of gs_sdk.
A folder without any of these holds no balls: it is read as any other bare folder.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tactilevision.errors import RecordingError
from tactilevision.recording import layout
from tactilevision.recording.folder import read_folder
from tactilevision.recording.gs_sdk_folder import UNTOUCHED, is_gs_sdk_folder, read_catalogue
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.pictures import list_images, read_balls
from tactilevision.records import Sensor

BALL, FLAT, TABLE = (Path(name).name for name in (layout.BALLS, layout.FLATS, layout.BALL_TABLE))


def read_ball_folder(
    path: Path | str,
    sensor: Sensor | Path | str | None = None,
    *,
    reference: Path | str | None = None,
    mm_per_px: float | None = None,
    ball_radius_mm: float | None = None,
) -> Recording:
    """The pictures of a bare folder, with its ball presses and its pictures of the untouched gel.

    The arguments are those of `read_folder`; `ball_radius_mm` is that of all presses, where no table says it.
    Raises RecordingError as that does, and for ball presses without a picture of the untouched gel.
    """
    root = Path(path)
    if is_gs_sdk_folder(root):
        return _of_gs_sdk(root, sensor, reference or root / UNTOUCHED, mm_per_px)
    place = place_of_balls(root)
    if place is None and ball_radius_mm is None:
        return read_folder(root, sensor, reference=reference, mm_per_px=mm_per_px, guess=True)
    folder, table = place or (root, root / TABLE)
    beside = folder.parent / FLAT
    flats = reference if reference is not None else beside if beside.is_dir() else None
    found = read_folder(folder, sensor, reference=flats, mm_per_px=mm_per_px, guess=True)
    if found.flat_frames:
        raise RecordingError(
            "ball presses need a picture of the untouched gel beside them",
            where=root,
            remedy="Name it with --reference.",
        )
    if table.is_file():
        balls, notes = read_balls(folder, table)
    else:
        balls, notes = _alike(folder, found, ball_radius_mm), ()
    return replace(found, path=root, name=root.resolve().name, balls=balls, warnings=found.warnings + notes)


def _of_gs_sdk(
    root: Path, sensor: Sensor | Path | str | None, reference: Path | str, mm_per_px: float | None
) -> Recording:
    """Presses as gs_sdk collected them; their labels are those of a ball.csv in the folder where there is one."""
    found = read_folder(root, sensor, reference=reference, mm_per_px=mm_per_px, guess=True)
    balls, notes = read_balls(root, root / TABLE) if (root / TABLE).is_file() else read_catalogue(root)
    if found.sensor.rectification is not None and not (root / TABLE).is_file():
        balls = tuple(replace(ball, centre_px=None, contact_radius_px=None) for ball in balls)
        notes += ("labels of gs_sdk are left out: they are not in the rectified frame",)
    return replace(found, path=root, name=root.resolve().name, balls=balls, warnings=found.warnings + notes)


def place_of_balls(root: Path) -> tuple[Path, Path] | None:
    """The folder of presses and where their table is; None where there is neither."""
    for reference in (root, root / layout.BALLS.split("/")[0]):
        if (reference / BALL).is_dir():
            return reference / BALL, reference / TABLE
    return (root, root / TABLE) if (root / TABLE).is_file() else None


def _alike(folder: Path, found: Recording, radius_mm: float | None) -> tuple[BallPress, ...]:
    """All pictures but those of the untouched gel, as presses of one ball."""
    if radius_mm is None:
        raise RecordingError(
            "the radius of the balls is not known",
            where=folder,
            remedy=f"Say it with --ball-radius-mm, or in {TABLE} (frame, ball_radius_mm).",
        )
    flats = {flat.resolve() for flat in found.flats}
    names = [name for name in list_images(folder) if (folder / name).resolve() not in flats]
    return tuple(BallPress(folder / name, radius_mm) for name in names)
