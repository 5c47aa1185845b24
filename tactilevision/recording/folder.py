"""Read a bare folder of pictures, or a video, as a recording without tables."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import RecordingError
from tactilevision.files.opening import real_path
from tactilevision.recording import layout
from tactilevision.recording.images import stated_frames
from tactilevision.recording.layout import some
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import (
    check_references,
    doubts_of_turning,
    find_flats,
    find_frames,
    first_look,
    frame_names,
    list_images,
    most_sizes,
)
from tactilevision.recording.read import read_recording
from tactilevision.recording.sensor import build_sensor
from tactilevision.records.rig import Sensor
from tactilevision.sensors import SENSORS, check_scale

if TYPE_CHECKING:
    from tactilevision.recording.settings import SensorSettings


# Guesses for a bare folder of pictures: scale, and a picture of the untouched gel. A note for each guess names the
# option that states it instead.

SAME_SHAPE = 0.02  # relative tolerance of width to height: a resized picture has whole pixels
_FLAT = re.compile(r"(ref|reference|flat|background|bg|untouched|free|no_?contact|f0)([_.\- ]?\d*)$", re.I)

Notes = tuple[str, ...]


def guess_scale(settings: SensorSettings, size_px: tuple[int, int]) -> tuple[SensorSettings, Notes]:
    """Return the settings of a sensor with the scale of pictures of `size_px` (width, height), and what was
    guessed.

    A picture of the sensor's usual shape is assumed to show its usual view at any number of pixels. Raises
    RecordingError for another shape.
    """
    usual = SENSORS.get(settings.kind or "")
    own = {"width_px": settings.width_px or size_px[0], "height_px": settings.height_px or size_px[1]}
    if settings.rectification is not None:
        return settings, ()
    if usual is None or settings.mm_per_px is not None:
        return (settings.model_copy(update=own) if settings.kind == "custom" else settings), ()
    width, height = size_px
    if abs(width * usual.height_px / (height * usual.width_px) - 1) > SAME_SHAPE:
        raise RecordingError(
            f"pictures of {width} x {height} have another shape than those of a {usual.kind}, {usual.width_px} x "
            f"{usual.height_px}, so their scale is not known",
            where="--sensor",
            remedy="State it with --mm-per-px.",
        )
    scale = [usual.mm_per_px[0] * usual.width_px / width, usual.mm_per_px[1] * usual.height_px / height]
    note = f"guessed: {scale[0]:.4g} mm per pixel, that of a usual {usual.kind}; --mm-per-px states it"
    return settings.model_copy(update={"mm_per_px": scale}), (note,)


def guess_flats(
    root: Path, frames_path: Path, names: Sequence[str], *, first: int = 0
) -> tuple[tuple[Path, ...], tuple[int, ...], Notes]:
    """Find pictures of the untouched gel, or the number of the frame taken for one.

    Return them and what was guessed. Without a picture named so it is frame number `first`. Without frame `names`
    nothing is guessed: only the folder `reference` counts.
    """
    found = find_flats(root)
    if found or not names:
        return found, (), ()
    for folder in dict.fromkeys((root, frames_path, frames_path.parent)):
        named = [name for name in list_images(folder) if _FLAT.match(Path(name).stem)] if folder.is_dir() else []
        if named:
            note = f"guessed: {named[0]} shows the untouched gel, by its name; --reference states it"
            return (folder / named[0],), (), (note,)
    which = "the only frame" if len(names) == 1 else "the first frame"
    flat = ", so that its map is flat" if len(names) == 1 else ""
    note = f"guessed: {which}, {names[first]}, shows the untouched gel{flat}; --reference states it"
    return (), (first,), (note,)


# Reading a bare folder of pictures, or a video, for depth and force.

MAX_LOOKED = 1000  # files and folders below a folder that are searched for pictures
_UNREAD = (".gif", ".webp", ".heic", ".avif", ".jp2", ".jxl", ".ppm", ".dng", ".raw", ".exr")  # not supported
MAX_NAMED = 5  # endings of files in one message
_READ = f"Read are {', '.join(layout.IMAGE_SUFFIXES)}, and videos: {', '.join(layout.VIDEO_SUFFIXES)}."


def read_folder(
    path: Path | str,
    sensor: Sensor | Path | str | None = None,
    *,
    reference: Path | str | None = None,
    mm_per_px: float | None = None,
    white_level: float | None = None,
    guess: bool = True,
) -> Recording:
    """Read pictures in the order of their names, without times.

    `sensor` is a Sensor, the name of a known one, or a TOML file with a table [sensor] as in recording.toml;
    `reference` a picture of the untouched gel, or a folder of such, here or in `path`; without one it is guessed,
    unless `guess` is False; `mm_per_px` the scale, guessed if the sensor's usual one does not apply. The warnings
    list the guesses. If `path` is a recording, what is not given here is read from it. `white_level` is for a
    Sensor. Raises RecordingError for an empty folder, an unknown or missing sensor, and a missing reference;
    InputError for an impossible scale.
    """
    root = Path(path)
    flats = list_references(_named(reference, root))
    if sensor is None and _is_recording(root):
        return _of_recording(root, flats, mm_per_px)
    frames_path, names = _frames_of(root)
    if sensor is None:
        raise RecordingError(
            "the sensor is not known",
            where=root,
            remedy=f"Name it with --sensor: {', '.join(SENSORS)}, a TOML file, or a profile (.tvs).",
        )
    settings, place, warnings = (None, root, ()) if isinstance(sensor, Sensor) else _sensor_settings(sensor)
    white_level = settings.white_level if settings else white_level
    size, seen = first_look(frames_path, names, white_level=white_level)
    size, first, odd = most_sizes(frames_path, names, size)
    warnings += seen + odd + _cut_short(frames_path, len(names)) + _passed_over(frames_path)
    found = (flats, (), ()) if flats else guess_flats(root, frames_path, names if guess else (), first=first)
    warnings += check_references(size, found[0][:1], white_level=white_level)
    warnings += doubts_of_turning(frames_path, names[first:], found[0])
    if settings is not None:
        stated = {} if mm_per_px is None else {"mm_per_px": [mm_per_px, mm_per_px]}
        settings, guessed = guess_scale(settings.model_copy(update=stated), size)
        sensor, notes = build_sensor(settings, place, frame_size_px=size)
        warnings += guessed + notes
    return Recording(
        path=root,
        name=real_path(root).name,
        sensor=_scaled(sensor, mm_per_px),
        frames_path=frames_path,
        frame_names=names,
        frame_times_s=np.full(len(names), np.nan),
        frame_size_px=size,
        flats=found[0],
        flat_frames=found[1],
        white_level=white_level,
        warnings=warnings + found[2],
    )


def _is_recording(root: Path) -> bool:
    """Return whether `root` is a recording, or for its reader to refuse: missing, or a folder of recordings."""
    return (root / layout.SETTINGS).is_file() or not root.exists() or any(root.glob(f"*/{layout.SETTINGS}"))


def _of_recording(root: Path, flats: tuple[Path, ...], mm_per_px: float | None) -> Recording:
    own = read_recording(root, sensor={} if mm_per_px is None else {"mm_per_px": [mm_per_px, mm_per_px]})
    size, seen = own.frame_size_px, own.warnings
    if size is not None:
        seen += check_references(size, flats[:1], white_level=own.white_level)
        seen += doubts_of_turning(own.frames_path, own.frame_names, flats)
    return replace(own, flats=flats or own.flats, sensor=_scaled(own.sensor, mm_per_px), warnings=seen)


def _scaled(sensor: Sensor | Path | str, mm_per_px: float | None) -> Sensor:
    assert isinstance(sensor, Sensor)
    if mm_per_px is None:
        return sensor
    check_scale(mm_per_px, where="mm_per_px")
    return replace(sensor, mm_per_px=(mm_per_px, mm_per_px))


def _frames_of(root: Path) -> tuple[Path, tuple[str, ...]]:
    """Return where the frames are, and their names: of a folder, a video, or a single picture."""
    if root.is_file() and root.suffix.lower() in layout.IMAGE_SUFFIXES:
        return root.parent, (root.name,)
    path = root if root.is_file() else find_frames(root) or root
    return path, _names(path)


def _names(root: Path) -> tuple[str, ...]:
    if root.is_file() and root.suffix.lower() not in layout.VIDEO_SUFFIXES:
        raise RecordingError("is neither a picture nor a video of a supported kind", where=root, remedy=_READ)
    if not root.exists():
        raise RecordingError("there is no such folder of pictures, nor such a video", where=root)
    names = frame_names(root)
    if root.is_dir() and not names:
        raise RecordingError("the folder holds no pictures", where=root, remedy=_elsewhere(root) + _READ)
    return names


def _elsewhere(root: Path) -> str:
    """Return a folder below one without pictures that has some, or else what kinds of files are there."""
    folders = [path for path in sorted(root.rglob("*"))[:MAX_LOOKED] if path.is_dir() and list_images(path)]
    if folders:
        return f"There are some in {folders[0]}. "
    others = sorted({path.suffix.lower() for path in root.iterdir() if path.is_file() and path.suffix})
    return f"It holds {', '.join(others[:MAX_NAMED])}. " if others else ""


def _passed_over(folder: Path) -> tuple[str, ...]:
    """Return a warning for pictures of a kind that is not read."""
    entries = sorted(os.listdir(folder)) if folder.is_dir() else []
    left = [name for name in entries if name.lower().endswith(_UNREAD) and name[0] != "."]
    return (f"skipped, since pictures of this kind are not read: {some(left)}",) if left else ()


def _cut_short(video: Path, count: int) -> tuple[str, ...]:
    stated = stated_frames(video) if video.is_file() else 0
    if stated <= count:
        return ()
    return (
        f"{video.name} ends after {count} of the {stated} frames that its header states: is it cut short, or does "
        "its rate vary?",
    )


def _sensor_settings(sensor: Path | str) -> tuple[SensorSettings, Path, tuple[str, ...]]:
    from tactilevision.recording.settings import SensorSettings, check_sensor, load_toml

    if str(sensor).endswith(".toml"):
        settings, warnings = check_sensor(load_toml(Path(sensor)), Path(sensor))
        return settings, Path(sensor), warnings
    return SensorSettings(kind=str(sensor)), Path("--sensor"), ()


def _named(reference: Path | str | None, root: Path) -> Path | None:
    """Return the path of the reference, looked up in `root` if nothing else has its name."""
    if reference is None or Path(reference).exists() or not (root / reference).exists():
        return None if reference is None else Path(reference)
    return root / reference


def list_references(path: Path | None) -> tuple[Path, ...]:
    """List the picture at `path`, or those in that folder. Raises RecordingError if there are none."""
    if path is None:
        return ()
    found = (path,) if path.is_file() else tuple(path / name for name in list_images(path))
    if not found:
        raise RecordingError(
            "there is no picture of the untouched gel", where=path, remedy="Name one picture, or a folder of such."
        )
    return found
