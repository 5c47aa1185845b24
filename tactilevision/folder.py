"""A whole folder of frames into height maps: streamed, on all cores, taken up again where it was cut off.

Each frame's map is written whole under its own name before the frame is counted as done, so killing the run
at any moment loses nothing and a second run does only what is left.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import write_text
from tactilevision.height_files import write_tiff
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import BadFrame, Recording, iter_frames
from tactilevision.records import Frame, HeightMap

TABLE = "depth.csv"
MAPS = "depth"
JOURNAL = ".depth-journal.csv"
COLUMNS = ("frame", "status", "peak_mm", "contact_area_mm2", "ms")


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One row of depth.csv: `status` is "ok", or why there is no map."""

    frame: str
    status: str
    peak_mm: float = float("nan")
    contact_area_mm2: float = float("nan")
    ms: float = float("nan")


def reconstruct_folder(
    recording: Recording,
    reconstructor: Reconstructor,
    out: Path | str,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[FrameResult, ...]:
    """Write depth/NAME.tiff for every frame, and depth.csv; returns its rows in the order of the frames.

    `workers` is the number of processes (None: one a core). A frame that cannot be read is listed and passed
    over. An earlier, unfinished run into the same folder with the same recording and method is continued.
    """
    out = Path(out)
    (out / MAPS).mkdir(parents=True, exist_ok=True)
    names = recording.frame_names
    if len({_stem(name) for name in names}) != len(names):
        raise InputError("two frames share a name but for its ending", where=recording.path,
                         remedy="Rename one: each frame's map is stored under its name.")  # fmt: skip
    workers = workers or os.cpu_count() or 1
    with _Journal(out / JOURNAL, _fingerprint(recording, reconstructor), out / MAPS) as journal:
        for result in _run(_still_to_do(recording, journal.done), reconstructor, out / MAPS, workers):
            journal.add(result)
            if progress is not None:
                progress(len(journal.done), len(names))
        rows = tuple(journal.done[name] for name in names)
        write_text(out / TABLE, _table(rows))
    (out / JOURNAL).unlink()
    return rows


def measure(height: HeightMap) -> tuple[float, float]:
    """Peak depth in mm, and the area in mm² of the regions that are pressed in beyond what noise explains.

    The peak is the 99.9th percentile of the valid depths, which one bad pixel cannot set. Pressed in: deeper
    than five robust standard deviations of the map's shallower half, and than 10 µm; specks below a tenth of the
    largest region do not count.
    """
    from skimage.measure import label

    depth = height.depth_mm[height.valid]
    if depth.size == 0:
        return float("nan"), float("nan")
    quiet = depth[depth <= np.median(depth)]
    noise = 1.4826 * float(np.median(np.abs(quiet - np.median(quiet))))
    pressed = height.valid & (height.depth_mm > max(5 * noise, 0.01))
    sizes = np.bincount(label(pressed, connectivity=1).ravel())[1:]
    pixels = sizes[sizes >= 0.1 * sizes.max()].sum() if sizes.size else 0
    return float(np.percentile(depth, 99.9)), float(pixels * height.mm_per_px[0] * height.mm_per_px[1])


_worker: tuple[Reconstructor, Path] | None = None


def _start_worker(reconstructor: Reconstructor, maps: Path) -> None:
    global _worker  # one per process: what every frame needs is sent once, not with each frame
    import cv2

    cv2.setNumThreads(1)
    _worker = (reconstructor, maps)


def _one(frame: Frame | BadFrame) -> FrameResult:
    assert _worker is not None
    reconstructor, maps = _worker
    if isinstance(frame, BadFrame):
        return FrameResult(frame.name, f"unreadable: {frame.why}")
    try:
        start = time.perf_counter()
        height = reconstructor.height_map(frame)
        spent = 1e3 * (time.perf_counter() - start)
        write_tiff(maps / f"{_stem(frame.name)}.tiff", height)
    except InputError as fault:
        return FrameResult(frame.name, f"rejected: {fault.what}")
    return FrameResult(frame.name, "ok", *measure(height), spent)


def _run(
    frames: Iterable[Frame | BadFrame], reconstructor: Reconstructor, maps: Path, workers: int
) -> Iterator[FrameResult]:
    """Results as they come; at most a few frames for each worker are in memory."""
    if workers == 1:
        _start_worker(reconstructor, maps)
        yield from map(_one, frames)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(reconstructor, maps)) as pool:
        pending: set[Future[FrameResult]] = set()
        for frame in frames:
            pending.add(pool.submit(_one, frame))
            if len(pending) >= 4 * workers:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        yield from (future.result() for future in pending)


def _still_to_do(recording: Recording, done: dict[str, FrameResult]) -> Iterator[Frame | BadFrame]:
    left = [row for row, name in enumerate(recording.frame_names) if name not in done]
    if left:
        names = tuple(recording.frame_names[row] for row in left)
        yield from iter_frames(replace(recording, frame_names=names, frame_times_s=recording.frame_times_s[left]))


class _Journal:
    """What is done so far, kept on disk row by row; forgotten when the recording or the method is another."""

    def __init__(self, path: Path, fingerprint: str, maps: Path) -> None:
        self.path = path
        self.done: dict[str, FrameResult] = {}
        with suppress(FileNotFoundError):
            self._read(fingerprint, maps)
        write_text(path, "".join([fingerprint, "\n", *map(_row, self.done.values())]))  # without a row cut off
        self.file = path.open("a", encoding="utf-8", newline="")

    def _read(self, fingerprint: str, maps: Path) -> None:
        lines = self.path.read_text(encoding="utf-8").split("\n")
        if lines[0] != fingerprint:
            return
        for row in csv.reader(lines[1:-1]):  # what follows the last newline was cut off in writing
            result = FrameResult(row[0], row[1], *(float(cell) for cell in row[2:]))
            if result.status != "ok" or (maps / f"{_stem(result.frame)}.tiff").exists():
                self.done[result.frame] = result

    def add(self, result: FrameResult) -> None:
        self.done[result.frame] = result
        self.file.write(_row(result))
        self.file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()


def _row(result: FrameResult) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(astuple(result))
    return text.getvalue()


def _fingerprint(recording: Recording, reconstructor: Reconstructor) -> str:
    """Of the recording and of the method: another way of reading frames gives the first frame another map."""
    digest = hashlib.sha256(json.dumps([str(recording.path.resolve()), *recording.frame_names]).encode())
    for frame in iter_frames(recording):
        if isinstance(frame, Frame):
            with suppress(InputError):
                digest.update(np.ascontiguousarray(reconstructor.height_map(frame).depth_mm).tobytes())
            break
    return digest.hexdigest()


def _stem(name: str) -> str:
    return Path(name).stem


def _table(rows: Iterable[FrameResult]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        numbers = (row.peak_mm, row.contact_area_mm2, row.ms)
        writer.writerow([row.frame, row.status, *("" if np.isnan(n) else f"{n:.4f}" for n in numbers)])
    return text.getvalue()
