"""Judges the ready networks, models/KIND.onnx, on real ball presses, and writes what comes out into their cards.

    python -m benchmarks.ready_cards [CLONES]

Sets A to E lie at ../shared/real, F to I in clones in the folder CLONES (public_frames.py); those there are
judged. Balls lie where the light of each other shows them. Beside each network stands a polynomial calibrated on
the balls themselves. The figures are those of `own_contacts`, row "network".
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.own_contacts import KINDS, direction_errors, gain, seen
from benchmarks.public_frames import SETS as PUBLIC, Balls
from benchmarks.real_frames import REAL, ROOT, SETS, real_balls
from tactilevision.files.writing import write_json
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.methods.polynomial import fit_polynomial
from tactilevision.photometric.storage import load_network

SENSORS = {
    "A": "GelSlim 3.0 of mcubelab, no markers, held out",
    "B": "GelSlim 3.0 of mcubelab, markers, held out",
    "C": "GelSlim of siyuandong16, markers, held out",
    "D": "another GelSlim of siyuandong16, markers; the lamps were chosen on it",
    "E": "GelSight Mini of taxim, held out",
    "F": "GelSight Mini of RuihanGao; the lamps were chosen on it",
    "G": "DIGIT of vocdex; the lamps were chosen on it",
    "H": "another DIGIT of vocdex, held out",
    "I": "DIGIT of rohankotanu, a quarter of the gel, held out",
}
CIRCLES = "by the light of each other: benchmarks/real_frames.py"
SIZED = ("A", "B", "C", "D", "G", "H")  # sets whose balls' size is stated or assumed; elsewhere scale has no truth
MIN_CALIBRATED = 10  # balls; a polynomial of fewer says little


def main(clones: str = "") -> None:
    for kind in dict.fromkeys(KINDS.values()):
        rejudge(kind, clones)


def rejudge(kind: str, clones: str) -> None:
    """Write the real figures of a kind's network into its card; of sets not at hand those of the card stay."""
    sets = [name for name, one in KINDS.items() if one == kind]
    at_hand = [name for name in sets if (REAL.is_dir() if name in SETS else clones)]
    missing = [SENSORS[name] for name in sets if name not in at_hand]
    if missing:
        print(f"{kind}: not at hand: {'; '.join(missing)}")
    if not at_hand:
        return
    path = (ROOT / "models" / kind).with_suffix(".json")
    card = json.loads(path.read_text())
    presses = card.get("real_ball_presses", {}) | {
        SENSORS[name]: on_real(kind, name, real_balls(name) if name in SETS else PUBLIC[name](Path(clones)))
        for name in at_hand
    }
    judged = {"date": datetime.date.today().isoformat(), "circles": CIRCLES, "not_at_hand": missing}
    write_json(path, card | {"real_ball_presses": presses, "real_judged": judged})
    print(kind, json.dumps(presses, indent=1), flush=True)


def on_real(kind: str, name: str, balls: Balls) -> dict[str, Any]:
    """Direction of slope under real balls by the network and by a polynomial made there; gain where SIZED."""
    reference, pictures, mm_per_px = balls
    told = by_network(kind, name, balls)
    if len(pictures) >= MIN_CALIBRATED:
        own = calibrate_from_balls(reference, pictures, mm_per_px=mm_per_px, fit=fit_polynomial)
        told["direction_error_deg_calibrated"] = own.direction_error_deg
    return told


def by_network(kind: str, name: str, balls: Balls) -> dict[str, Any]:
    """The same by the network alone."""
    reference, pictures, mm_per_px = balls
    network = load_network(ROOT / "models" / f"{kind}.onnx", reference).law.at
    samples = seen(reference, pictures, mm_per_px)[1]
    slopes = [network(one.change, one.place) for one in samples]
    told = {"balls": len(samples), "direction_error_deg": _median(direction_errors(slopes, samples))}
    if name in SIZED:
        gains = [gain(one, sample.slopes) for one, sample in zip(slopes, samples, strict=True)]
        told[f"gain_if_the_ball_is_{pictures[0].radius_mm:g}_mm"] = float(np.median(gains))
    return told


def _median(errors: list[np.ndarray]) -> float:
    return float(np.median(np.concatenate(errors)))


def quick() -> None:
    """One set, and no card is written."""
    print(by_network("gelslim3", "D", real_balls("D")) if REAL.is_dir() else "the real frames are not at hand")


if __name__ == "__main__":
    main(*sys.argv[1:])
