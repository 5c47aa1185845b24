"""A folder of JPEGs into height maps: one core against its parts, two processes, a local cluster of two workers.

python -m benchmarks.folder [frames] [frames of the memory run]
Prints ratios, which hold on any machine that does nothing else meanwhile; OPENBLAS_NUM_THREADS=1 for one core.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import tifffile

from benchmarks.stream import DEPTHS_MM, resident_kB
from benchmarks.vision import QUALITY, calibrated
from tactilevision.batch import folder as batch
from tactilevision.batch.folder import DepthJob, Form, reconstruct_folder
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording import pictures as reading
from tactilevision.recording.model import Recording
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.punch import PunchPress, punch_profile

WIDTH_PX, HEIGHT_PX = 427, 320
FRAMES = 400  # timed: some seconds
TURNS = 3  # runs that are added up
FORMS: tuple[Form, ...] = ("tiff", "zarr")
PARTS = {"decode": (reading, "read_image"), "map": (Reconstructor, "height_map"), "write": (DepthJob, "keep")}
Spent = tuple[float, float]  # seconds by the clock, seconds of processors
MANY = 4000  # for the memory: several times what any buffer holds


def main(arguments: Sequence[str] = ()) -> None:
    count, many = (*map(int, arguments), *(FRAMES, MANY)[len(arguments) :])
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        recording, reconstructor = _folder_of_jpegs(place, count)
        busy = f"{os.getloadavg()[0]:.1f} processes on {os.cpu_count()} cores"
        one = _timed(lambda: reconstruct_folder(recording, reconstructor, place / "one", workers=1))
        two = _timed(lambda: reconstruct_folder(recording, reconstructor, place / "two", workers=2))
        _compare("two processes, with their start", one, two)  # before zarr and dask, which start threads
        for form in FORMS:
            _against_parts(recording, reconstructor, place, form=form)
        _compare("two workers of a cluster", one, _on_cluster(recording, reconstructor, place))
        print(f"machine before these: {busy}, after them {os.getloadavg()[0]:.1f}")
        _memory(recording, reconstructor, place / "many", many)


def _folder_of_jpegs(folder: Path, count: int) -> tuple[Recording, Reconstructor]:
    camera, reconstructor = calibrated((WIDTH_PX, HEIGHT_PX), 2, "polynomial", jpeg=True)
    profile = punch_profile(0.48, 2.5, 3.0)
    (folder / "frames").mkdir()
    names = tuple(f"{number:06d}.jpg" for number in range(count))
    for number, name in enumerate(names):
        depth_mm = DEPTHS_MM[number % len(DEPTHS_MM)]
        scene = PunchPress(profile, depth_mm, (1.0, -0.7)) if depth_mm else Flat()
        rgb = camera.picture(scene, np.random.default_rng(number))
        cv2.imwrite(str(folder / "frames" / name), rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    times = np.arange(count) / 30
    recording = Recording(
        folder,
        "jpegs",
        reconstructor.sensor,
        frames_path=folder / "frames",
        frame_names=names,
        frame_times_s=times,
    )
    return recording, reconstructor


def _against_parts(recording: Recording, reconstructor: Reconstructor, place: Path, *, form: Form) -> None:
    """The command's loop, and what of it is decoding, maps and files: processor time of one run, on one core."""
    spent = dict.fromkeys((*PARTS, "figures"), 0.0)
    with _on_one_core(), ExitStack() as watched:
        reconstruct_folder(recording, reconstructor, place / f"{form} warm", workers=1, form=form)
        for part, (owner, name) in PARTS.items():
            watched.enter_context(_watched(owner, name, part, spent=spent))
        for name in ("find_contact", "measure", "std_at", "contact_flags"):
            watched.enter_context(_watched(batch, name, "figures", spent=spent))
        start = time.process_time()
        for turn in range(TURNS):
            reconstruct_folder(recording, reconstructor, place / f"{form}{turn}", workers=1, form=form)
        whole = time.process_time() - start
    frames = TURNS * len(recording.frame_names)
    parts = sum(spent[part] for part in PARTS)
    plain = _plainly(recording, reconstructor, place / f"{form} plain")
    told = ", ".join(f"{name} {1e3 * s / frames:.2f}" for name, s in (spent | {"all in all": whole}).items())
    print(f"{form}, ms a frame: {told}")
    print(f"  all in all {whole / parts:.3f} of decode, map and write, ", end="")
    print(f"{whole / (parts + spent['figures']):.3f} with the figures of depth.csv, ", end="")
    print(f"{whole / (TURNS * plain):.3f} of a plain loop with the figures")


def _plainly(recording: Recording, reconstructor: Reconstructor, out: Path) -> float:
    """The processor time of a plain loop over the frames: decode, map, figures, a TIFF by tifffile."""
    assert recording.frames_path is not None
    out.mkdir()
    with _on_one_core():
        start = time.process_time()
        for name in recording.frame_names:
            bgr = np.asarray(cv2.imread(str(recording.frames_path / name)))
            height = reconstructor.height_map(np.ascontiguousarray(bgr[..., ::-1]))
            contact = find_contact(height, reconstructor.error)
            peak_mm, _ = batch.measure(height, contact)
            contact_flags(contact, reconstructor.error)
            batch.std_at(height, peak_mm)
            tifffile.imwrite(out / f"{name}.tiff", np.where(height.valid, height.depth_mm, np.nan))
        return time.process_time() - start


@contextmanager
def _watched(owner: Any, name: str, part: str, *, spent: dict[str, float]) -> Iterator[None]:
    """Add the processor time of each call, in whatever thread, to `spent` on that part."""
    plain = getattr(owner, name)

    def timed(*given: Any, **named: Any) -> Any:
        start = time.thread_time()
        try:
            return plain(*given, **named)
        finally:
            spent[part] += time.thread_time() - start

    with patch.object(owner, name, timed):
        yield


@contextmanager
def _on_one_core() -> Iterator[None]:
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _on_cluster(recording: Recording, reconstructor: Reconstructor, place: Path) -> Spent:
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local, Client(local) as client:
        at = local.scheduler_address
        reconstruct_folder(recording, reconstructor, place / "warm", cluster=at)
        before = sum(client.run(time.process_time).values())
        seconds, here = _timed(lambda: reconstruct_folder(recording, reconstructor, place / "cl", cluster=at))
        return seconds, here + sum(client.run(time.process_time).values()) - before


def _memory(recording: Recording, reconstructor: Reconstructor, out: Path, many: int) -> None:
    """The same pictures by many names: links, so that the disk holds them once."""
    names = tuple(f"{number:06d}_again.jpg" for number in range(many))
    assert recording.frames_path is not None
    for number, name in enumerate(names):
        (recording.frames_path / name).symlink_to(recording.frame_names[number % len(recording.frame_names)])
    told: dict[int, int] = {}

    def look(done: int, total: int) -> None:
        if done in (many // 10, many // 2, many):
            told[done] = resident_kB()

    again = Recording(
        recording.path,
        "many",
        recording.sensor,
        frames_path=recording.frames_path,
        frame_names=names,
        frame_times_s=np.arange(many) / 30,
    )
    reconstruct_folder(again, reconstructor, out, workers=1, progress=look)
    first, *_, last = told.values()
    grown = ", ".join(f"{done}: {kB} kB" for done, kB in told.items())
    print(f"memory after frames {grown}; {1024 * (last - first) / (many * 9 / 10):.0f} bytes a frame")


def _compare(name: str, one: Spent, other: Spent) -> None:
    """Times one process, by the clock; beside it the processor time of all, which a busy machine spoils less."""
    (one_s, one_cpu_s), (other_s, other_cpu_s) = one, other
    print(f"{name}: {one_s / other_s:.2f} times one ({other_s:.1f} s, one {one_s:.1f} s); ", end="")
    most = 2 * one_cpu_s / other_cpu_s
    print(f"processor time {other_cpu_s:.2f} s, one {one_cpu_s:.2f} s, so at most {most:.2f} times")


def _timed(act: Callable[[], object]) -> Spent:
    start, before = time.perf_counter(), os.times()
    act()
    after = os.times()
    return time.perf_counter() - start, sum(after[:4]) - sum(before[:4])


def quick() -> None:
    main(["10", "20"])


if __name__ == "__main__":
    main(sys.argv[1:])
