"""Height maps of a tree of recordings, bare folders of frames and videos.

A recording or frame that cannot be read is listed with the reason and skipped.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tactilevision.batch.folder import COLUMNS, TABLE, Form, FrameResult, cells, reconstruct_folder
from tactilevision.batch.jobs import Journal, fingerprint_of
from tactilevision.cluster.connect import check_cluster
from tactilevision.errors import ClusterError, InputError, OutputError, RecordingError
from tactilevision.files.documents import csv_text
from tactilevision.files.opening import real_path
from tactilevision.files.runs import output_lock
from tactilevision.files.writing import remove, write_text
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording import layout
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import find_frames

FINISHED = ".depth-finished"  # in a folder of results until the whole tree is done
REFERENCE = layout.FLATS.split("/")[0]  # folder of the untouched gel's pictures and the balls
Open = Callable[[Path], Recording]
Light = Callable[[Recording], Reconstructor]
Run = Callable[..., tuple[FrameResult, ...]]  # reconstruct_folder with its options
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Branch:
    """One source of frames in the tree: `name` is its path within it; `rows` of its depth.csv, or `why` there are
    none."""

    name: str
    rows: tuple[FrameResult, ...] = ()
    why: str = ""

    def path_of(self, row: FrameResult) -> str:
        """Return a frame's path in the tree."""
        return row.frame if self.name == "." else f"{self.name}/{row.frame}"


def find_sources(root: Path | str, *, leave: Path | None = None) -> tuple[Path, ...]:
    """Find recordings, folders that hold pictures, and videos below `root`, by name; nothing inside a recording.

    Hidden folders, `leave` (for results) and links to folders above are skipped. Raises InputError if there is no
    such folder.
    """
    root = Path(root)
    if not root.is_dir():
        raise InputError("there is no such folder", where=root)
    return tuple(_walk(root, set() if leave is None else {real_path(leave)}))


def find_recordings(path: Path) -> tuple[Path, ...]:
    """Return the recordings in a folder that is none itself; else, or where it has none, the path."""
    if not path.is_dir() or (path / layout.SETTINGS).exists():
        return (path,)
    return tuple(one for one in find_sources(path) if (one / layout.SETTINGS).exists()) or (path,)


def reconstruct_tree(
    root: Path | str,
    out: Path | str,
    *,
    read: Open,
    light: Light,
    form: Form = "tiff",
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
    with_std: bool = False,
    device: str | None = None,
    method: str = "",
) -> tuple[Branch, ...]:
    """Write height maps of every source below `root` into OUT/its path there; OUT/depth.csv lists all frames.

    `read` opens a source; `light` makes its reconstructor; `method` names their way of reading. An interrupted run
    is resumed: results of finished sources are kept next to their table. Raises InputError if no source is found.
    """
    if cluster is not None:
        check_cluster(cluster)
    root, out, report = Path(root), Path(out), progress or (lambda done, total, what: None)
    run = partial(
        reconstruct_folder, workers=workers, cluster=cluster, form=form, with_std=with_std, device=device
    )
    way = " ".join((form, "with std" if with_std else "", device or "", method))
    with output_lock(out):
        found, branches = _opened(root, out, read)
        finished = {name: _rows_of_finished(out / name, recording, way) for name, recording in found.items()}
        branches += [Branch(name, rows) for name, rows in finished.items() if rows is not None]
        total, before = sum(len(one.frame_names) for one in found.values()), sum(len(b.rows) for b in branches)
        report(before, total, "")
        for name, recording in found.items():
            if finished[name] is None:
                so_far = partial(_forward, report, before, total, name)
                branches.append(
                    _branch(name, recording, out, light=light, run=partial(run, progress=so_far), way=way)
                )
                before += len(recording.frame_names)
        branches.sort(key=lambda branch: branch.name)
        if all(branch.why for branch in branches):
            raise InputError(
                "none of its recordings, folders and videos can be read",
                where=root,
                remedy=f"The first of {len(branches)}: {branches[0].why}",
            )
        write_text(out / TABLE, _table(branches))
        for name in found:
            remove(out / name / FINISHED)
    return tuple(branches)


def _forward(report: Progress, before: int, total: int, name: str, done: int, of: int) -> None:
    """Report the progress of one source as that of the tree."""
    report(before + done, total, name)


def _opened(root: Path, out: Path, read: Open) -> tuple[dict[str, Recording], list[Branch]]:
    """Open the sources below `root` by their path in it; return them and those that cannot be read."""
    found: dict[str, Recording] = {}
    refused: list[Branch] = []
    for path in find_sources(root, leave=out):
        name = path.relative_to(root).as_posix()
        try:
            found[name] = read(path)
        except InputError as fault:
            refused.append(Branch(name, why=str(fault)))
    if not found and not refused:
        raise InputError("there are neither recordings, pictures nor videos in it", where=root)
    return found, refused


def _branch(name: str, recording: Recording, out: Path, *, light: Light, run: Run, way: str) -> Branch:
    place = out / name
    try:
        rows = run(recording, light(recording), place)
    except (OutputError, ClusterError):
        raise
    except InputError as fault:
        return Branch(name, why=str(fault))
    _finished(place, recording, way).begin(rows)
    return Branch(name, rows)


def _finished(place: Path, recording: Recording, way: str) -> Journal:
    """Return the file that holds the results of a finished branch until the whole tree is."""
    return Journal(place / FINISHED, fingerprint_of(recording, way))


def _rows_of_finished(place: Path, recording: Recording, way: str) -> tuple[FrameResult, ...] | None:
    rows = tuple(_finished(place, recording, way).read(FrameResult).values())
    whole = len(rows) == len(recording.frame_names) and (place / TABLE).is_file()
    return rows if whole else None


def _walk(folder: Path, leave: set[Path]) -> Iterator[Path]:
    here = real_path(folder)
    if here in leave:
        return
    names = sorted(name for name in os.listdir(folder) if not name.startswith("."))
    if layout.SETTINGS in names:
        yield folder
        return
    own = _frames_of(folder)
    if own is not None or any(name.lower().endswith(layout.IMAGE_SUFFIXES) for name in names):
        yield folder
    for name in names:
        path = folder / name
        if path == own or (path.is_dir() and name in (layout.FRAMES, REFERENCE)):
            continue
        if path.is_dir():
            yield from _walk(path, {*leave, here})
        elif path.suffix.lower() in layout.VIDEO_SUFFIXES:
            yield path


def _frames_of(folder: Path) -> Path | None:
    try:
        return find_frames(folder)
    except RecordingError:
        return folder / layout.FRAMES  # reading it reports the error


def _table(branches: Sequence[Branch]) -> str:
    """List every frame under its path in the tree; a source that could not be read is one row."""
    lines: list[tuple[str, ...]] = [COLUMNS]
    for branch in branches:
        if branch.why:
            lines.append((branch.name, f"passed over: {branch.why}", *[""] * (len(COLUMNS) - 2)))
        lines += [cells(replace(row, frame=branch.path_of(row))) for row in branch.rows]
    return csv_text(lines)
