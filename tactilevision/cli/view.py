"""Run the command `view`: show, compare, film and export height maps."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console, source
from tactilevision.errors import InputError
from tactilevision.files.documents import cell_text
from tactilevision.records.maps import MEANING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from matplotlib.figure import Figure

    from tactilevision.heightmap.reconstructor import Reading, Reconstructor
    from tactilevision.plots.viewer import Window
    from tactilevision.recording.model import Recording
    from tactilevision.records.maps import Frame, HeightMap
    from tactilevision.records.measured import Bytes


# Height maps that `depth` has written, as `view` looks through them.


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
    from tactilevision.files.tiff import read_tiff

    return read_tiff(path, mm_per_px=None if mm_per_px is None else (mm_per_px, mm_per_px))


# `tactilevision view PATH`: look at a height map, hold two against each other, film a press, export.

TRIED = 12  # frames to find the deepest among where none is named


def view(
    path: Annotated[
        Path,
        typer.Argument(
            help="A depth TIFF, what `depth` wrote, a recording, a video, a frame, or a folder of frames."
        ),
    ],
    out: console.OutOption = Path("view_out"),
    frame: Annotated[str | None, typer.Option(help="Name of the frame; the deepest of a few if left out.")] = None,
    minus: Annotated[
        str | None, typer.Option(help="Another frame's name, or depth TIFF: also draw the map less this one.")
    ] = None,
    film: Annotated[
        str | None, typer.Option(help="Film this press, or FIRST:LAST frame, or `all`; an MP4, else a GIF.")
    ] = None,
    export: Annotated[
        list[str] | None, typer.Option(help="Also write the map as tiff, npz, zarr, ply or vtk (repeatable).")
    ] = None,
    sensor: source.SensorOption = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    mm_per_px: Annotated[
        float | None,
        typer.Option(
            callback=source.check_scale, help="Scale of frames, or of a depth TIFF that does not state its own."
        ),
    ] = None,
    terms: Annotated[
        bool, typer.Option("--terms", help="Also draw which part of the depth's deviation is the largest where.")
    ] = False,
    html: Annotated[
        bool, typer.Option("--html", help="Also write one page with a surface to turn; it needs no other file.")
    ] = False,
    window: Annotated[
        bool,
        typer.Option(
            "--window", help="Open a window: all frames, profiles by mouse, differences, a surface to turn."
        ),
    ] = False,
) -> None:
    """Draw a height map: from above with contours, cut, in perspective, its normals, and over its frame."""
    from tactilevision.files.exports import export as write
    from tactilevision.plots import style

    _check(export or [], screen=window)
    rgb: Bytes | None = None
    opened: _Opened | Maps | None = None
    filmed: list[int] = []
    if is_tiff(path):
        height = read_map(path, mm_per_px)
    else:
        chosen = source.Choice(sensor, reference, method, mm_per_px)
        opened = find_maps(path, mm_per_px) or _Opened(path, chosen)
        filmed = [] if film is None else opened.stretch(film)
        height, rgb = opened.best() if frame is None else opened.named(frame)
    console.warn([f"{height.name}: {MEANING[flag]}" for flag in height.flags])
    told = _terms(height, opened) if terms else {}
    other = None if minus is None else _other(minus, opened, mm_per_px)
    figures = _draw(height, rgb, other)
    if told:
        from tactilevision.plots.height import draw_terms

        figures["terms"] = draw_terms(height, told)
    stem = Path(height.name).stem
    for name, figure in figures.items():
        path_out = out / f"{stem}_{name}.png"
        style.save_figure(figure, path_out)
        console.say(f"wrote {path_out}")
    if html:
        from tactilevision.plots.viewer import write_surface_page

        flat = [out / f"{stem}_{name}.png" for name in figures if name != "surface"]
        console.say(f"wrote {write_surface_page(out, height, flat)}")
    for form in export or []:
        console.say(f"wrote {write(height, out, form=form)}")
    if film is not None:
        _film(opened, film, filmed, out)
    if window:
        style.show([_window(height, opened, other).figure], title=f"tactilevision: {path}")


def _window(height: HeightMap, opened: _Opened | Maps | None, other: HeightMap | None) -> Window:
    """The window on all frames beside this one; on a depth TIFF alone there is one frame."""
    from tactilevision.plots.viewer import Window

    if opened is None:
        return Window([height.name], lambda _: height, marked=other)
    names = opened.names
    return Window(names, lambda n: opened.named(names[n])[0], number=opened.number(height.name), marked=other)


def _check(forms: list[str], *, screen: bool) -> None:
    """Whether all forms are known, and a screen is there where one is needed; before anything is drawn."""
    from tactilevision.errors import InputError
    from tactilevision.files.exports import EXPORTS
    from tactilevision.plots import style

    if screen:
        style.check_screen()
    unknown = [form for form in forms if form not in EXPORTS]
    if unknown:
        raise InputError(
            "no such format of height maps",
            where="--export",
            value=unknown[0],
            remedy="Known are " + ", ".join(EXPORTS) + ".",
        )


def _draw(height: HeightMap, rgb: Bytes | None, other: HeightMap | None) -> dict[str, Figure]:
    from tactilevision.plots import height as draw

    figures = {
        "depth": draw.draw_height(height),
        "surface": draw.draw_surface(height),
        "normals": draw.draw_normals(height),
    }
    if rgb is not None:
        figures["frame"] = draw.draw_overlay(rgb, height, footprint=None)
    if other is not None:
        title = f"{height.name} minus {other.name}"
        figures[f"minus_{Path(other.name).stem}"] = draw.draw_difference(other, height, title=title)
    return figures


def _terms(height: HeightMap, opened: _Opened | Maps | None) -> dict[str, npt.NDArray[np.float32]]:
    """The terms of a map's deviation, told on the way. Raises InputError where nothing is known of them."""
    from tactilevision.errors import InputError
    from tactilevision.heightmap.deviation import contributions_mm

    found = opened.read(height.name).terms_mm() if isinstance(opened, _Opened) else {}
    if not found:
        raise InputError(
            "nothing is known of what the depth's deviation is made of",
            where="--terms",
            value=height.name,
            remedy="Name a frame of a recording whose light was calibrated on balls.",
        )
    for name, rms_mm in contributions_mm(height, found).items():
        console.say(f"  {name:14s} {1e3 * rms_mm:6.1f} um in the contact")
    return found


class _Opened:
    """Frames with the way from them to depth, made when it is needed first: names are checked before."""

    def __init__(self, path: Path, chosen: source.Choice) -> None:
        self.recording: Recording = chosen.open(path)
        self.chosen = chosen

    @property
    def names(self) -> tuple[str, ...]:
        """Of all frames."""
        return self.recording.frame_names

    @cached_property
    def reconstructor(self) -> Reconstructor:
        with console.progress_bar("calibrating the light"):
            made = self.chosen.light(self.recording)
        console.warn([*self.recording.warnings, *made.warnings])
        return made

    def named(self, name: str) -> tuple[HeightMap, Bytes]:
        frame = self._frame(name)
        return self.reconstructor.height_map(frame), self.reconstructor.rectified(frame)

    def read(self, name: str) -> Reading:
        return self.reconstructor.read(self._frame(name))

    def _frame(self, name: str) -> Frame:
        from tactilevision.recording.pictures import read_frame

        return read_frame(self.recording, self.number(name))

    def number(self, name: str) -> int:
        from tactilevision.errors import InputError

        names = self.recording.frame_names
        stems = [Path(one).stem for one in names]
        if name not in names and name not in stems:
            raise InputError(
                "has no such frame",
                where=self.recording.path,
                value=name,
                remedy=f"It has {names[0]} to {names[-1]}.",
            )
        return names.index(name) if name in names else stems.index(name)

    def stretch(self, what: str) -> list[int]:
        """Numbers of the frames of a press, of a stretch FIRST:LAST, or of all."""
        import numpy as np

        from tactilevision.errors import InputError

        recording = self.recording
        if what == "all":
            return list(range(len(recording.frame_names)))
        if ":" in what:
            first, last = (self.number(name) for name in what.split(":", 1))
            return list(range(min(first, last), max(first, last) + 1))
        press = next((one for one in recording.presses if one.press == what), None)
        if press is None:
            raise InputError(
                "there is no such press",
                where="--film",
                value=what,
                remedy="Name a press, FIRST:LAST frame, or `all`.",
            )
        times = recording.frame_times_s
        inside = np.flatnonzero((times >= press.start_s) & (times <= press.end_s))
        if not inside.size:
            raise InputError("no frame was taken during the press", where="--film", value=what)
        return [int(number) for number in inside]

    def best(self) -> tuple[HeightMap, Bytes]:
        """The deepest of a few; frames that cannot be read are passed over, all of them cannot."""
        import numpy as np

        from tactilevision.errors import InputError
        from tactilevision.recording.pictures import read_frame

        found: list[tuple[float, int]] = []
        last: InputError | None = None
        for row in dict.fromkeys(np.linspace(0, len(self.recording.frame_names) - 1, TRIED).astype(int).tolist()):
            try:
                height = self.reconstructor.height_map(read_frame(self.recording, row))
            except InputError as fault:
                last = fault
                continue
            known = height.depth_mm[height.valid]
            found.append((float(np.percentile(known, 99.9)) if known.size else -1.0, row))
        if not found:
            assert last is not None
            raise last
        return self.named(self.recording.frame_names[max(found)[1]])


def _other(minus: str, opened: _Opened | Maps | None, mm_per_px: float | None) -> HeightMap:
    from tactilevision.errors import InputError

    if is_tiff(Path(minus)) and Path(minus).is_file():
        return read_map(Path(minus), mm_per_px)
    if opened is None:
        raise InputError("is not a depth TIFF", where="--minus", value=minus)
    return opened.named(minus)[0]


def _film(opened: _Opened | Maps | None, what: str, numbers: list[int], out: Path) -> None:
    from tactilevision.errors import InputError
    from tactilevision.force.comparison import Readings
    from tactilevision.plots.viewer import Shot, draw_film, write_film
    from tactilevision.recording.pictures import iter_frames
    from tactilevision.records.maps import Frame

    if not isinstance(opened, _Opened):
        raise InputError("a film needs frames, not depth TIFFs", where="--film", value=what)
    recording, readings, shots = opened.recording, Readings(opened.recording), []
    part = replace(
        recording,
        frame_names=tuple(recording.frame_names[n] for n in numbers),
        frame_times_s=recording.frame_times_s[numbers],
    )
    with console.progress_bar("filming") as progress:
        for done, frame in enumerate(iter_frames(part), start=1):
            if isinstance(frame, Frame):
                height = opened.reconstructor.height_map(frame)
                shots.append(
                    Shot(opened.reconstructor.rectified(frame), height, float(readings.at(frame.time_s)[2]))
                )
            progress(done, len(numbers))
    name = what.replace(":", "-").replace("/", "-")
    path = write_film(out / f"film_{name}.mp4", draw_film(shots, title=f"{recording.name}, {what}"))
    console.say(f"wrote {path}")
