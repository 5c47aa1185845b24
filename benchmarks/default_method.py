"""Makes models/KIND.onnx: the network that reads frames of a kind of sensor before any calibration.

    python -m benchmarks.default_method [KIND [CLONES]]

KIND is gelslim3 (the default), gelsight_mini or digit. Trained on gel drawn under many lights like that kind's,
with the shadows that it casts (tactilevision/photometric/training), three to six minutes on one core. How far it
is off on the real frames at hand is then judged by `ready_cards`; the card before is written over, and figures of
other sets with it. The network learns nothing of them; one set a kind chose the bounds of its lights.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.own_contacts import gain
from benchmarks.ready_cards import rejudge
from benchmarks.real_frames import ROOT
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.card import provenance
from tactilevision.photometric.methods.network import Network
from tactilevision.photometric.network_training import fit_network
from tactilevision.photometric.random_lights import draw_samples
from tactilevision.photometric.storage import save_network

SCENES, HELD_OUT, STEPS = 8000, 400, 2000
SEED = 20261124  # any number would do: the same seed gives the same network


def make(kind: str = "gelslim3", clones: str = "") -> None:
    network = fit_network(*draw_samples(SCENES, SEED, kind=kind), steps=STEPS, unbiased=True)
    card = {
        "sensor": kind,
        **provenance("drawn lights: benchmarks/default_method.py", licence="MIT"),
        "shadows": "cast by every drawn body, for each lamp: photometric/random_lights.py",
        "scenes": SCENES,
        "held_out_scenes": HELD_OUT,
        "seed": SEED,
        **held_out(network, kind),
    }
    print(save_network(network, card, path=ROOT / "models" / f"{kind}.onnx"), card)
    rejudge(kind, clones)


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


if __name__ == "__main__":
    make(*sys.argv[1:])
