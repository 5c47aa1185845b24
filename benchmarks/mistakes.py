"""Which detectors name which mistake of a user? python -m benchmarks.mistakes [WORD]

Each mistake is made in sample_frames/gelslim3 alone: in its pictures as they are read, or in what is stated of its
balls. Printed: how many warnings come of it, the flags of twelve frames, and the detectors that speak. A detector
that never speaks alone could go. WORD picks mistakes by name.
"""

from __future__ import annotations

import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.real_frames import ROOT
from tactilevision.errors import InputError
from tactilevision.heightmap import (
    ball_validation,
    build,
    inconsistent_light,
    reconstructor,
    reference_match as match,
    scene_faults as scene,
)
from tactilevision.photometric import ball_consistency as consistency
from tactilevision.recording import images, pictures
from tactilevision.recording.model import BallPress, Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bytes, Floats

FRAMES = 12
LATER = 90  # frame from which a change that comes later is there
DETECTORS: tuple[tuple[Any, str], ...] = (
    *((scene, name) for name in ("exchanged", "_failed_lamp", "_failed_later", "_gamma", "_exposure", "_mark")),
    *((match, name) for name in ("image_shift", "contact_in_reference", "other_light")),
    *((consistency, name) for name in ("shared_contact", "contact_in_reference")),
    *((consistency, name) for name in ("contradicting_radii", "outlier_among", "odd_balls", "coverage_warnings")),
    *((consistency, name) for name in ("label_warnings", "scale_warnings", "observability_warnings")),
    *((ball_validation, name) for name in ("usual_scale_warnings", "odd_by_usual_light", "unfit")),
    (scene, "order_warnings"),
    *((build, name) for name in ("dark_colour_warning", "overexposed_warning")),
    (reconstructor, "rises_too_much"),
    (inconsistent_light.Inconsistency, "doubtful"),
)
Change = Callable[[Bytes, int], Bytes]


@dataclass(frozen=True, slots=True)
class Mistake:
    """`change` of a picture and its number, in those of `where`; `of_balls` changes what is stated of the nth."""

    where: tuple[str, ...] = ()
    change: Change = lambda rgb, number: rgb
    of_balls: Callable[[int, BallPress], BallPress] = lambda number, ball: ball
    first: int | None = None  # balls that there are; None: all


def _light(change: Callable[[Floats, int], Any]) -> Change:
    """Return a change of pictures by one of their light (H, W, 3), 0 to 1."""

    def changed(rgb: Bytes, number: int) -> Bytes:
        light = change((rgb / np.float32(255.0)) ** 2.2, number)
        return np.asarray(np.rint(255.0 * np.clip(light, 0.0, 1.0) ** (1 / 2.2)), np.uint8)

    return changed


def _spot(shape: tuple[int, ...], x: float, y: float, reach: float) -> Floats:
    rows, columns = np.indices(shape[:2])
    return np.asarray(np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / reach**2)[..., None])


def _radius(times: float, *, only: int | None = None) -> Callable[[int, BallPress], BallPress]:
    return lambda number, ball: (
        replace(ball, ball_radius_mm=times * ball.ball_radius_mm) if only in (None, number) else ball
    )


def _dirty(rgb: Bytes, number: int) -> Bytes:
    dirty = rgb.copy()
    if number > LATER:
        dirty[96:128, 256:290] //= 2
    return dirty


FRAMES_ONLY, EVERY = ("frame",), ("frame", "ball", "flat")
BLUE = np.array([0, 0, 1], np.float32)
MISTAKES = {
    "none": Mistake(),
    "frames mirrored": Mistake(FRAMES_ONLY, lambda rgb, k: rgb[:, ::-1]),
    "frames BGR": Mistake(FRAMES_ONLY, lambda rgb, k: rgb[..., ::-1]),
    "balls BGR": Mistake(("ball",), lambda rgb, k: rgb[..., ::-1]),
    "frames shifted by 5 px later": Mistake(FRAMES_ONLY, lambda rgb, k: np.roll(rgb, 5 * (k > LATER), axis=0)),
    "a lamp out": Mistake(FRAMES_ONLY, _light(lambda light, k: light * (1 - np.float32(0.7) * BLUE))),
    "a lamp out later": Mistake(FRAMES_ONLY, _light(lambda light, k: light * (1 - (k > LATER) * BLUE))),
    "gamma 1.25": Mistake(FRAMES_ONLY, lambda rgb, k: np.asarray(255 * (rgb / 255.0) ** 1.25, np.uint8)),
    "automatic exposure": Mistake(FRAMES_ONLY, _light(lambda light, k: light * (1 + 0.002 * k))),
    "dirt later": Mistake(FRAMES_ONLY, _dirty),
    "daylight from a side": Mistake(FRAMES_ONLY, _light(lambda x, k: x + 0.06 * _spot(x.shape, 0, 120, 150))),
    "a shaded lamp": Mistake(
        FRAMES_ONLY, _light(lambda x, k: x * (1 - 0.5 * BLUE * _spot(x.shape, 100, 160, 45)))
    ),
    "two lamps of one colour": Mistake(EVERY, lambda rgb, k: rgb[..., [0, 0, 2]]),
    "nearly white light": Mistake(EVERY, _light(lambda x, k: 0.1 * x + 0.9 * x.mean(axis=2, keepdims=True))),
    "one channel dark": Mistake(EVERY, lambda rgb, k: np.asarray(rgb * (1 - BLUE), np.uint8)),
    "overexposed": Mistake(EVERY, lambda rgb, k: np.asarray(np.minimum(rgb * 3.0, 255.0), np.uint8)),
    "radii halved": Mistake(of_balls=_radius(0.5)),
    "diameters for radii": Mistake(of_balls=_radius(2.0)),
    "two radii swapped": Mistake(of_balls=lambda k, ball: replace(ball, ball_radius_mm=6 - ball.ball_radius_mm)),
    "one ball of 16 doubled": Mistake(of_balls=_radius(2.0, only=3)),
    "one ball of 8 doubled": Mistake(of_balls=_radius(2.0, only=3), first=8),
    "circles of other places": Mistake(
        of_balls=lambda k, ball: replace(ball, centre_px=(60.0 + 10 * k, 80.0), contact_radius_px=20.0)
    ),
}


@contextmanager
def listening(spoken: Counter[str]) -> Iterator[None]:
    """Count in `spoken` the detectors that find something within a block."""
    with ExitStack() as stack:
        stack.enter_context(
            mock.patch.dict(os.environ, TACTILEVISION_CACHE="off")
        )  # what is restored says nothing
        for owner, name in DETECTORS:
            stack.enter_context(mock.patch.object(owner, name, _heard(owner, name, spoken)))
        yield


def _heard(owner: Any, name: str, spoken: Counter[str]) -> Any:
    plain = vars(owner)[name]
    is_property = isinstance(plain, property)
    called = plain.fget if is_property else plain

    def heard(*given: Any, **named: Any) -> Any:
        found = called(*given, **named)
        if found is not None and found is not False and (found is True or len(found)):
            spoken[f"{owner.__name__.rpartition('.')[2]}.{name}"] += 1
        return found

    return property(heard) if is_property else heard


def made(mistake: Mistake, recording: Recording) -> str:
    """Return what comes of a mistake."""
    plain = images.read_image

    def read(path: Path, **named: Any) -> Bytes:
        kind = next((one for one in ("ball", "flat") if one in path.parts), "frame")
        rgb = plain(path, **named)
        number = int((re.findall(r"\d+", path.stem) or ["0"])[-1])
        return np.ascontiguousarray(mistake.change(rgb, number)) if kind in mistake.where else rgb

    balls = tuple(mistake.of_balls(number, ball) for number, ball in enumerate(recording.balls[: mistake.first]))
    spoken, flags = Counter[str](), Counter[str]()
    with mock.patch.object(pictures, "read_image", read), listening(spoken):
        try:
            reader = build.build_reconstructor(replace(recording, balls=balls), "polynomial")
        except InputError as fault:
            return f"refused: {str(fault)[:70]}"
        for k in np.linspace(0, len(recording.frame_names) - 1, FRAMES).astype(int):
            try:
                flags.update(reader.height_map(pictures.read_frame(recording, int(k))).flags)
            except InputError:
                flags["refused"] += 1
    return f"{len(reader.warnings)} warnings; {dict(flags)}; {', '.join(spoken)}"


def main(arguments: Sequence[str] = ()) -> None:
    """Print each mistake."""
    recording = read_recording(ROOT / "sample_frames" / "gelslim3")
    for name, mistake in MISTAKES.items():
        if all(word in name for word in arguments):
            print(f"{name}: {made(mistake, recording)}", flush=True)


def quick() -> None:
    main(["diameters"])


if __name__ == "__main__":
    main(sys.argv[1:])
