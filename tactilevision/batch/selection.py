"""Selected frames of a recording, and height maps that were written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilevision.batch.folder import MAPS, STDS, TABLE, peak_mm
from tactilevision.errors import InputError
from tactilevision.files.tiff import read_tiff
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.layout import Columns
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import list_images, read_frame
from tactilevision.recording.tables import read_table
from tactilevision.records.maps import FALSE, HeightMap
from tactilevision.records.rig import Press

TRIED = 12  # frames among which the deepest is sought


def frame_number(recording: Recording, name: str) -> int:
    """Return the number of a frame by its name or stem. Raises InputError where there is none."""
    return _place_of([name], recording.frame_names, what="has no such frame", where=recording.path)


def _place_of(asked: Sequence[str], names: Sequence[str], *, what: str, where: Path) -> int:
    """Return the number of the first name, or else stem, that was asked for."""
    for known in (list(names), [Path(one).stem for one in names]):
        for name in asked:
            if name in known:
                return known.index(name)
    raise InputError(what, where=where, value=asked[0], remedy=f"It has {names[0]} to {names[-1]}.")


def frames_of(recording: Recording, what: str) -> list[int]:
    """Return the numbers of the frames of a press, of a range FIRST:LAST, or of "all".

    Raises InputError for a press that does not exist or has no frames.
    """
    if what == "all":
        return list(range(len(recording.frame_names)))
    if ":" in what:
        first, last = (frame_number(recording, name) for name in what.split(":", 1))
        return list(range(min(first, last), max(first, last) + 1))
    press = next((one for one in recording.presses if one.press == what), None)
    if press is None:
        remedy = "Name a press, FIRST:LAST frame, or `all`."
        raise InputError("there is no such press", where="--film", value=what, remedy=remedy)
    inside = _during(recording, press).tolist()
    if not inside:
        raise InputError("no frame was taken during the press", where="--film", value=what)
    return inside


def strongest_frames(recording: Recording, size: Sequence[float], *, most: int) -> list[int]:
    """Return at most `most` frame numbers in order: of each press the frame of greatest `size` (NaN: none).

    Where no presses or times are known, the frames are divided into `most` parts instead.
    """
    values = np.asarray(size, dtype=float)
    parts = [_during(recording, press) for press in recording.presses]
    if not any(part.size for part in parts):
        parts = np.array_split(np.arange(len(recording.frame_names)), max(min(most, len(values)), 1))
    known = [part[np.isfinite(values[part])] for part in parts]
    best = [int(part[np.argmax(values[part])]) for part in known if part.size]
    return sorted(sorted(best, key=lambda number: -values[number])[:most])


def deepest_frame(recording: Recording, reconstructor: Reconstructor) -> int:
    """Return the number of the deepest of TRIED frames, trusted ones first. Raises InputError without any."""
    found: list[tuple[bool, float, int]] = []
    fault: InputError | None = None
    for number in sorted(set(np.linspace(0, len(recording.frame_names) - 1, TRIED).astype(int).tolist())):
        try:
            height = reconstructor.height_map(read_frame(recording, number))
        except InputError as refused:
            fault = refused
            continue
        trusted = not FALSE.intersection(height.flags)
        found.append((trusted, float(np.nan_to_num(peak_mm(height), nan=-1.0)), number))
    if not found:
        assert fault is not None
        raise fault
    return max(found)[2]


def _during(recording: Recording, press: Press) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    times = recording.frame_times_s
    return np.flatnonzero((times >= press.start_s) & (times <= press.end_s))


class Maps:
    """Depth TIFFs of a folder by their names; next to it in `root` may be depth_std/ and depth.csv."""

    def __init__(self, folder: Path, names: Sequence[str], mm_per_px: float | None = None) -> None:
        self.root, self.folder, self.names, self._scale = folder.parent, folder, names, mm_per_px

    def number(self, name: str) -> int:
        """Return the number of a map by its file's or frame's name. Raises InputError where there is none."""
        return _place_of([name, Path(name).stem], self.names, what="has no such map", where=self.folder)

    def named(self, name: str) -> tuple[HeightMap, None]:
        """Return the map (H, W), in mm, with its deviation where `depth --std` wrote one, and no picture."""
        file = self.names[self.number(name)]
        height, std = read_map(self.folder / file, self._scale), self.root / STDS / file
        if std.is_file():
            std_mm = read_map(std, self._scale).depth_mm
            if std_mm.shape == height.depth_mm.shape:
                height = replace(height, std_mm=std_mm)
        return height, None

    def best(self) -> tuple[HeightMap, None]:
        """Return the deepest map by depth.csv, of those that can be trusted if any, or else the first."""
        if len(self.names) == 1:
            return self.named(self.names[0])
        columns = Columns(words=("frame",), maybe_words=("flags",), maybe_numbers=("peak_mm",))
        listed = read_table(self.root / TABLE, columns)
        peaks_mm, flags = np.nan_to_num(listed.optional("peak_mm")), listed.words.get("flags", ())
        trusted = np.array([not FALSE.intersection(one.split()) for one in flags], np.bool_)
        peaks_mm = np.where(trusted, peaks_mm, 0.0) if trusted.any() else peaks_mm
        return self.named(listed.words["frame"][int(np.argmax(peaks_mm))] if peaks_mm.max() > 0 else self.names[0])


def find_maps(path: Path, mm_per_px: float | None = None) -> Maps | None:
    """Return the maps in a folder of results, or in its depth/, or one alone; None where there are none."""
    if is_tiff(path):
        return Maps(path.parent, [path.name], mm_per_px)
    for root in (path, path.parent):
        if (root / TABLE).is_file() and (root / MAPS).is_dir() and path in (root, root / MAPS):
            names = [name for name in list_images(root / MAPS) if is_tiff(Path(name))]
            return Maps(root / MAPS, names, mm_per_px) if names else None
    return None


def is_tiff(path: Path) -> bool:
    """Return whether a name ends as a depth TIFF's."""
    return path.suffix.lower() in (".tif", ".tiff")


def read_map(path: Path, mm_per_px: float | None) -> HeightMap:
    """Read a depth TIFF (H, W), in mm; `mm_per_px` overrides its own scale."""
    return read_tiff(path, mm_per_px=None if mm_per_px is None else (mm_per_px, mm_per_px))
