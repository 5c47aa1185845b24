"""Real balls that a calibration never saw: direction, dent and its rms error, over partitions drawn anew.

    python -m benchmarks.balls_left_out [PARTITIONS [SET...]]

Balls are dealt into thirds by chance, with the seeds 1 to PARTITIONS; each third is read by the calibration
(`auto`) of the others, whose circles are found anew. True are the circles of the calibration on all balls. Which
balls are left out moves a set by a hundredth or two: means over partitions settle, and their scatter is printed.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.own_contacts import FOLDS
from benchmarks.peers import calibrated, judged, own_reader
from benchmarks.real_frames import REAL, SETS, real_balls
from tactilevision.heightmap.ball_validation import dent_mm
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Floats, Pair

PARTITIONS = 5


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A ball left out: error (N,) of its directions in degrees, and its dent in mm, found and true."""

    ball: Ball
    direction_deg: Floats
    found_mm: float
    true_mm: float


def main(partitions: int = PARTITIONS, names: Sequence[str] = ()) -> None:
    cv2.setNumThreads(1)
    if not REAL.is_dir():
        print("the real frames are not at hand")
        return
    for name in names or SETS:
        report(name, *real_balls(name), partitions)


def report(
    name: str, reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair, partitions: int
) -> None:
    balls = calibrated(reference, pictures, mm_per_px).balls
    kept = [(picture, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    rows = []
    for seed in range(1, partitions + 1):
        found = left_out(reference, kept, mm_per_px, np.random.default_rng(seed))
        rows.append(figures(found))
        print(f"{name}, partition {seed}: {told(rows[-1:])}", flush=True)
    print(f"{name}, {len(kept)} balls, {partitions} partitions: {told(rows)}")


def left_out(
    reference: Reference, kept: Sequence[tuple[BallPicture, Ball]], mm_per_px: Pair, rng: np.random.Generator
) -> list[LeftOut]:
    """Each ball, in the order of `kept`, as the calibration of the two thirds without it reads it."""
    fold = rng.permutation(len(kept)) % FOLDS
    found: dict[int, LeftOut] = {}
    for out in range(FOLDS):
        others = [picture for (picture, _), one in zip(kept, fold, strict=True) if one != out]
        read = own_reader(reference, others, mm_per_px)
        for number in np.flatnonzero(fold == out).tolist():
            picture, ball = kept[number]
            reading = read(picture.rgb)
            direction = judged(reading, ball, mm_per_px)[0]
            found[number] = LeftOut(ball, direction, *dent_mm(reading.depth_mm, ball, mm_per_px=mm_per_px))
    return [found[number] for number in range(len(kept))]


def figures(found: Sequence[LeftOut]) -> tuple[float, float, float, float]:
    """Median direction in degrees, median and mean of the dents over the true ones, their rms error in um."""
    ratio = np.array([one.found_mm / one.true_mm for one in found])
    off = np.array([one.found_mm - one.true_mm for one in found])
    direction = np.concatenate([one.direction_deg for one in found])
    rms_um = 1e3 * float(np.sqrt(np.mean(off**2)))
    return float(np.median(direction)), float(np.median(ratio)), float(ratio.mean()), rms_um


def told(rows: Sequence[tuple[float, float, float, float]]) -> str:
    """Means over partitions, with their scatter where there are several."""
    mean, scatter = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1) if len(rows) > 1 else None
    words = ("direction {:.2f} degrees", "dent {:.3f} (median)", "{:.3f} (mean)", "rms {:.1f} um")
    return ", ".join(
        word.format(one) + ("" if scatter is None else f" +- {scatter[k]:.3f}")
        for k, (word, one) in enumerate(zip(words, mean, strict=True))
    )


def quick() -> None:
    main(1, ["D"])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else PARTITIONS, sys.argv[2:])
