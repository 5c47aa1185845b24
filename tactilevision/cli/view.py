"""Command `view`: show, compare, film and export height maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactilevision.batch.selection import (
    Maps,
    deepest_frame,
    find_maps,
    frame_number,
    frames_of,
    is_tiff,
    read_map,
)
from tactilevision.cli import console, options, source
from tactilevision.errors import InputError, check_known
from tactilevision.files.exports import EXPORTS, UNKNOWN, export as export_map
from tactilevision.force.frame import Readings
from tactilevision.heightmap.deviation import contributions_mm
from tactilevision.heightmap.reconstructor import Reading, Reconstructor
from tactilevision.plots import height as draw, style, viewer
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import iter_frames, read_frame
from tactilevision.records.constants import KILO
from tactilevision.records.maps import MEANING, Frame, HeightMap
from tactilevision.records.measured import Bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Singles = npt.NDArray[np.float32]


def view(given: options.View) -> None:
    """Draw a height map: from above with contours, cut, in perspective, its normals, and over its frame."""
    _check(given.export or [], screen=given.window)
    chosen = source.Choice(given.sensor, given.reference, given.method, given.mm_per_px)
    opened: _Opened | Maps = find_maps(given.path, given.mm_per_px) or _Opened(given.path, chosen)
    filmed = [] if given.film is None else _filmed(opened, given.film)
    height, rgb = opened.best() if given.frame is None else opened.named(given.frame)
    console.warn([f"{height.name}: {MEANING[flag]}" for flag in height.flags])
    other = None if given.minus is None else _other(given.minus, opened, given.mm_per_px)
    figures = _draw(height, rgb, other, _terms(height, opened) if given.terms else None)
    for written in _write(figures, height, given.out, html=given.html, forms=given.export or []):
        console.say(f"wrote {written}")
    if given.film is not None:
        console.say(f"wrote {_film(opened, given.film, filmed, given.out)}")
    if given.window:
        maps, number = (lambda n: opened.named(opened.names[n])[0]), opened.number(height.name)
        shown = viewer.Window(opened.names, maps, number=number, marked=other)
        style.show([shown.figure], title=f"tactilevision: {given.path}")


def _write(
    figures: Mapping[str, Figure], height: HeightMap, out: Path, *, html: bool, forms: Sequence[str]
) -> Iterator[Path]:
    """Write the figures, the page and the map in other forms; yield each file once it is written."""
    paths = {name: out / f"{Path(height.name).stem}_{name}.png" for name in figures}
    for name, figure in figures.items():
        style.save_figure(figure, paths[name])
        yield paths[name]
    if html:
        yield viewer.write_surface_page(out, height, [path for name, path in paths.items() if name != "surface"])
    for form in forms:
        yield export_map(height, out, form=form)


def _check(forms: list[str], *, screen: bool) -> None:
    """Raise InputError for unknown forms, or where a window needs a screen and there is none."""
    if screen:
        style.check_screen()
    for form in forms:
        check_known(form, EXPORTS, what=UNKNOWN, where="--export")


def _draw(
    height: HeightMap, rgb: Bytes | None, other: HeightMap | None, terms: Mapping[str, Singles] | None
) -> dict[str, Figure]:
    figures = {
        "depth": draw.draw_height(height),
        "surface": draw.draw_surface(height),
        "normals": draw.draw_normals(height),
    }
    if rgb is not None:
        figures["frame"] = draw.draw_overlay(rgb, height)
    if other is not None:
        title = f"{height.name} minus {other.name}"
        figures[f"minus_{Path(other.name).stem}"] = draw.draw_difference(other, height, title=title)
    if terms is not None:
        figures["terms"] = draw.draw_terms(height, terms)
    return figures


def _terms(height: HeightMap, opened: _Opened | Maps) -> Mapping[str, Singles]:
    """Return the terms of a map's deviation, and print their rms. Raises InputError where they are not known."""
    found = opened.read(height.name).terms_mm() if isinstance(opened, _Opened) else {}
    if not found:
        raise InputError(
            "the terms of the depth's deviation are not known",
            where="--terms",
            value=height.name,
            remedy="Name a frame of a recording whose light was calibrated on balls.",
        )
    for name, rms_mm in contributions_mm(height, found).items():
        console.say(f"  {name:14s} {KILO * rms_mm:6.1f} um in the contact")
    return found


class _Opened:
    """Frames and their reconstructor, which is made when it is first needed, after names are checked."""

    def __init__(self, path: Path, chosen: source.Choice) -> None:
        self.recording: Recording = chosen.open(path)
        self.chosen = chosen

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all frames."""
        return self.recording.frame_names

    @cached_property
    def reconstructor(self) -> Reconstructor:
        with console.progress_bar("calibrating the light:") as progress:
            made = self.chosen.light(self.recording, progress)
        console.warn([*self.recording.warnings, *made.warnings])
        return made

    def number(self, name: str) -> int:
        """Return the number of a frame by its name."""
        return frame_number(self.recording, name)

    def named(self, name: str) -> tuple[HeightMap, Bytes]:
        """Return the map and the rectified picture of a frame."""
        frame = read_frame(self.recording, self.number(name))
        return self.reconstructor.height_map(frame), self.reconstructor.rectified(frame)

    def read(self, name: str) -> Reading:
        """Return the map of a frame and what it rests on."""
        return self.reconstructor.read(read_frame(self.recording, self.number(name)))

    def best(self) -> tuple[HeightMap, Bytes]:
        """Return the deepest of a few frames."""
        return self.named(self.names[deepest_frame(self.recording, self.reconstructor)])


def _other(minus: str, opened: _Opened | Maps, mm_per_px: float | None) -> HeightMap:
    if is_tiff(Path(minus)) and Path(minus).is_file():
        return read_map(Path(minus), mm_per_px)
    return opened.named(minus)[0]


def _filmed(opened: _Opened | Maps, what: str) -> list[int]:
    """Return the numbers of the frames to film. Raises InputError where there are no frames."""
    if not isinstance(opened, _Opened):
        raise InputError("a film needs frames, not depth TIFFs", where="--film", value=what)
    return frames_of(opened.recording, what)


def _film(opened: _Opened | Maps, what: str, numbers: list[int], out: Path) -> Path:
    assert isinstance(opened, _Opened)  # `_filmed` has found frames
    recording, readings, shots = opened.recording, Readings(opened.recording), []
    part = replace(
        recording,
        frame_names=tuple(recording.frame_names[n] for n in numbers),
        frame_times_s=recording.frame_times_s[numbers],
    )
    with console.progress_bar("filming") as progress:
        for done, frame in enumerate(iter_frames(part), start=1):
            if isinstance(frame, Frame):
                pressed_N = float(readings.at(frame.time_s)[2])
                height, rgb = opened.reconstructor.height_map(frame), opened.reconstructor.rectified(frame)
                shots.append(viewer.Shot(rgb, height, pressed_N))
            progress(done, len(numbers))
    name = what.replace(":", "-").replace("/", "-")
    title = f"{recording.name}, {what}"
    return viewer.write_film(out / f"film_{name}.mp4", viewer.draw_film(shots, title=title))
