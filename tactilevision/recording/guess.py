"""What a bare folder of pictures does not say and can be guessed: its scale, and a picture of the untouched gel.

Each guess comes with a sentence that says so, and the option that states it instead.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactilevision.errors import RecordingError
from tactilevision.recording.pictures import find_flats, list_images
from tactilevision.sensors import SENSORS

if TYPE_CHECKING:
    from tactilevision.recording.settings import SensorSettings

SAME_SHAPE = 0.02  # of the ratio of width to height: what a resized picture loses by whole pixels
_FLAT = re.compile(r"(ref|reference|flat|background|bg|untouched|free|no_?contact|f0)([_.\- ]?\d*)$", re.I)

Notes = tuple[str, ...]


def guess_scale(settings: SensorSettings, size_px: tuple[int, int]) -> tuple[SensorSettings, Notes]:
    """The settings of a sensor with the scale of pictures of `size_px` (width, height), and what was guessed.

    A picture of the sensor's usual shape shows its usual view, however many pixels it has. Raises RecordingError
    for one of another shape.
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
            f"pictures of {width} x {height} are no view of a {usual.kind}, which has {usual.width_px} x "
            f"{usual.height_px}, so that its scale is not known",
            where="--sensor",
            remedy="State it with --mm-per-px.",
        )
    scale = [usual.mm_per_px[0] * usual.width_px / width, usual.mm_per_px[1] * usual.height_px / height]
    note = f"guessed: {scale[0]:.4g} mm per pixel, that of a usual {usual.kind}; --mm-per-px states it"
    return settings.model_copy(update={"mm_per_px": scale}), (note,)


def guess_flats(
    root: Path, frames_path: Path, names: Sequence[str], *, first: int = 0
) -> tuple[tuple[Path, ...], tuple[int, ...], Notes]:
    """Pictures of the untouched gel, or the number of the frame that is taken for one, and what was guessed.

    It is the `first` by number where none is named so. Of no frame `names` nothing is guessed: what the folder
    `reference` holds is all.
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
