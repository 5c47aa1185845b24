"""Light calibrated on contacts of unknown shape, on real ball presses that are not said to be balls.

    python -m benchmarks.own_contacts [SEED [CLONES]]

A third of the frames at a time is left out, and read by the law that the contacts of the others gave. Beside it
stand the ready network and, of the frames of other objects, what their contacts give for the balls. One to eight
contacts, drawn by a seed, read all balls as well. Sets F to I lie in clones in the folder CLONES
(public_frames.py). The balls' radius is taken for 3.8 mm (A to D), 4 mm (E, I), 2 mm (F) and 3 mm (G, H, as
stated): depth's scale rests on that, direction hardly does.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.public_frames import SETS as PUBLIC
from benchmarks.real_frames import OBJECTS, REAL, ROOT, SETS, circles, objects_of, real_balls
from tactilevision.heightmap.self_calibration import Contact, Prior, calibrate_on_contacts, contact_of, contradict
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import Samples, ball_samples
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.storage import load_network
from tactilevision.records.measured import Bytes, Floats, Pair

KINDS = dict(zip("ABCDEFGHI", 4 * ["gelslim3"] + 2 * ["gelsight_mini"] + 3 * ["digit"], strict=True))
FOLDS = 3
FEW, DRAWS = (1, 2, 3, 4, 8), 20  # contacts, and how often they are drawn


def main(seed: int = 0, clones: str = "") -> None:
    if REAL.is_dir():
        for name in SETS:
            judge(name, *real_balls(name), seed=seed)
    if clones:
        for name, balls in PUBLIC.items():
            judge(name, *balls(Path(clones)), seed=seed)


def judge(name: str, reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair, *, seed: int) -> None:
    """All figures of a set."""
    network = load_network(ROOT / "models" / f"{KINDS[name]}.onnx", reference).law.at
    contacts, samples = seen(reference, pictures, mm_per_px)
    print(f"{name}: network {told([network(s.change, s.place) for s in samples], samples)}")
    report(f"{name}: frames left out, network", contacts, samples, network)
    report(f"{name}: frames left out, a usual light", contacts, samples, None)
    for prior, words in ((network, "network"), (None, "a usual light")):
        few_contacts(f"{name}: balls, {words}", contacts, samples, np.random.default_rng(seed), prior)
    known = [[one] for one in contacts if one is not None]
    swapped = [contradict(one, lambda u, place: network(u[:, ::-1], place)) for one in known]
    wrong = [contradict(one, network) for one in known]
    print(f"{name}: one contact contradicts its network {sum(wrong)}, red for blue {sum(swapped)} of {len(known)}")
    if name in OBJECTS:
        objects = [contact for rgb in objects_of(name) if (contact := of(reference, rgb)) is not None]
        law = calibrate_on_contacts(objects, network)
        found = "none" if law is None else told([law.at(s.change, s.place) for s in samples], samples)
        print(f"{name}: {len(objects)} objects alone: {found}")
        for prior, words in ((network, "network"), (None, "a usual light")):
            few_contacts(f"{name}: objects, {words}", objects, samples, np.random.default_rng(seed), prior)


def few_contacts(
    name: str,
    contacts: Sequence[Contact | None],
    samples: Sequence[Samples],
    rng: np.random.Generator,
    prior: Prior | None,
) -> None:
    """All balls, read by the law of a few contacts."""
    known = [contact for contact in contacts if contact is not None]
    for count in FEW:
        if count >= len(known):
            continue
        drawn = [[known[at] for at in rng.choice(len(known), count, replace=False)] for _ in range(DRAWS)]
        laws = [law for few in drawn if (law := calibrate_on_contacts(few, prior)) is not None]
        slopes = [[law.at(s.change, s.place) for s in samples] for law in laws]
        off = [np.median(np.concatenate(direction_errors(one, samples))) for one in slopes]
        scale = [np.median([gain(g, s.slopes) for g, s in zip(one, samples, strict=True)]) for one in slopes]
        found = (
            f"{np.median(off):.1f} degrees ({np.max(off):.1f} at most), "
            f"scale {np.min(scale):.2f} to {np.max(scale):.2f}"
            if laws
            else ""
        )
        print(f"{name}, {count} alone: {DRAWS - len(laws)} of {DRAWS} refused; {found}", flush=True)


def gain(found: Floats, true: Floats) -> float:
    """Scale of slopes `found` (N, 2), the true ones having 1."""
    return float(np.sum(found * true) / np.sum(true**2))


def direction_errors(slopes: Sequence[np.ndarray], samples: Sequence[Samples]) -> list[np.ndarray]:
    return [direction_error_deg(g, s.slopes) for g, s in zip(slopes, samples, strict=True)]


def seen(
    reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair
) -> tuple[list[Contact | None], list[Samples]]:
    """The contact of each picture, and samples under its ball."""
    change, rng, contacts, samples = ColourChange(reference), np.random.default_rng(0), [], []
    for number, (picture, ball) in enumerate(zip(pictures, circles(change, pictures, mm_per_px), strict=True)):
        u, _, valid = change.measure(picture.rgb)
        contacts.append(contact_of(u, valid, rng))
        if ball is None:
            continue
        part = ball_samples(u, ball, mm_per_px=mm_per_px, number=number, most=200, valid=valid, rng=rng).complete()
        if len(part.change):  # else a colour is overexposed all over the ball
            samples.append(part)
    return contacts, samples


def of(reference: Reference, rgb: Bytes) -> Contact | None:
    u, _, valid = ColourChange(reference).measure(rgb)
    return contact_of(u, valid, np.random.default_rng(0))


def report(name: str, contacts: Sequence[Contact | None], samples: Sequence[Samples], prior: Prior | None) -> None:
    """Frames left out, read by the law of the others' contacts."""
    laws: list[ColourLaw | None] = []
    for fold in range(FOLDS):
        others = [one for number, one in enumerate(contacts) if number % FOLDS != fold and one is not None]
        laws.append(calibrate_on_contacts(others, prior))
    if any(law is None for law in laws):
        print(f"{name}: the contacts do not tell the light")
        return
    slopes = [law.at(s.change, s.place) for s in samples if (law := laws[s.press[0] % FOLDS]) is not None]
    print(f"{name}: {told(slopes, samples)}")


def told(slopes: Sequence[np.ndarray], samples: Sequence[Samples]) -> str:
    off = np.concatenate(direction_errors(slopes, samples))
    gains = [gain(g, s.slopes) for g, s in zip(slopes, samples, strict=True)]
    return f"{np.median(off):.1f} degrees, scale {np.median(gains):.2f} +- {np.std(gains):.2f}"


def quick() -> None:
    if REAL.is_dir():
        judge("D", *real_balls("D"), seed=0)
    else:
        print("the real frames are not at hand")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0, *sys.argv[2:3])
