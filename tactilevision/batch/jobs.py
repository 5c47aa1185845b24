"""Run a job on every frame on all cores, and resume it by the fingerprint of its inputs."""

from __future__ import annotations

import csv
import ctypes
import hashlib
import io
import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tactilevision.cluster.pool import ClusterPool, EndsWorkers, cluster_pool
from tactilevision.errors import InputError
from tactilevision.files.documents import read_text
from tactilevision.files.runs import join_lock, worker_pool
from tactilevision.files.writing import append_text, write_text
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame, HeightMap

# A worker writes the result of a frame whole, then enters the frame in the journal at once. So killing any process
# at any moment loses no frame, and a second run does only the rest, including the frames that workers were at.

Row = tuple[str, ...]
Timed = tuple[list[Row], float]  # rows of a task, and the seconds that it took
Progress = Callable[[int, int], None]
CHUNK = 16  # largest number of frames in a task
MIN_CHUNK = 4  # frames of a task in a short run, so that each worker has some
SHIPMENT = 4  # frames of the first tasks for a cluster, until the time of one is known
TASK_S = 1.0  # s of work in a task for a cluster: submitting it costs some ten milliseconds
MAX_SHIPMENT = 256  # largest number of frames in a task for a cluster
AHEAD = 3  # tasks queued for each worker
KEPT_BYTES = 31 << 20  # just below the 32 MB from which glibc maps every array anew (mallopt(3))
GLIBC_KEEPS = ((-3, KEPT_BYTES), (-1, 2 * KEPT_BYTES))  # M_MMAP_, M_TRIM_THRESHOLD: a Dask nanny sets low ones
FEW = 12  # frames done faster than a second process starts


class Job(Protocol):
    """Work on each frame; it is pickled and sent to every worker once.

    A call writes the frame's result whole and returns its row of text, the frame's name first, also for a frame
    that cannot be used.
    """

    @property
    def columns(self) -> int:
        """Number of cells of a row."""
        ...

    def __call__(self, frame: Frame | BadFrame, number: int) -> Row:
        """Compute one row; `number` is the frame's place among `Recording.frame_names`."""
        ...

    def kept(self, row: Row) -> bool:
        """Return whether what the row promises is still on disk.

        Raises InputError for a row that no call returned.
        """
        ...


@dataclass(frozen=True, slots=True)
class Journal:
    """File of finished frames: a fingerprint of the run, then one row of text for each frame."""

    path: Path
    fingerprint: str

    def read(self, job: Job) -> dict[str, Row]:
        """Read rows of an earlier run of this fingerprint, by frame; a row cut off in writing is skipped."""
        try:
            lines = read_text(self.path).split("\n")
            rows = [tuple(row) for row in csv.reader(lines[1:-1])]
        except (OSError, InputError, csv.Error):
            return {}
        if lines[0] != self.fingerprint:
            return {}
        return {row[0]: row for row in rows if len(row) == job.columns and _holds(job, row)}

    def begin(self, done: dict[str, Row]) -> None:
        """Write the journal anew with the valid rows."""
        write_text(self.path, self.fingerprint + "\n" + "".join(map(as_line, done.values())))

    def add(self, row: Row) -> None:
        """Append one row; many processes may do so at a time."""
        append_text(self.path, as_line(row))

    def end(self) -> None:
        """Delete the journal: the results are in place."""
        self.path.unlink(missing_ok=True)


def _holds(job: Job, row: Row) -> bool:
    try:
        return job.kept(row)
    except (OSError, InputError):  # damaged: a name that is too long, or text for a number
        return False


def run_job(
    recording: Recording,
    job: Job,
    *,
    journal: Journal,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
    begin: Callable[[], None] | None = None,
) -> list[Row]:
    """Compute every frame's row in the order of the frames; those in the journal are not computed again.

    `begin` is called first unless an earlier run is resumed. `progress` is called with the frames of the earlier
    run, then after each frame. `cluster` is the address of a Dask scheduler, or its file: its workers see the same
    folders, and only this process writes the journal.
    """
    done = journal.read(job)
    if not done:
        journal.end()  # its rows belong to another run's scratch
        if begin is not None:
            begin()
    journal.begin(done)
    names = recording.frame_names
    left = [number for number, name in enumerate(names) if name not in done]
    report = progress or (lambda done, total: None)
    report(len(done), len(names))
    bare = _bare(recording)
    rows = (
        _rows(bare, left, (job, journal), workers or os.cpu_count() or 1)
        if cluster is None
        else _rows_of_cluster(bare, left, job, cluster)
    )
    for row in rows:
        if cluster is not None:
            journal.add(row)
        done[row[0]] = row
        report(len(done), len(names))
    return [done[name] for name in names]


def way_of_reading(recording: Recording, height_map: Callable[[Frame], HeightMap]) -> str:
    """Hash the first frame's map (H, W), in mm: another method or calibration gives another hash."""
    numbers = range(len(recording.frame_names))
    frame = next((frame for frame in _frames(recording, numbers) if isinstance(frame, Frame)), None)
    if frame is not None:
        with suppress(InputError):
            return hashlib.sha256(np.ascontiguousarray(height_map(frame).depth_mm).tobytes()).hexdigest()
    return ""


def as_line(row: Row) -> str:
    """Return a row as a line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(row)
    return text.getvalue()


_at_work: tuple[Recording, Job, Journal | None] | None = None  # of this process: sent once, not with each frame


def _start_worker(recording: Recording, job: Job, journal: Journal) -> None:
    global _at_work
    if not join_lock(journal.path.parent):
        os._exit(1)  # the parent has ended, and another run may have the lock
    _on_one_thread()
    _at_work = recording, job, journal


def _start_on_cluster(recording: Recording, job: Job) -> None:
    global _at_work
    _on_one_thread()
    _at_work = recording, job, None


def _on_one_thread() -> None:
    """Use one thread, and keep the memory of one frame for the next: else glibc maps and clears every array
    anew.
    """
    import cv2

    cv2.setNumThreads(1)
    with suppress(OSError, AttributeError, TypeError):  # another system's C library
        for name, size in GLIBC_KEEPS:
            ctypes.CDLL(None).mallopt(name, size)


def _read_and_do(numbers: list[int]) -> list[Row]:
    assert _at_work is not None
    recording, job, journal = _at_work
    frames = _frames(recording, numbers)
    return [_do(number, frame, job, journal) for number, frame in zip(numbers, frames, strict=True)]


def _frames(recording: Recording, numbers: Iterable[int]) -> Iterator[Frame | BadFrame]:
    """Yield the frames of these numbers; one of another kind or size, or beyond a limit, is a bad one alone."""
    left = deque(numbers)
    while left:
        try:
            for frame in iter_frames(_part(recording, list(left))):
                yield frame
                left.popleft()
        except InputError as fault:
            number = left.popleft()
            yield BadFrame(recording.frame_names[number], float(recording.frame_times_s[number]), fault.what)


def _do(number: int, frame: Frame | BadFrame, job: Job, journal: Journal | None) -> Row:
    row = job(frame, number)
    if journal is not None:
        journal.add(row)
    return row


def _rows(recording: Recording, left: list[int], what: tuple[Job, Journal], workers: int) -> Iterator[Row]:
    if not left:
        return
    if workers == 1 or len(left) <= FEW:
        _on_one_thread()
        for number, frame in zip(left, _frames(recording, left), strict=True):
            yield _do(number, frame, *what)
        return
    with worker_pool(min(workers, -(-len(left) // MIN_CHUNK)), _start_worker, recording, *what) as pool:
        tasks = _tasks(pool, recording, left, chunk=_chunk(len(left), workers))
        pending = set(islice(tasks, AHEAD * workers))
        while pending:
            ready, pending = wait(pending, return_when=FIRST_COMPLETED)
            pending |= set(islice(tasks, len(ready)))
            for one in ready:
                yield from one.result()


def _rows_of_cluster(recording: Recording, left: list[int], job: Job, cluster: str) -> Iterator[Row]:
    """Yield rows from the cluster.

    Frames whose task ended its workers are tried once more, each alone, then named.
    """
    if not left:
        return
    frames_path = recording.frames_path and recording.frames_path.absolute()
    recording = replace(recording, path=recording.path.absolute(), frames_path=frames_path)
    with cluster_pool(cluster, _start_on_cluster, recording, job) as pool:
        flight = _Flight()
        for numbers, future in _shipments(pool, recording, left, flight=flight):
            flight.pending[future] = numbers
            while len(flight.pending) >= AHEAD * pool.width:
                yield from flight.landed()
        while flight.pending:
            yield from flight.landed()
        for number in sorted(flight.suspects):
            ((_, alone),) = _shipments(pool, recording, [number], flight=flight)
            try:
                yield from alone.result()[0]
            except EndsWorkers:
                why = "it ended every process that worked on it"
                yield job(
                    BadFrame(recording.frame_names[number], float(recording.frame_times_s[number]), why), number
                )


@dataclass
class _Flight:
    """Submitted tasks, frames whose task ended its workers, and the number of frames in a task of TASK_S."""

    pending: dict[Future[Timed], list[int]] = field(default_factory=dict)
    suspects: list[int] = field(default_factory=list)
    size: int = SHIPMENT

    def landed(self) -> Iterator[Row]:
        """Return rows of the tasks that are done, one at least."""
        for future in wait(self.pending, return_when=FIRST_COMPLETED).done:
            numbers = self.pending.pop(future)
            try:
                rows, seconds = future.result()
            except EndsWorkers:
                self.suspects.extend(numbers)
            else:
                self.size = min(max(1, int(TASK_S * len(rows) / seconds)), 2 * self.size, MAX_SHIPMENT)
                yield from rows


def _shipments(
    pool: ClusterPool, recording: Recording, left: list[int], *, flight: _Flight
) -> Iterator[tuple[list[int], Future[Timed]]]:
    """Yield tasks: pictures are read by the workers themselves; of a video each frame is sent."""
    assert recording.frames_path is not None
    if recording.frames_path.is_dir():
        rest = deque(left)
        while rest:
            numbers = [rest.popleft() for _ in range(min(flight.size, len(rest)))]
            yield numbers, pool.submit(_timed, _read_and_do, numbers)
        return
    for number, frame in zip(left, _frames(recording, left), strict=True):
        yield [number], pool.submit(_timed, _do_all, number, frame)


def _timed(do: Callable[..., list[Row]], *given: Any) -> Timed:
    start = time.perf_counter()
    return do(*given), time.perf_counter() - start


def _chunk(count: int, workers: int) -> int:
    """Return the number of frames of a task, so that workers end at about the same time."""
    return min(max(MIN_CHUNK, count // (4 * workers)), CHUNK)


def _tasks(pool: Executor, recording: Recording, left: list[int], *, chunk: int) -> Iterator[Future[list[Row]]]:
    """Return tasks: pictures are read by the workers themselves; a video can be read by one process only."""
    assert recording.frames_path is not None
    if recording.frames_path.is_dir():
        for start in range(0, len(left), chunk):
            yield pool.submit(_read_and_do, left[start : start + chunk])
        return
    for number, frame in zip(left, _frames(recording, left), strict=True):
        yield pool.submit(_do_all, number, frame)


def _do_all(number: int, frame: Frame | BadFrame) -> list[Row]:
    assert _at_work is not None
    _, job, journal = _at_work
    return [_do(number, frame, job, journal)]


def _part(recording: Recording, numbers: list[int]) -> Recording:
    names = tuple(recording.frame_names[number] for number in numbers)
    return replace(recording, frame_names=names, frame_times_s=recording.frame_times_s[np.array(numbers)])


def _bare(recording: Recording) -> Recording:
    """Return the recording without what no frame needs: it travels to every worker."""
    return replace(recording, indenters={}, presses=(), forces=None, stage=None, curves=(), points=(), extra={},
                   settings={}, warnings=())  # fmt: skip


def fingerprint_of(recording: Recording, *parts: object) -> str:
    """Hash the recording's place and frames, and what else determines the result."""
    about = [str(recording.path.resolve()), *recording.frame_names, *file_states(recording), *map(repr, parts)]
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()


def file_states(recording: Recording) -> Iterator[str]:
    """Return size and time of every picture, or of the video, so that a changed one is computed again."""
    path, names = recording.frames_path, recording.frame_names
    pictures = () if path is None else [path / name for name in names] if path.is_dir() else [path]
    for file in (*pictures, *recording.flats):
        try:
            about = file.stat()
        except OSError:
            yield "gone"
        else:
            yield f"{about.st_size} {about.st_mtime_ns}"
