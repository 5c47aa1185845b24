"""Run a job on every frame on all cores, and resume it by the fingerprint of its inputs."""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from tactilevision.cluster.connect import check_cluster
from tactilevision.cluster.pool import EndsWorkers, cluster_pool
from tactilevision.errors import InputError
from tactilevision.files.documents import read_text
from tactilevision.files.opening import real_path
from tactilevision.files.runs import join_lock, output_lock, worker_pool
from tactilevision.files.writing import append_text, remove, write_text
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame, HeightMap

# A worker writes the result of a frame whole, then enters the frame in the journal at once. So killing any process
# at any moment loses no frame, and a second run does only the rest, including frames that workers were at. Of a
# cluster's frames this process writes the journal.

Progress = Callable[[int, int], None]
T = TypeVar("T")
FIRST = 4  # frames of the first tasks, until the time of one is known
TASK_S = 1.0  # s of work in a task: submitting it to a cluster costs some ten milliseconds
MOST = 256  # largest number of frames in a task
AHEAD = 3  # tasks queued for each worker
KEPT_BYTES = 31 << 20  # just below the 32 MB from which glibc maps every array anew (mallopt(3))
GLIBC_KEEPS = ((-3, KEPT_BYTES), (-1, 2 * KEPT_BYTES))  # M_MMAP_, M_TRIM_THRESHOLD: a Dask nanny sets low ones
FEW = 12  # frames done faster than a second process starts


class Result(Protocol):
    """Record of one frame: a dataclass of words, numbers and tuples of them."""

    @property
    def frame(self) -> str:
        """The frame's name."""


R = TypeVar("R", bound=Result)


class Job(Protocol[R]):
    """Work on each frame; it is pickled and sent to every worker once.

    A call writes what it computes whole and returns its record, also for a frame that cannot be used.
    """

    @property
    def out(self) -> Path:
        """Folder of the results."""

    @property
    def reconstructor(self) -> Reconstructor:
        """What reads the frames."""

    @property
    def record(self) -> type[R]:
        """Class of the records."""

    @property
    def journal(self) -> str:
        """Name of the journal in the folder."""

    def decides(self) -> tuple[object, ...]:
        """Return what determines a result besides the frame and its height map."""

    def prepare(self, names: Sequence[str], *, anew: bool) -> None:
        """Clean up after killed runs; where nothing is resumed, `anew`, make an empty place for the results."""

    def __call__(self, frame: Frame | BadFrame, number: int) -> R:
        """Compute one result; `number` is the frame's place among `Recording.frame_names`."""

    def records(self, frames: Iterable[Frame | BadFrame], numbers: Iterable[int]) -> Iterator[R]:
        """Compute the results of frames in order, one by one or several at once."""

    def kept(self, result: R) -> bool:
        """Return whether what the record promises is still on disk."""


@dataclass(frozen=True, slots=True)
class Journal:
    """File of finished frames: a fingerprint of the run, then one record in JSON for each frame."""

    path: Path
    fingerprint: str

    def read(self, record: type[R], kept: Callable[[R], bool] = lambda result: True) -> dict[str, R]:
        """Read records of an earlier run of this fingerprint, by frame; one cut off in writing is skipped."""
        try:
            fingerprint, *lines = read_text(self.path).split("\n")
        except (OSError, InputError):
            return {}
        found: dict[str, R] = {}
        for line in lines[:-1] if fingerprint == self.fingerprint else ():
            with suppress(OSError, ValueError, TypeError, AttributeError):  # damaged
                if kept(result := _restored(record, line)):
                    found[result.frame] = result
        return found

    def begin(self, done: Iterable[Result]) -> None:
        """Write the journal anew with the valid records."""
        write_text(self.path, self.fingerprint + "\n" + "".join(map(as_line, done)))

    def add(self, result: Result) -> None:
        """Append one record; many processes may do so at a time."""
        append_text(self.path, as_line(result))

    def end(self) -> None:
        """Delete the journal: the results are in place."""
        remove(self.path)


def as_line(result: Any) -> str:
    """Return a record as a line of JSON."""
    return json.dumps(asdict(result)) + "\n"


def _restored(record: type[R], line: str) -> R:
    """Return the record of a line; raise ValueError, TypeError or AttributeError where it is damaged."""
    parts = {name: tuple(one) if isinstance(one, list) else one for name, one in json.loads(line).items()}
    result, kinds = record(**parts), {"str": str, "float": float, "bool": bool}
    for part in fields(result):  # type: ignore[arg-type]  # a dataclass
        if not isinstance(getattr(result, part.name), kinds.get(str(part.type), tuple)):
            raise TypeError(part.name)
    return result


def run_job(
    recording: Recording,
    job: Job[R],
    *,
    end: Callable[[list[R]], T],
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> T:
    """Compute every frame's record, and return what `end` makes of them in the order of the frames.

    Those in the journal of an unfinished run with the same result are not computed again. `progress` is called
    with the frames of the earlier run, then after each frame. `workers` is the number of processes (None: one a
    core); `cluster` the address of a Dask scheduler, or its file, whose workers see the same folders.
    """
    if cluster is not None:
        check_cluster(cluster)
    with output_lock(job.out):
        seen = way_of_reading(recording, job.reconstructor.height_map)
        journal = Journal(job.out / job.journal, fingerprint_of(recording, seen, *job.decides()))
        done = journal.read(job.record, job.kept)
        if not done:
            journal.end()  # its records belong to another run's scratch
        job.prepare(recording.frame_names, anew=not done)
        journal.begin(done.values())
        names = recording.frame_names
        left = [number for number, name in enumerate(names) if name not in done]
        report = progress or (lambda done, total: None)
        report(len(done), len(names))
        for result in _results(_bare(recording), left, job, journal, workers=workers, cluster=cluster):
            done[result.frame] = result
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


# of this process: sent once, not with each frame
_at_work: tuple[Recording, Job[Any], Journal | None] | None = None


def _start_worker(recording: Recording, job: Job[Any], journal: Journal | None) -> None:
    global _at_work
    if journal is not None and not join_lock(job.out):
        os._exit(1)  # the parent has ended, and another run may have the lock
    _on_one_thread()
    _at_work = recording, job, journal


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


def _results(
    recording: Recording,
    left: list[int],
    job: Job[R],
    journal: Journal,
    *,
    workers: int | None,
    cluster: str | None,
) -> Iterator[R]:
    """Yield the records of the frames `left`, as they are done and in the journal.

    Frames whose task ended its workers are tried once more, each alone, then named.
    """
    if not left:
        return
    count = min(workers or os.cpu_count() or 1, -(-len(left) // FIRST))
    if cluster is None and (count == 1 or len(left) <= FEW):
        _on_one_thread()
        for result in job.records(_frames(recording, left), left):
            journal.add(result)
            yield result
        return
    with ExitStack() as stack:
        if cluster is None:
            local = stack.enter_context(worker_pool(count, _start_worker, recording, job, journal))
            tasks = _Tasks(local, recording, job, lambda: count)
        else:
            frames_path = recording.frames_path and recording.frames_path.absolute()
            recording = replace(recording, path=recording.path.absolute(), frames_path=frames_path)
            remote = stack.enter_context(cluster_pool(cluster, _start_worker, recording, job, None))
            tasks = _Tasks(remote, recording, job, lambda: remote.width)
        for result in tasks.results(left):
            if cluster is not None:
                journal.add(result)
            yield result


@dataclass
class _Tasks(Generic[R]):
    """Submitted tasks, frames whose task ended its workers, and the number of frames in a task of TASK_S."""

    pool: Executor
    recording: Recording
    job: Job[R]
    width: Callable[[], int]  # number of workers
    pending: dict[Future[tuple[list[R], float]], list[int]] = field(default_factory=dict)
    suspects: list[int] = field(default_factory=list)
    size: int = FIRST

    def results(self, left: list[int]) -> Iterator[R]:
        """Yield the records of the frames `left`."""
        for numbers, frames in self.parts(left):
            self.pending[self.pool.submit(_do, numbers, frames)] = numbers
            while len(self.pending) >= AHEAD * self.width():
                yield from self.finished()
        while self.pending:
            yield from self.finished()
        for number in sorted(self.suspects):
            ((numbers, frames),) = self.parts([number])
            try:
                yield from self.pool.submit(_do, numbers, frames).result()[0]
            except EndsWorkers:
                yield self.job(_bad(self.recording, number, "it ended every process that worked on it"), number)

    def parts(self, left: list[int]) -> Iterator[tuple[list[int], list[Frame | BadFrame] | None]]:
        """Yield tasks: pictures are read by the workers themselves; of a video each frame is sent."""
        assert self.recording.frames_path is not None
        if not self.recording.frames_path.is_dir():
            for number, frame in zip(left, _frames(self.recording, left), strict=True):
                yield [number], [frame]
            return
        rest = deque(left)
        while rest:  # smaller towards the end, so that workers end at about the same time
            size = min(self.size, -(-len(rest) // (2 * self.width())))
            yield [rest.popleft() for _ in range(size)], None

    def finished(self) -> Iterator[R]:
        """Yield the records of the tasks that are done, one at least."""
        for future in wait(self.pending, return_when=FIRST_COMPLETED).done:
            numbers = self.pending.pop(future)
            try:
                done, seconds = future.result()
            except EndsWorkers:
                self.suspects.extend(numbers)
            else:
                self.size = min(max(1, int(TASK_S * len(done) / seconds)), 2 * self.size, MOST)
                yield from done


def _do(numbers: list[int], frames: list[Frame | BadFrame] | None) -> tuple[list[Any], float]:
    """Return the records of the frames of these numbers, and the seconds that they took."""
    assert _at_work is not None
    recording, job, journal = _at_work
    start, done = time.perf_counter(), []
    for result in job.records(_frames(recording, numbers) if frames is None else frames, numbers):
        if journal is not None:
            journal.add(result)
        done.append(result)
    return done, time.perf_counter() - start


def _part(recording: Recording, numbers: list[int]) -> Recording:
    names = tuple(recording.frame_names[number] for number in numbers)
    return replace(recording, frame_names=names, frame_times_s=recording.frame_times_s[np.array(numbers)])


def _bare(recording: Recording) -> Recording:
    """Return the recording without what no frame needs: it travels to every worker."""
    return replace(recording, indenters={}, presses=(), forces=None, stage=None, curves=(), points=(), extra={},
                   settings={}, warnings=())  # fmt: skip


def fingerprint_of(recording: Recording, *parts: object) -> str:
    """Hash the recording's place and frames, and what else determines the result."""
    about = [str(real_path(recording.path)), *recording.frame_names, *file_states(recording), *map(repr, parts)]
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
