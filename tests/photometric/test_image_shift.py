"""A picture beside its reference is seen by the gel's grain; one that is not, or has no grain, is let be."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from lamp_room import SHAPE, ball, picture

from tactilevision.heightmap.reference_match import image_shift
from tactilevision.records.measured import Bytes, Floats, Pair

REAL = Path(__file__).parents[2] / ".." / "shared" / "real"
real = pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not at hand")
SHIFTS = [(10.0, 0.0), (-3.0, 2.0), (0.0, 2.5), (-14.0, -7.0)]
SEED = 5


def shifted(rgb: Bytes, shift: Pair) -> Bytes:
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
    return np.asarray(cv2.warpAffine(rgb, matrix, rgb.shape[1::-1], borderMode=cv2.BORDER_REPLICATE), np.uint8)


def gel(rng: np.random.Generator, grain: Floats, *, pressed: bool = False) -> Bytes:
    """A frame of a gel whose ink has `grain` (H, W), with or without a ball in it."""
    p, q = ball((1.0, -0.5), 2.0, 4.0)[1:] if pressed else (np.zeros(SHAPE), np.zeros(SHAPE))
    return picture(p, q, rng, gain=grain[..., None])


def ink(contrast: float) -> Floats:
    """Brightness about 1 with structures of two pixels."""
    rough = cv2.GaussianBlur(np.random.default_rng(SEED).standard_normal(SHAPE), (0, 0), 1.0)
    return np.asarray(1.0 + contrast * rough / rough.std())


@each("shift", SHIFTS)
def test_a_shift_is_seen_and_measured(shift: Pair) -> None:
    rng = np.random.default_rng(SEED)
    reference = gel(rng, ink(0.02))
    found = image_shift(reference, [shifted(gel(rng, ink(0.02), pressed=k > 0), shift) for k in range(3)])
    assert found is not None
    assert np.hypot(found[0] - shift[0], found[1] - shift[1]) < 0.3


def test_what_has_not_moved_is_let_be() -> None:
    rng = np.random.default_rng(SEED + 1)
    reference = gel(rng, ink(0.02))
    assert image_shift(reference, [gel(rng, ink(0.02), pressed=k > 0) for k in range(4)]) is None
    assert image_shift(reference, [shifted(gel(rng, ink(0.02)), (0.6, 0.0))]) is None, "pressed gel moves as far"
    assert image_shift(reference, []) is None


def test_a_single_moved_frame_among_others_is_not_the_recording() -> None:
    rng = np.random.default_rng(SEED + 2)
    frames = [gel(rng, ink(0.02)) for _ in range(4)]
    assert image_shift(gel(rng, ink(0.02)), [*frames, shifted(frames[0], (8.0, 0.0))]) is None


def test_gel_without_grain_tells_nothing() -> None:
    rng = np.random.default_rng(SEED + 3)
    assert image_shift(gel(rng, ink(0.0)), [shifted(gel(rng, ink(0.0)), (10.0, 0.0))]) is None
    assert image_shift(gel(rng, ink(0.02)), [np.zeros((*SHAPE, 3), np.uint8)]) is None


def test_noise_that_stays_on_the_chip_does_not_hide_a_shift() -> None:
    rng = np.random.default_rng(SEED + 4)
    chip = rng.normal(0.0, 0.6, (*SHAPE, 1))

    def seen(rgb: Bytes) -> Bytes:
        return np.clip(np.rint(rgb + chip), 0, 255).astype(np.uint8)

    frames = [seen(shifted(gel(rng, ink(0.02)), (6.0, -4.0))) for _ in range(3)]
    found = image_shift(seen(gel(rng, ink(0.02))), frames)
    assert found is not None
    assert np.hypot(found[0] - 6.0, found[1] + 4.0) < 0.4


SETS = [
    ("gelslim3_mcubelab/markerless", "ref.jpg", "sample_*.jpg"),
    ("gelslim3_mcubelab/markers", "ref.jpg", "sample_*.jpg"),
    ("gelslim_heightmap/dots1", "ref.jpg", "sample_*.jpg"),
    ("taxim_gelsight_mini", "f0.png", "[!f]*.png"),
    ("feelanyforce/records/calibration_sphere", "background.png", "tactile/*.png"),
]


@real
@each("folder, reference, frames", SETS)
def test_real_presses_have_not_moved_until_they_are(folder: str, reference: str, frames: str) -> None:
    def read(path: Path) -> Bytes:
        return np.asarray(cv2.imread(str(path)), np.uint8)

    untouched = read(REAL / folder / reference)
    presses = [read(path) for path in sorted((REAL / folder).glob(frames))[::7]]
    assert len(presses) > 2
    assert image_shift(untouched, presses) is None
    assert all(image_shift(untouched, [one]) is None for one in presses)
    found = image_shift(untouched, [shifted(one, (10.0, -3.0)) for one in presses])
    assert found is not None
    assert np.hypot(found[0] - 10.0, found[1] + 3.0) < 1.0
