"""Height maps of rendered sets beside the truth: balls left out, flat faces, the gel beside, stated deviations.

python -m benchmarks.rendered --judge FOLDER...
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.rendered.sets import TRUTH
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.images import read_image
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Pair

Array = npt.NDArray[np.floating]

FACE = 0.7  # of the radius: the face without its edge
BALL = 0.5  # of the contact's radius: the middle of a ball
FOLDS = 4  # parts that balls are left out by, drawn by chance: every second one has one radius and a few columns
NEAR_MM = (0.3, 1.5)  # mm beyond the edge, over which the outward fall is taken
BESIDE_MM = (0.5, 3.0)  # mm beyond the edge, over which the surface is compared
RING_MM = 0.08  # mm, half width of a ring


@dataclass(frozen=True, slots=True)
class Step:
    """One flat face: depth and fall (z at .3 less z at 1.5 mm) over the truth's, the gel beside it, coverage."""

    depth_mm: float
    face: float
    fall: float
    beside_rms_mm: float
    within: tuple[float, float, float, float]


def judge(folder: Path) -> tuple[list[float], list[Step]]:
    """Depth over truth of balls that the other three quarters calibrate, and each step by all balls."""
    recording = read_recording(folder)
    truth = tomllib.loads((folder / "truth.toml").read_text())
    ratios: list[float] = []
    order = np.random.default_rng(0).permutation(len(truth.get("ball", ())))
    for left_out in (order[fold::FOLDS] for fold in range(min(FOLDS, order.size))):
        kept = tuple(ball for number, ball in enumerate(recording.balls) if number not in left_out)
        reader = build_reconstructor(replace(recording, balls=kept))
        ratios += [_ball(folder, recording, reader, number, truth["ball"][number]) for number in left_out]
    reader = build_reconstructor(recording)
    steps = []
    for number, step in enumerate(truth["step"], start=1):
        seen = reader.height_map(read_frame(recording, number))
        steps.append(judge_step(seen, true_depth_mm(folder, f"frame_{number:05d}"), step))
    return ratios, steps


def true_depth_mm(folder: Path, name: str) -> Array:
    """The drawn surface (H, W) in mm of a picture of a set."""
    with np.load(folder / TRUTH / f"{name}.npz") as file:
        return np.asarray(file["depth_mm"], np.float64)


def distance_mm(shape: tuple[int, ...], mm_per_px: Pair, centre_mm: Sequence[float]) -> Array:
    """Distance (H, W) in mm of the pixels of a picture of `shape` (H, W) from a place of the pad."""
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2) * mm_per_px[0] - centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * mm_per_px[1] - centre_mm[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]))


def _ball(folder: Path, recording: Recording, reader: Reconstructor, number: int, ball: dict[str, Any]) -> float:
    record = recording.balls[number]
    seen = reader.rectified_map(read_image(record.path, white_level=recording.white_level))
    middle = distance_mm(seen.depth_mm.shape, seen.mm_per_px, ball["centre_mm"]) < BALL * ball["contact_radius_mm"]
    truth = true_depth_mm(folder, f"ball_{number:02d}")
    return float(seen.depth_mm[middle].mean() / truth[middle].mean())


def judge_step(seen: HeightMap, truth: Array, step: dict[str, Any]) -> Step:
    """The map of a flat face beside the `truth` (H, W) mm."""
    far = distance_mm(seen.depth_mm.shape, seen.mm_per_px, step["centre_mm"]) - step["radius_mm"]
    depth, error = np.asarray(seen.depth_mm, np.float64), seen.depth_mm - truth
    face = far < (FACE - 1) * step["radius_mm"]
    near, end = (np.abs(far - at) < RING_MM for at in NEAR_MM)
    beside = (far > BESIDE_MM[0]) & (far < BESIDE_MM[1])
    std = np.full(depth.shape, np.nan) if seen.std_mm is None else seen.std_mm
    within = [float(np.mean(np.abs(error[where]) < k * std[where])) for where in (face, beside) for k in (1, 2)]
    return Step(
        step["face_mm"],
        float(depth[face].mean() / truth[face].mean()),
        float((depth[near].mean() - depth[end].mean()) / (truth[near].mean() - truth[end].mean())),
        float(np.sqrt(np.mean(error[beside] ** 2))),
        (within[0], within[1], within[2], within[3]),
    )


def report(folders: Sequence[Path]) -> None:
    """A table for each set."""
    for folder in folders:
        ratios, steps = judge(folder)
        if ratios:
            print(f"{folder.name}: balls {np.mean(ratios):.3f}, sd {np.std(ratios):.3f} ({len(ratios)})")
        print("  depth   face   fall  beside um   face within 1, 2 std   beside within 1, 2 std")
        for step in sorted(steps, key=lambda one: one.depth_mm):
            face, gel = (f"{100 * a:3.0f} {100 * b:3.0f} %" for a, b in (step.within[:2], step.within[2:]))
            rms = f"{1e3 * step.beside_rms_mm:7.1f}"
            print(
                f"  {step.depth_mm:.2f}   {step.face:.3f}  {step.fall:5.2f}  {rms}      {face}      {gel}",
                flush=True,
            )
        every = np.mean([step.within for step in steps], axis=0)
        print("  all: within " + ", ".join(f"{100 * share:.0f}" for share in every) + " %")
