"""A profile's cost: loading it, and a frame from its coming to the wrench, on one core.

python -m benchmarks.live
A camera of 427x320 over simulated gel: free, a gentle press of .1 mm, a deep one of .4 mm. Times are of the
processor, so that other programs count little; the wall's clock beside them.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.vision import WIDTH_MM, calibrated
from tactilevision.profile.model import Profile
from tactilevision.profile.sensor import load_sensor, stated_material, with_compliance
from tactilevision.profile.storage import write_profile
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Gel
from tactilevision.robots.live import Stream
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.punch import PunchPress, punch_profile

SIZE = (427, 320)
GEL = Gel(3.0, poisson_ratio=0.48, poisson_ratio_std=0.005, youngs_modulus_MPa=0.2, youngs_modulus_std_MPa=0.003)
PRESSES_MM = {"nothing touches": 0.0, "a gentle press": 0.1, "a deep press": 0.4}
FRAMES = 300  # frames of each kind
KINDS = 8  # pictures of each kind, so that no frame is the one before


def profile() -> tuple[Profile, Camera]:
    """A profile of the simulated camera, and the camera."""
    camera, reconstructor = calibrated(SIZE, 2, "polynomial")
    assert reconstructor.referenced is not None
    scale = WIDTH_MM / SIZE[0]
    made = Profile(
        dataclasses.replace(reconstructor.sensor, gel=GEL, mm_per_px=(scale, scale)),
        reconstructor.referenced,
        camera.picture(Flat(), np.random.default_rng(0)),
        SIZE,
        "2026-11-21",
        "nothing",
        calibration=stated_material(GEL),
    )
    return with_compliance(made), camera


def pictures(camera: Camera, depth_mm: float) -> list[Bytes]:
    press = PunchPress(punch_profile(0.48, 2.5, 3.0), depth_mm, (1.0, -0.7)) if depth_mm else Flat()
    return [camera.picture(press, np.random.default_rng(k)) for k in range(KINDS)]


def main(frames: int = FRAMES) -> None:
    made, camera = profile()
    with tempfile.TemporaryDirectory() as folder:
        path = write_profile(made, Path(folder) / "sensor.tvs")
        spent = []
        for _ in range(5):
            began, wall = time.process_time(), time.perf_counter()
            sensor = load_sensor(path)
            spent.append((time.process_time() - began, time.perf_counter() - wall))
    print(f"load_sensor: {min(s for s, _ in spent):.3f} s of the processor, {min(w for _, w in spent):.3f} s")
    stream = Stream(sensor)
    for name, depth_mm in PRESSES_MM.items():
        shown = [Frame(rgb) for rgb in pictures(camera, depth_mm)]
        took = np.array([_milliseconds(stream, shown[k % KINDS]) for k in range(frames)])[KINDS:]
        processor, wall_ms = np.percentile(took[:, 0], (50, 95)), np.percentile(took[:, 1], (50, 95))
        print(
            f"{name}: {processor[0]:.1f} ms, 95 of 100 below {processor[1]:.1f} ms of the processor "
            f"(by the wall's clock {wall_ms[0]:.1f} and {wall_ms[1]:.1f}); {1e3 / processor[0]:.0f} a second"
        )


def _milliseconds(stream: Stream, frame: Frame) -> tuple[float, float]:
    began, wall = time.process_time(), time.perf_counter()
    stream.take(frame)
    return 1e3 * (time.process_time() - began), 1e3 * (time.perf_counter() - wall)


def quick() -> None:
    main(24)


if __name__ == "__main__":
    main()
