"""Makes models/KIND.onnx: the network that reads frames of a kind of sensor before any calibration.

    python -m benchmarks.default_method [KIND [CLONES]]

KIND is gelslim3 (the default), gelsight_mini or digit. Trained on gel drawn under many lights like that kind's,
with the shadows that it casts (tactilevision/photometric/training), three to six minutes on one core. Its card
says how far it is off on real frames, where they lie at ../shared/real or in clones in the folder CLONES
(public_frames.py), beside a polynomial calibrated on their own balls. The network learns nothing of them; one set
a kind chose the bounds of its lights.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.public_frames import SETS as PUBLIC
from tactilevision.photometric import BallPicture, Reference, calibrate_from_balls, make_reference
from tactilevision.photometric.ball.samples import Samples, ball_samples, join
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.card import provenance
from tactilevision.photometric.found_balls import locate
from tactilevision.photometric.illumination.colour_change import ColourChange
from tactilevision.photometric.methods.network import Network
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.storage import save_network
from tactilevision.photometric.training.network_training import fit_network
from tactilevision.photometric.training.random_samples import draw_samples
from tactilevision.records import Bytes, Floats, Pair

ROOT = Path(__file__).parents[1]
REAL = ROOT / ".." / "shared" / "real"
GELSLIMS = {
    "GelSlim 3.0 of mcubelab, no markers, held out": "gelslim3_mcubelab/markerless",
    "GelSlim 3.0 of mcubelab, markers, held out": "gelslim3_mcubelab/markers",
    "GelSlim of siyuandong16, markers, held out": "gelslim_heightmap/dots1",
    "another GelSlim of siyuandong16, markers; the lamps were chosen on it": "gelslim_heightmap/test_data",
}
SCALE = (0.0634, 0.0634)
RADIUS_MM = 3.8  # assumed: the real balls' size is not recorded; directions hardly depend on it
MINI, MINI_SCALE, MINI_RADIUS_MM = "taxim_gelsight_mini", (0.0317, 0.0317), 4.0
PUBLIC_NAMES = {
    "gelsight_mini": {"F": "GelSight Mini of RuihanGao; the lamps were chosen on it"},
    "digit": {
        "G": "DIGIT of vocdex; the lamps were chosen on it",
        "H": "another DIGIT of vocdex, held out",
        "I": "DIGIT of rohankotanu, a quarter of the gel, held out",
    },
}
STATED_RADIUS = ("G", "H")  # sets of which the balls' size is stated; elsewhere scale has no truth
MIN_CALIBRATED = 10  # balls; a polynomial of fewer says little
SCENES, HELD_OUT, STEPS = 8000, 400, 2000
SEED = 20261124  # any number would do: the same seed gives the same network


def make(kind: str = "gelslim3", clones: str = "") -> None:
    network = fit_network(*draw_samples(SCENES, SEED, kind=kind), steps=STEPS, unbiased=True)
    card = {
        "sensor": kind,
        **provenance("drawn lights: benchmarks/default_method.py", licence="MIT"),
        "shadows": "cast by every drawn body, for each lamp: photometric/training/random_surfaces.py",
        "scenes": SCENES,
        "held_out_scenes": HELD_OUT,
        "seed": SEED,
        **held_out(network, kind),
        "real_ball_presses": {name: on_real(network, *balls) for name, balls in real_sets(kind, clones)},
    }
    print(save_network(network, card, path=ROOT / "models" / f"{kind}.onnx"), card)


def real_sets(kind: str, clones: str) -> Iterator[tuple[str, tuple[Reference, list[BallPicture], Pair, bool]]]:
    """Real ball presses of a kind that are at hand, and whether their radius is known well enough for a scale."""
    if kind == "gelslim3" and REAL.is_dir():
        for name, folder in GELSLIMS.items():
            yield name, (*real_balls(REAL / folder), SCALE, True)
    if kind == "gelsight_mini" and REAL.is_dir():
        yield "GelSight Mini of taxim, held out", (*mini(), MINI_SCALE, False)
    if clones:
        for letter, name in PUBLIC_NAMES.get(kind, {}).items():
            yield name, (*PUBLIC[letter](Path(clones)), letter in STATED_RADIUS)


def held_out(network: Network, kind: str) -> dict[str, float]:
    """How far off it is on lights it never saw."""
    unseen, _ = draw_samples(HELD_OUT, SEED + 1, kind=kind)
    found = network.at(unseen.change, unseen.place)
    scenes = [unseen.press == number for number in np.unique(unseen.press)]
    rms = float(np.sqrt(np.mean(np.sum((found - unseen.slopes) ** 2, axis=1))))
    return {
        "held_out_direction_error_deg": float(np.median(direction_error_deg(found, unseen.slopes))),
        "held_out_slope_rms": rms,
        "held_out_relative_error": rms / float(np.sqrt(np.mean(np.sum(unseen.slopes**2, axis=1)))),
        "held_out_gain_std": float(
            np.sqrt(np.mean([(gain(found[s], unseen.slopes[s]) - 1) ** 2 for s in scenes]))
        ),
    }


def gain(found: Floats, true: Floats) -> float:
    return float(np.sum(found * true) / np.sum(true**2))


def on_real(
    network: Network, reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair, sized: bool
) -> dict[str, Any]:
    """Direction of slope under real balls by the network and by a polynomial made there; gain if `sized`."""
    change, rng = ColourChange(reference), np.random.default_rng(0)
    parts: list[Samples] = []
    for number, picture in enumerate(pictures):
        seen, _, valid = change.measure(picture.rgb)
        ball = locate(seen, valid, picture=picture, mm_per_px=mm_per_px)
        parts.append(
            ball_samples(seen, ball, mm_per_px=mm_per_px, number=number, most=200, valid=valid, rng=rng).complete()
        )
    samples = join(parts)
    found = network.at(samples.change, samples.place)
    told = {"balls": len(pictures), "direction_error_deg": _direction(found, samples.slopes)}
    if sized:
        told[f"gain_if_the_ball_is_{pictures[0].radius_mm:g}_mm"] = gain(found, samples.slopes)
    if len(pictures) >= MIN_CALIBRATED:
        own = calibrate_from_balls(reference, pictures, mm_per_px=mm_per_px, fit=fit_polynomial)
        told["direction_error_deg_calibrated"] = own.direction_error_deg
    return told


def _direction(found: Floats, true: Floats) -> float:
    return float(np.median(direction_error_deg(found, true)))


def mini() -> tuple[Reference, list[BallPicture]]:
    """The reference and the ball presses of the GelSight Mini of taxim."""
    pictures = [
        BallPicture(_read(path), MINI_RADIUS_MM, name=path.name)
        for path in sorted((REAL / MINI).glob("img_*.png"))
    ]
    return make_reference([_read(REAL / MINI / "f0.png")], may_have_marks=False), pictures


def _read(path: Path) -> Bytes:
    raw = cv2.imread(str(path))
    assert raw is not None, path
    return np.ascontiguousarray(raw[..., ::-1])


def real_balls(folder: Path) -> tuple[Any, list[BallPicture]]:
    """The reference and the ball presses of a folder of real frames, rectified."""
    table = np.load(folder.parent / "abe_corr.npz", allow_pickle=False)

    def read(path: Path) -> Bytes:
        return np.ascontiguousarray(_read(path)[table["x"], table["y"]])

    pictures = [BallPicture(read(path), RADIUS_MM, name=path.name) for path in sorted(folder.glob("sample_*.jpg"))]
    return make_reference([read(folder / "ref.jpg")]), pictures


if __name__ == "__main__":
    make(*sys.argv[1:])
