"""The path through torch, on the processor: the numbers of the plain path, whatever law reads the colours."""

from __future__ import annotations

import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tactilevision.live import Stream
from tactilevision.photometric import PHOTOMETRIC, CalibratedMethod, calibrate_from_balls, make_reference
from tactilevision.photometric.training.network_training import NetworkFitter
from tactilevision.reconstruct import Reconstructor
from tactilevision.reconstruct.gpu.device import DRIVERS
from tactilevision.reconstruct.untouched_frames import subtract_background
from tactilevision.records import Frame

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import MM_PER_PX, SENSOR, ball, ball_pictures, flat, picture

FITS = {**PHOTOMETRIC, "network": NetworkFitter(steps=150)}  # trained briefly


@lru_cache
def calibrated(name: str, marks: bool = False) -> CalibratedMethod:
    rng = np.random.default_rng(1)
    shots = ball_pictures(8, rng)
    reference = make_reference([flat(rng) for _ in range(3)], may_have_marks=marks)
    method = calibrate_from_balls(reference, shots, mm_per_px=(MM_PER_PX, MM_PER_PX), fit=FITS[name]).method
    return subtract_background(method, [flat(rng) for _ in range(8)])


@pytest.mark.parametrize(
    "name", ["polynomial", *(pytest.param(one, marks=pytest.mark.slow) for one in ("lookup", "network"))]
)
def test_height_maps_are_those_of_the_plain_path(name: str) -> None:
    plain, torched = (Reconstructor(SENSOR, calibrated(name)) for _ in range(2))
    assert torched.use("cpu")
    rng = np.random.default_rng(2)
    for centre, contact in (((0.5, 0.5), 1.5), ((-1.0, 0.2), 0.6)):
        _, p, q = ball(centre, contact, 4.0)
        frame = Frame(picture(p, q, rng))
        one, other = plain.height_map(frame), torched.height_map(frame)
        assert np.abs(one.depth_mm - other.depth_mm).max() < 2e-5 * (100 if name == "lookup" else 1)
        assert np.array_equal(one.valid, other.valid)
        assert one.std_mm is not None
        assert other.std_mm is not None
        assert np.allclose(one.std_mm, other.std_mm, rtol=1e-2)


def test_gel_with_marks_and_walls_are_read_as_well() -> None:
    plain, torched = (Reconstructor(SENSOR, calibrated("polynomial", marks=True)) for _ in range(2))
    plain.readable = torched.readable = 0.2  # so that all steep places are looked through for walls
    assert torched.use("cpu")
    _, p, q = ball((0.5, 0.5), 1.5, 4.0)
    frame = Frame(picture(p, q, np.random.default_rng(3)))
    assert np.abs(plain.height_map(frame).depth_mm - torched.height_map(frame).depth_mm).max() < 2e-5


def test_a_stream_follows_the_light_on_a_device_too() -> None:
    rng = np.random.default_rng(4)
    frames = [Frame(flat(rng, gain=1.0 + 0.002 * step)) for step in range(6)]
    depths = []
    for device in (None, "cpu"):
        method = calibrated("polynomial")
        reconstructor = Reconstructor(SENSOR, method.with_reference(method.reference))
        assert device is None or reconstructor.use(device)
        live = Stream(reconstructor, renew=0.3)
        depths.append([live.take(frame).height.depth_mm for frame in frames])
    assert np.abs(np.array(depths[0]) - np.array(depths[1])).max() < 2e-5


def test_torch_is_loaded_only_where_a_driver_is() -> None:
    code = (
        "import sys\nfrom tactilevision.reconstruct.gpu.device import find_gpu\nprint(find_gpu(), "
        "'torch' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    if not any(Path(path).exists() for path in DRIVERS):
        assert said == ["None", "False"]
    else:
        assert said[0] in ("None", "cuda")
