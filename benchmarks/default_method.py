"""Makes models/gelslim3.onnx: the network that reads GelSlim 3.0 frames before any calibration.

    python -m benchmarks.default_method

Trained on gel drawn under many lights like GelSlim 3.0's (tactilevision/photometric/training/random_lights.py),
some two
minutes on one core. Where real frames lie at ../shared/real its card says how far it is off on them, beside a
polynomial calibrated on their own balls; nothing of them is learnt.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tactilevision.photometric import BallPicture, calibrate_from_balls, make_reference
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
from tactilevision.records import Bytes, Floats

ROOT = Path(__file__).parents[1]
REAL = ROOT / ".." / "shared" / "real"
SETS = {
    "GelSlim 3.0 of mcubelab, no markers": "gelslim3_mcubelab/markerless",
    "GelSlim 3.0 of mcubelab, markers": "gelslim3_mcubelab/markers",
    "GelSlim of siyuandong16, markers": "gelslim_heightmap/dots1",
}
SCALE = (0.0634, 0.0634)
RADIUS_MM = 3.8  # assumed: the real balls' size is not recorded; directions hardly depend on it
SCENES, HELD_OUT, STEPS, SEED = 8000, 400, 2000, 20261121


def make() -> None:
    network = fit_network(*draw_samples(SCENES, SEED), steps=STEPS)
    card = {
        "sensor": "gelslim3",
        **provenance("drawn lights: benchmarks/default_method.py", licence="MIT"),
        "scenes": SCENES,
        "held_out_scenes": HELD_OUT,
        "seed": SEED,
        **held_out(network),
    }
    if REAL.is_dir():
        card["real_ball_presses"] = {name: on_real(network, REAL / folder) for name, folder in SETS.items()}
    print(save_network(network, card, path=ROOT / "models" / "gelslim3.onnx"), card)


def held_out(network: Network) -> dict[str, float]:
    """How far off it is on lights it never saw."""
    unseen, _ = draw_samples(HELD_OUT, SEED + 1)
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


def on_real(network: Network, folder: Path) -> dict[str, Any]:
    """Direction of slope under real balls by this network and by a polynomial calibrated there there."""
    reference, pictures = real_balls(folder)
    change, rng = ColourChange(reference), np.random.default_rng(0)
    parts: list[Samples] = []
    for number, picture in enumerate(pictures):
        seen, _, valid = change.measure(picture.rgb)
        ball = locate(seen, valid, picture=picture, mm_per_px=SCALE)
        parts.append(ball_samples(seen, ball, mm_per_px=SCALE, number=number, most=200, valid=valid, rng=rng))
    samples = join(parts)
    found = network.at(samples.change, samples.place)
    own = calibrate_from_balls(reference, pictures, mm_per_px=SCALE, fit=fit_polynomial)
    return {
        "balls": len(pictures),
        "direction_error_deg": float(np.median(direction_error_deg(found, samples.slopes))),
        "gain_if_the_ball_is_3.8_mm": gain(found, samples.slopes),
        "direction_error_deg_calibrated": own.direction_error_deg,
    }


def real_balls(folder: Path) -> tuple[Any, list[BallPicture]]:
    """The reference and the ball presses of a folder of real frames, rectified."""
    table = np.load(folder.parent / "abe_corr.npz", allow_pickle=False)

    def read(path: Path) -> Bytes:
        raw = cv2.imread(str(path))
        assert raw is not None, path
        return np.ascontiguousarray(raw[table["x"], table["y"], ::-1])

    pictures = [BallPicture(read(path), RADIUS_MM, name=path.name) for path in sorted(folder.glob("sample_*.jpg"))]
    return make_reference([read(folder / "ref.jpg")]), pictures


if __name__ == "__main__":
    make()
