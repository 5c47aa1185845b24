"""A folder of JPEGs into height maps: one core against its parts, two processes, a local cluster of two workers.

python -m benchmarks.folder [frames] [frames of the memory run]
Prints ratios, which hold on any machine that does nothing else meanwhile; OPENBLAS_NUM_THREADS=1 for one core.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.stream import DEPTHS_MM, resident_kB
from benchmarks.vision import calibrated
from tactilevision.batch.folder import DepthJob, reconstruct_folder
from tactilevision.reconstruct import Reconstructor
from tactilevision.recording import Recording, iter_frames
from tactilevision.records import Frame
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.profile import punch_profile
from tactilevision.synthetic.punch import PunchPress

WIDTH_PX, HEIGHT_PX = 427, 320
QUALITY = 95  # of the JPEGs, as cameras write them
FRAMES = 400  # timed: some seconds
MANY = 4000  # for the memory: several times what any buffer holds


def main(arguments: Sequence[str] = ()) -> None:
    count, many = (*map(int, arguments), *(FRAMES, MANY)[len(arguments) :])
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        recording, reconstructor = _folder_of_jpegs(place, count)
        parts = _parts(recording, reconstructor, place / "parts")
        print("ms a frame: " + ", ".join(f"{name} {1e3 * spent / count:.2f}" for name, spent in parts.items()))
        one = _timed(lambda: reconstruct_folder(recording, reconstructor, place / "one", workers=1))
        print(f"one process: {1e3 * one / count:.2f} ms a frame, {one / sum(parts.values()):.3f} of its parts")
        two = _timed(lambda: reconstruct_folder(recording, reconstructor, place / "two", workers=2))
        print(f"two processes, with their start: {one / two:.2f} times one")
        print(f"two workers of a cluster: {one / _on_cluster(recording, reconstructor, place):.2f} times one")
        _memory(recording, reconstructor, place / "many", many)


def _folder_of_jpegs(folder: Path, count: int) -> tuple[Recording, Reconstructor]:
    camera, reconstructor = calibrated((WIDTH_PX, HEIGHT_PX), 2, "polynomial")
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


def _parts(recording: Recording, reconstructor: Reconstructor, out: Path) -> dict[str, float]:
    """Seconds that decoding takes, and then the map, its figures and its file."""
    (out / "depth").mkdir(parents=True)
    start = time.perf_counter()
    for _ in iter_frames(recording):
        pass
    decode = time.perf_counter() - start
    frames = [frame for frame in iter_frames(recording) if isinstance(frame, Frame)]
    start = time.perf_counter()
    job = DepthJob(reconstructor, out)
    for number, frame in enumerate(frames):
        job(frame, number)
    return {"decode": decode, "map and write": time.perf_counter() - start}


def _on_cluster(recording: Recording, reconstructor: Reconstructor, place: Path) -> float:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        warm = place / "warm"
        reconstruct_folder(recording, reconstructor, warm, cluster=local.scheduler_address)
        return _timed(
            lambda: reconstruct_folder(recording, reconstructor, place / "cl", cluster=local.scheduler_address)
        )


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


def _timed(act: Callable[[], object]) -> float:
    start = time.perf_counter()
    act()
    return time.perf_counter() - start


if __name__ == "__main__":
    main(sys.argv[1:])
