"""Faces of rendered sets once other faces of the same sensor have taught the wall's law, beside as they were.

python -m benchmarks.rendered --taught FOLDER...

Half of a set's faces teach, with their true depth for a certificate's; the other half is read, and the other way
round. Halves alternate in depth and radius; no face has the place of another.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rendered.judge import Step, judge_step, true_depth_mm
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reading
from tactilevision.heightmap.walls import WallFace, teach
from tactilevision.press.certified_faces import wall_at
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording

BAND = (0.96, 1.02)  # of the true depth: where faces are asked to be
DEPTHS = 4  # depths of one radius in a set, in a row


def report(folders: Sequence[Path]) -> None:
    """Each set's faces before and after, and what all of them come to."""
    before: list[Step] = []
    after: list[Step] = []
    for folder in folders:
        plain, taught = _halves(folder)
        print(folder.name, "  depth:", *(f"{one.depth_mm:.2f}" for one in plain))
        for name, steps in (("before", plain), ("taught", taught)):
            print(f"  {name}:", *(f"{one.face:.3f}" for one in steps), flush=True)
        before, after = before + plain, after + taught
    for name, steps in (("before", before), ("taught", after)):
        _sum_up(name, steps)


def _sum_up(name: str, steps: Sequence[Step]) -> None:
    face, depth = np.array([one.face for one in steps]), np.array([one.depth_mm for one in steps])
    inside = (face >= BAND[0]) & (face <= BAND[1])
    for deep in sorted(set(depth)):
        here = depth == deep
        rms = np.sqrt(np.mean((face[here] - 1) ** 2))
        count, mean = f"{inside[here].sum()} of {here.sum()}", face[here].mean()
        print(f"{name}, {deep:.2f} mm: {count}, mean {mean:.3f}, rms {rms:.3f}")
    within = 100 * np.mean([one.within for one in steps], axis=0)
    off = np.sqrt(np.mean((face - 1) ** 2))
    print(
        f"{name}: {inside.sum()} of {face.size}, mean {face.mean():.3f}, rms {off:.4f}; "
        f"beside {1e3 * np.mean([one.beside_rms_mm for one in steps]):.1f} um; within "
        + ", ".join(f"{share:.0f}" for share in within)
        + " %"
    )


def _halves(folder: Path) -> tuple[list[Step], list[Step]]:
    recording, truth = read_recording(folder), tomllib.loads((folder / "truth.toml").read_text())["step"]
    reader = build_reconstructor(recording)
    frames = [reader.rectified(read_frame(recording, k)) for k in range(len(recording.frame_names))]

    def judged(number: int, seen: Reading) -> Step:
        return judge_step(seen.height, true_depth_mm(folder, f"frame_{number + 1:05d}"), truth[number])

    plain, faces = [], []
    for number, step in enumerate(truth):
        seen = reader.read_rectified(frames[number + 1])
        plain.append(judged(number, seen))
        faces.append(_face(seen, step, plain[-1].face * step["face_mm"], place=str(number)))
    halves = [(number + number // DEPTHS) % 2 for number in range(len(truth))]
    taught = []
    for number, half in enumerate(halves):
        lesson = teach([face for face, other in zip(faces, halves, strict=True) if other != half])
        taught.append(judged(number, reader.varied(taught=lesson).read_rectified(frames[number + 1])))
    return plain, taught


def _face(seen: Reading, step: dict[str, Any], read_mm: float, *, place: str) -> WallFace:
    """The face of a map, with its wall where one was found."""
    wall = wall_at(seen, step["centre_mm"], step["radius_mm"])
    hidden, depth = (wall.missing_mm, wall.depth_mm) if wall else (0.0, read_mm)
    return WallFace(place, read_mm, hidden, depth, step["face_mm"])
