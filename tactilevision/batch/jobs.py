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
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from tactilevision.cluster.connect import check_cluster
from tactilevision.cluster.pool import EndsWorkers, cluster_pool
from tactilevision.errors import InputError
from tactilevision.files.documents import read_text
from tactilevision.files.runs import join_lock, output_lock, worker_pool
from tactilevision.files.writing import append_text, write_text
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame, HeightMap

# A worker writes the result of each frame whole, and this process enters the frames of a finished task in the
# journal. So killing any process at any moment loses no frame, and a second run does only the rest, including the
# frames that workers were at.

Row = tuple[str, ...]
Timed = tuple[list[Row], float]  # rows of a task, and the seconds that it took
Progress = Callable[[int, int], None]
T = TypeVar("T")
FIRST = 4  # frames of the first tasks, until the time of one is known
TASK_S = 1.0  # s of work in a task: submitting it to a cluster costs some ten milliseconds
MOST = 256  # largest number of frames in a task
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
    def out(self) -> Path:
        """Folder of the results."""
        ...

    @property
    def reconstructor(self) -> Reconstructor:
        """What reads the frames."""
        ...

    @property
    def columns(self) -> int:
        """Number of cells of a row."""
        ...

    @property
    def journal(self) -> str:
        """Name of the journal in the folder."""
        ...

    def decides(self) -> tuple[object, ...]:
        """Return what determines a result besides the frame and its height map."""
        ...

    def prepare(self, names: Sequence[str], *, anew: bool) -> None:
        """Clean up after killed runs; where nothing is resumed, `anew`, make an empty place for the results."""
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
    end: Callable[[list[Row]], T],
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> T:
    """Compute every frame's row, and return what `end` makes of them in the order of the frames.

    Those in the journal of an unfinished run with the same result are not computed again. `progress` is called
    with the frames of the earlier run, then after each frame. `workers` is the number of processes (None: one a
    core); `cluster` the address of a Dask scheduler, or its file, whose workers see the same folders.
    """
    if cluster is not None:
        check_cluster(cluster)
    with output_lock(job.out):
        seen = way_of_reading(recording, job.reconstructor.height_map)
        journal = Journal(job.out / job.journal, fingerprint_of(recording, seen, *job.decides()))
        done = journal.read(job)
        if not done:
            journal.end()  # its rows belong to another run's scratch
        job.prepare(recording.frame_names, anew=not done)
        journal.begin(done)
        names = recording.frame_names
        left = [number for number, name in enumerate(names) if name not in done]
        report = progress or (lambda done, total: None)
        report(len(done), len(names))
        for row in _rows(_bare(recording), left, job, workers=workers, cluster=cluster):
            journal.add(row)
            done[row[0]] = row
            report(len(done), len(names))
        made = end([done[name] for name in names])
        journal.end()
        return made


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


_at_work: tuple[Recording, Job] | None = None  # of this process: sent once, not with each frame


def _start_worker(recording: Recording, job: Job, shares_lock: bool) -> None:
    global _at_work
    if shares_lock and not join_lock(job.out):
        os._exit(1)  # the parent has ended, and another run may have the lock
    _on_one_thread()
    _at_work = recording, job


def _on_one_thread() -> None:
    """Use one thread, and keep the memory of one frame for the next: else glibc maps and clears every array
    anew.
    """
    import cv2

    cv2.setNumThreads(1)
    with suppress(OSError, AttributeError, TypeError):  # another system's C library
        for name, size in GLIBC_KEEPS:
            ctypes.CDLL(None).mallopt(name, size)


def _frames(recording: Recording, numbers: Iterable[int]) -> Iterator[Frame | BadFrame]:
    """Yield the frames of these numbers; one of another kind or size, or beyond a limit, is a bad one alone."""
    left = deque(numbers)
    while left:
        try:
            for frame in iter_frames(_part(recording, list(left))):
                yield frame
                left.popleft()
        except InputError as fault:
            yield _bad(recording, left.popleft(), fault.what)


def _bad(recording: Recording, number: int, why: str) -> BadFrame:
    return BadFrame(recording.frame_names[number], float(recording.frame_times_s[number]), why)


def _rows(
    recording: Recording, left: list[int], job: Job, *, workers: int | None, cluster: str | None
) -> Iterator[Row]:
    """Yield the rows of the frames `left`, as they are done.

    Frames whose task ended its workers are tried once more, each alone, then named.
    """
    if not left:
        return
    count = min(workers or os.cpu_count() or 1, -(-len(left) // FIRST))
    if cluster is None and (count == 1 or len(left) <= FEW):
        _on_one_thread()
        yield from map(job, _frames(recording, left), left)
        return
    with _take_off(recording, job, count, cluster) as flight:
        for numbers, given in flight.parts(left):
            flight.send(numbers, given)
            while len(flight.pending) >= AHEAD * flight.width():
                yield from flight.landed()
        while flight.pending:
            yield from flight.landed()
        for number in sorted(flight.suspects):
            ((_, given),) = flight.parts([number])
            try:
                yield from flight.send([number], given).result()[0]
            except EndsWorkers:
                yield job(_bad(recording, number, "it ended every process that worked on it"), number)


@contextmanager
def _take_off(recording: Recording, job: Job, count: int, cluster: str | None) -> Iterator[_Flight]:
    """Start `count` processes here, or connect to a cluster."""
    if cluster is None:
        with worker_pool(count, _start_worker, recording, job, True) as local:
            yield _Flight(local, recording, lambda: count)
        return
    frames_path = recording.frames_path and recording.frames_path.absolute()
    recording = replace(recording, path=recording.path.absolute(), frames_path=frames_path)
    with cluster_pool(cluster, _start_worker, recording, job, False) as remote:
        yield _Flight(remote, recording, lambda: remote.width)


@dataclass
class _Flight:
    """Submitted tasks, frames whose task ended its workers, and the number of frames in a task of TASK_S."""

    pool: Executor
    recording: Recording
    width: Callable[[], int]  # number of workers
    pending: dict[Future[Timed], list[int]] = field(default_factory=dict)
    suspects: list[int] = field(default_factory=list)
    size: int = FIRST

    def parts(self, left: list[int]) -> Iterator[tuple[list[int], list[Frame | BadFrame] | None]]:
        """Yield tasks: pictures are read by the workers themselves; of a video each frame is sent."""
        assert self.recording.frames_path is not None
        if not self.recording.frames_path.is_dir():
            for number, frame in zip(left, _frames(self.recording, left), strict=True):
                yield [number], [frame]
            return
        rest = deque(left)
        while rest:
            size = min(
                self.size, -(-len(rest) // (2 * self.width()))
            )  # so that workers end at about the same time
            yield [rest.popleft() for _ in range(size)], None

    def send(self, numbers: list[int], frames: list[Frame | BadFrame] | None) -> Future[Timed]:
        """Submit the frames of these numbers; those of a folder are read by the worker."""
        future = self.pool.submit(_do, numbers, frames)
        self.pending[future] = numbers
        return future

    def landed(self) -> Iterator[Row]:
        """Return rows of the tasks that are done, one at least."""
        for future in wait(self.pending, return_when=FIRST_COMPLETED).done:
            numbers = self.pending.pop(future)
            try:
                rows, seconds = future.result()
            except EndsWorkers:
                self.suspects.extend(numbers)
            else:
                self.size = min(max(1, int(TASK_S * len(rows) / seconds)), 2 * self.size, MOST)
                yield from rows


def _do(numbers: list[int], frames: list[Frame | BadFrame] | None) -> Timed:
    assert _at_work is not None
    recording, job = _at_work
    start = time.perf_counter()
    rows = list(map(job, _frames(recording, numbers) if frames is None else frames, numbers))
    return rows, time.perf_counter() - start


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
