"""Makes models/gelslim3.npz: the polynomial that reads GelSlim 3.0 frames before any calibration.

    python benchmarks/default_method.py

Trained on simulated balls under many lights like GelSlim 3.0's (blue from the top, green from the left, red from
the lower right), each lamp moved, turned up and down and coloured at random, cameras of many gammas.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball import Ball
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.change import ColourChange
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.polynomial import fit_polynomial
from tactilevision.photometric.reference import Reference, make_reference
from tactilevision.photometric.samples import Samples, inside_ball, join, untouched
from tactilevision.photometric.storage import save_method
from tactilevision.records import Floats
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.lights import Light, gelslim_lights
from tactilevision.synthetic.optics import CameraOptions, build_camera
from tactilevision.synthetic.options import GelOptions
from tactilevision.synthetic.reference import picture_still, plan_balls

SCALE = (0.0634, 0.0634)
# Measured afterwards on every third real, markerless ball press of mcubelab/gelslim, a ball of 3.8 mm assumed.
REAL = "GelSlim 3.0 of mcubelab: slope direction 15 degrees off (median), depth scale 1.44 of true"
REAL_GAIN = 0.44
CAMERAS, HELD_OUT, BALLS = 16, 4, 8


def moved(light: Light, rng: np.random.Generator) -> Light:
    """A lamp of the same kind, a little elsewhere, in another strength and colour."""
    x, y, z = np.array(light.position_mm) + rng.normal(0.0, 1.5, 3)
    colour = np.array(light.colour)
    colour[colour < 0.9] *= rng.uniform(0.5, 1.5)
    brightness = light.brightness * rng.uniform(0.8, 1.2)
    return dataclasses.replace(light, position_mm=(x, y, z), brightness=brightness, colour=tuple(colour))


def camera(rng: np.random.Generator) -> Camera:
    options = CameraOptions(distortion_px=0.0, gamma=float(rng.uniform(1.0, 2.2)))
    lights = tuple(moved(light, rng) for light in gelslim_lights())
    return dataclasses.replace(build_camera(options, rng), lights=lights)


def samples(number: int, rng: np.random.Generator) -> tuple[Samples, Samples, Reference]:
    """Samples under the balls and beside them, of one camera."""
    scene = camera(rng)
    reference = make_reference([picture_still(scene, Flat(), rng) for _ in range(2)])
    change = ColourChange(reference)
    contact, still = [], []
    for press in plan_balls(BALLS, (4.0,), (13.5, 10.1), GelOptions(), rng):
        seen, _, valid = change.measure(scene.picture(press, rng))
        ball = known(press.centre_mm, press.contact_radius_mm)
        contact.append(inside_ball(seen, ball, SCALE, number=number, most=250, valid=valid, rng=rng))
        still.append(untouched(seen, ball, SCALE, number=number, most=100, valid=valid, rng=rng))
    return join(contact), join(still), reference


def known(centre_mm: tuple[float, float], contact_mm: float) -> Ball:
    x, y = (c / SCALE[0] + (n - 1) / 2 for c, n in zip(centre_mm, (427, 320), strict=True))
    return Ball((x, y), contact_mm / SCALE[0], 4.0)


def make() -> None:
    rng = np.random.default_rng(20261121)
    made = []
    for number in range(CAMERAS + HELD_OUT):
        try:
            made.append(samples(number, rng))
        except InputError:  # lights so odd that most of the picture is dark
            continue
    train, test = made[:-HELD_OUT], made[-HELD_OUT:]
    law = fit_polynomial(join([m[0] for m in train]), join([m[1] for m in train]), ridge=1e-3)
    unseen = join([m[0] for m in test])
    found: Floats = law.at(unseen.change, unseen.place)
    gain = [np.sum(law.at(m[0].change, m[0].place) * m[0].slopes) / np.sum(m[0].slopes ** 2) for m in test]
    card = {
        "source": "benchmarks/default_method.py: simulated balls under lights like those of GelSlim 3.0",
        "licence": "MIT",
        "cameras": len(train),
        "held_out_cameras": len(test),
        "held_out_direction_error_deg": float(np.median(direction_error_deg(found, unseen.slopes))),
        "held_out_slope_rms": float(np.sqrt(np.mean(np.sum((found - unseen.slopes) ** 2, axis=1)))),
        "held_out_gain_std": max(REAL_GAIN, float(np.sqrt(np.mean((np.array(gain) - 1.0) ** 2)))),
        "real_frames": REAL,
        "steepest_slope": law.steepest,
    }
    method = CalibratedMethod(law, train[0][2], 0.2, None, card)
    print(save_method(method, Path(__file__).parents[1] / "models" / "gelslim3.npz"), card)


if __name__ == "__main__":
    make()
