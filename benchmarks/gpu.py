"""Frames read in batches through torch, on a CUDA device or the processor: speed, floor and agreement.

python -m benchmarks.gpu [--device auto|cpu|cuda] [--frames N] [--size WIDTHxHEIGHT]
For free gel, a gentle contact, and one frame in five with a wall: frames a second, compared with the frame path on
one core, and with the floor by bytes and operations. The prepared script for a machine with a GPU: minutes.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
import torch

from benchmarks.vision import calibrated
from tactilevision.heightmap.batch import BatchReader
from tactilevision.heightmap.device import find_device
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.methods.polynomial import LOW, MAX_ORDER, PolynomialEvaluator
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import BallPress, Flat, Surface
from tactilevision.synthetic.punch import PunchPress, punch_profile

SEEDS = 4  # different pictures of each kind, repeated
TURNS = 3  # of each way in turn
ALONE = 32  # frames that the frame path reads for comparison
# of an H100 SXM by its data sheet: bytes a second of its memory and of PCIe 5, operations in float32
MEMORY, BUS, OPERATIONS = 3.35e12, 5e10, 6.7e13


def main(arguments: Sequence[str] = ()) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--device", default="auto")
    parser.add_argument("--frames", type=int, default=2048)
    parser.add_argument("--size", default="320x240")
    given = parser.parse_args(arguments)
    width, height = map(int, given.size.split("x"))
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    device = find_device(given.device)
    name = torch.cuda.get_device_name(device) if device != "cpu" else "no GPU: the processor, one core"
    print(f"torch {torch.__version__}, {name}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    camera, reconstructor = calibrated((width, height), 2, "polynomial")
    reader, started = BatchReader(reconstructor, device), time.perf_counter()
    reader.read(pictures(camera, [Flat()], reader.chunk))
    print(f"first batch of {reader.chunk} frames: {time.perf_counter() - started:.1f} s")
    if device != "cpu":
        floor(reconstructor, width, height)
        steps(reader)
    ball, wall = (
        BallPress(8.0, 0.8, 3.0, 0.48, (1.0, -0.7)),
        PunchPress(punch_profile(0.48, 2.5, 3.0), 0.4, (1.0, -0.7)),
    )
    for kind, scenes in (
        ("free gel", [Flat()]),
        ("a gentle contact", [ball]),
        ("walls in one of five", [Flat(), Flat(), Flat(), Flat(), wall]),
    ):
        compare(kind, reader, reconstructor, pictures(camera, scenes, given.frames))


def pictures(camera: Camera, scenes: Sequence[Surface], count: int) -> npt.NDArray[np.uint8]:
    """Frames (count, H, W, 3) of the scenes in turn, each with SEEDS kinds of noise."""
    several = [camera.picture(scene, np.random.default_rng(seed)) for seed in range(SEEDS) for scene in scenes]
    return np.stack([several[k % len(several)] for k in range(count)])


def compare(kind: str, reader: BatchReader, reconstructor: Reconstructor, frames: npt.NDArray[np.uint8]) -> None:
    """Print the speed of batches and of the frame path, in turns, by the clock and by processor time."""
    spent = np.zeros((2, 2))
    for _ in range(TURNS):
        for way, some in enumerate((frames, frames[:ALONE])):
            before = time.perf_counter(), time.process_time()
            if way == 0:
                maps = reader.read(some)
            else:
                alone = [reconstructor.height_map(one) for one in some]
            spent[way] += (time.perf_counter() - before[0], time.process_time() - before[1])
    wall_s, cpu_s = (spent / (TURNS * np.array([[len(frames)], [min(ALONE, len(frames))]]))).T
    off = [
        1e3 * float(np.sqrt(np.mean((a.depth_mm - b.depth_mm) ** 2))) for a, b in zip(maps, alone, strict=False)
    ]
    print(
        f"{kind}: {1 / wall_s[0]:.0f} frames a second, frame path {1 / wall_s[1]:.0f}; by processor time "
        f"{cpu_s[1] / cpu_s[0]:.2f} of its throughput, by the clock {wall_s[1] / wall_s[0]:.2f}; "
        f"maps differ by {np.median(off):.3f} um rms, at most {max(off):.3f}"
    )


def floor(reconstructor: Reconstructor, width: int, height: int) -> None:
    """Print what memory, bus and operations of the device allow, of the steps on whole pictures alone.

    Each step reads its inputs and writes its results once, in single precision: rectification, changes, products,
    sums, slopes, and the products of the integration as one pass each.
    """
    method = reconstructor.referenced
    assert method is not None
    assert isinstance(method.evaluate, PolynomialEvaluator)
    products, sums = method.evaluate.products, 2 * (MAX_ORDER + 1)
    numbers = 2 * 3 + 2 * 3 + (3 + products) + (products + sums) + (sums + 2) + 2 * 2 + 3 + 4 * 2 + 2 * 1
    operations = 2 * (LOW * products + (sums - LOW) * 3) + products + sums + 6 * (width + height)
    pixels = width * height
    limits = {
        "memory": MEMORY / (4 * numbers * pixels),
        "operations": OPERATIONS / (operations * pixels),
        "bus": BUS / ((3 + 4 + 1) * pixels),
    }
    told = ", ".join(f"{name} {limit:.0f}" for name, limit in limits.items())
    print(f"floor, frames a second by {told} ({4 * numbers} bytes and {operations:.0f} operations a pixel)")


def steps(reader: BatchReader) -> None:
    """Print the time of the recorded steps alone, without copies and without work of the processor."""
    held = reader.recorded
    assert held is not None
    begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))  # type: ignore[no-untyped-call]
    torch.cuda.synchronize()
    begin.record()
    for _ in range(20):
        held.graph.replay()
    end.record()
    torch.cuda.synchronize()
    ms = begin.elapsed_time(end) / 20
    rate, memory = 1e3 * reader.chunk / ms, torch.cuda.max_memory_allocated() / 2**30
    print(
        f"steps on the device: {ms:.2f} ms for {reader.chunk} frames, {rate:.0f} frames a second; {memory:.1f} GiB"
    )


def quick() -> None:
    main(["--device", "cpu", "--frames", "32"])


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
