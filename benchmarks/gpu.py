"""The path for a GPU beside the plain one: the same maps, and how long a frame takes in each.

python -m benchmarks.gpu
Simulated gel under a camera of three sizes: free, a gentle press of .1 mm, a deep one of .4 mm. Times are by the
wall's clock, medians of frames taken in turn, since a GPU's are not the processor's. Where torch finds no GPU its
path is run on the processor: the maps count then, and the times tell nothing.
"""

from __future__ import annotations

import copy
import time

import numpy as np
import torch

from benchmarks.live import KINDS, PRESSES_MM, pictures
from benchmarks.vision import calibrated
from tactilevision.reconstruct import Reconstructor
from tactilevision.reconstruct.gpu.device import find_gpu
from tactilevision.records import Bytes, Frame

SIZES = ((320, 240), (640, 480), (1280, 960))
FRAMES = 60  # of each kind and path


def main() -> None:
    device = find_gpu()
    print(f"torch {torch.__version__}: {'no GPU' if device is None else torch.cuda.get_device_name(0)}")
    for size in SIZES:
        camera, plain = calibrated(size, 2, "polynomial")
        other = copy.deepcopy(plain)
        assert other.use(device or "cpu")
        for name, depth_mm in PRESSES_MM.items():
            shown = pictures(camera, depth_mm)
            maps = [one.height_map(Frame(shown[0])) for one in (plain, other)]
            off = np.abs(maps[0].depth_mm - maps[1].depth_mm).max()
            alike = "" if np.array_equal(maps[0].valid, maps[1].valid) else "; valid pixels DIFFER"
            took = np.array([[_ms(one, shown[k % KINDS]) for one in (plain, other)] for k in range(FRAMES)])
            own, there = np.median(took[KINDS:], axis=0)
            print(
                f"{size[0]}x{size[1]}, {name}: {own:.2f} ms plain, {there:.2f} ms there, "
                f"maps within {1e6 * off:.1f} nm{alike}",
                flush=True,
            )


def _ms(reconstructor: Reconstructor, rgb: Bytes) -> float:
    began = time.perf_counter()
    reconstructor.height_map(Frame(rgb))
    return 1e3 * (time.perf_counter() - began)


if __name__ == "__main__":
    main()
