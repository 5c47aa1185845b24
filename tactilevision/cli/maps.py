"""Height maps that `depth` has written, as `view` looks through them."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactilevision.door.cells import cell_text
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from tactilevision.records import HeightMap


class Maps:
    """The TIFF files of a folder of results by their names; `root` holds depth/ and depth.csv."""

    def __init__(self, root: Path, mm_per_px: float | None = None) -> None:
        from tactilevision.batch.folder import MAPS
        from tactilevision.recording.pictures import list_images

        self.root, self.folder, self._scale = root, root / MAPS, mm_per_px
        self.names = [name for name in list_images(self.folder) if is_tiff(Path(name))]

    def number(self, name: str) -> int:
        """The place of a map by its file's name, or its frame's. Raises InputError where there is none."""
        stems = [Path(one).stem for one in self.names]
        for known in (self.names, stems):
            for asked in (name, Path(name).stem):
                if asked in known:
                    return known.index(asked)
        remedy = f"It has {self.names[0]} to {self.names[-1]}."
        raise InputError("has no such map", where=self.folder, value=name, remedy=remedy)

    def named(self, name: str) -> tuple[HeightMap, None]:
        """The map (H, W), in mm, with its deviation where `depth --std` kept one; no picture."""
        from tactilevision.batch.folder import STDS

        file = self.names[self.number(name)]
        height, beside = read_map(self.folder / file, self._scale), self.root / STDS / file
        if beside.is_file():
            std_mm = read_map(beside, self._scale).depth_mm
            if std_mm.shape == height.depth_mm.shape:
                height = replace(height, std_mm=std_mm)
        return height, None

    def stretch(self, what: str) -> list[int]:
        """Numbers of frames to film: a film needs frames, and raises InputError here."""
        raise InputError("a film needs frames, not depth TIFFs", where="--film", value=what)

    def best(self) -> tuple[HeightMap, None]:
        """The deepest, by depth.csv; else the first."""
        from tactilevision.batch.folder import TABLE

        deepest, peak_mm = self.names[0], 0.0
        with (self.root / TABLE).open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                said = row.get("peak_mm") or "nan"
                if said.replace(".", "", 1).isdecimal() and float(said) > peak_mm:
                    deepest, peak_mm = cell_text(row["frame"]), float(said)
        return self.named(deepest)


def find_maps(path: Path, mm_per_px: float | None = None) -> Maps | None:
    """The maps in a folder of results, or in its depth/; None where `path` is neither."""
    from tactilevision.batch.folder import MAPS, TABLE

    for root in (path, path.parent):
        if (root / TABLE).is_file() and (root / MAPS).is_dir() and path in (root, root / MAPS):
            found = Maps(root, mm_per_px)
            return found if found.names else None
    return None


def is_tiff(path: Path) -> bool:
    """Whether it is called as a depth TIFF is."""
    return path.suffix.lower() in (".tif", ".tiff")


def read_map(path: Path, mm_per_px: float | None) -> HeightMap:
    """A depth TIFF (H, W), in mm; `mm_per_px` overrides its own scale."""
    from tactilevision.exports.tiff import read_tiff

    return read_tiff(path, mm_per_px=None if mm_per_px is None else (mm_per_px, mm_per_px))
