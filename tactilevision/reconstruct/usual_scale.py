"""Are balls as large as they are stated? Alike ones do not tell each other, a usual light of their sensor does.

Slopes of balls stated k times too large are 1/k of what the picture shows. A ready network, which knows no ball,
reads them at .68 to 1.32 times the stated ones on eight real sensors, so at 1.4 to 2.6 times where a diameter is
stated for the radius, and at .34 to .66 times where half of it is. Under another light it reads less, too, .56
times on the simulated sample, but then it points elsewhere as well: the cosine between slopes read and stated is
.89 there, .94 to .95 on seven of the eight. Of 1097 drawn lights where it is above .92 none reads less than .6.

A single ball whose radius is stated k times too large stands out of the others by ln k: the network reads real
balls of one sensor within .07 to .15 of each other (GelSlim, Mini), .24 to .36 on DIGITs. It does not lean to the
odd one, as a law does that few balls make.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric import BallPicture, Calibration, load_network
from tactilevision.photometric.ball.detection import Ball, ball_slopes
from tactilevision.photometric.ball.samples import INSIDE, radii_from
from tactilevision.photometric.methods.weights import find_model
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.records import Bytes, Pair, Sensor
from tactilevision.robust import mad_std

MAX_PICTURES = 24  # that are read, spread evenly; of more balls their own law tells a single one
MIN_ALIKE = 0.7  # cosine between slopes read and stated, the median over balls
MAX_GAIN = 1.5  # 2.5 deviations of eight real sensors' scales, which scatter by 16 %
MIN_GAIN = 0.6  # the least of real sensors is .68
MIN_GREY = 40.0  # mean of the pictures: at 45 it reads .9 of what it does at 110, at 16 .68, and points alike
MIN_ALIKE_LIGHT = 0.92  # cosine from which the light is a usual one: too little counts, and a single ball
MIN_OTHERS = 5  # balls beside a single one that is judged
MIN_ALIKE_ONE = 0.88  # cosine of a ball that is judged: a wrong radius leaves directions as they are
MIN_SCATTER = 0.1  # of ln of the scale: few balls may agree better by chance
ODD_SIGMA = 3.5  # deviations of the others; half as large again is .41 off, sound balls of ten .23 at most


@dataclass(frozen=True, slots=True)
class UsualReading:
    """One ball by a usual light: slopes read over stated (`gain`), the cosine between both, the mean `grey`."""

    gain: float
    alike: float
    grey: float


def doubt_of_radii(sensor: Sensor, pictures: Sequence[BallPicture], calibration: Calibration) -> tuple[str, ...]:
    """Warnings, of all balls or a single one, by the network that is ready for the kind of `sensor`, if one is.

    Rectified `pictures`, of which the `calibration` was made; a ball that it has named is not named again.
    """
    path = find_model(sensor.kind.removesuffix("_markers"))
    if path is None:
        return ()
    with suppress(InputError):  # a doubt, and no more
        network = load_network(path, calibration.method.reference)
        shots = [picture.rgb for picture in pictures]
        read = read_balls(network, shots, balls=calibration.balls, mm_per_px=sensor.mm_per_px)
        few = len(read) == sum(ball is not None for ball in calibration.balls)
        odd = odd_by_usual_light(read, names=[one.name for one in pictures], kind=sensor.kind) if few else ()
        known = {said.partition(":")[0] for said in calibration.warnings}
        told = (said for said in odd if said.partition(":")[0] not in known)
        return (*usual_scale_warnings(list(read.values()), kind=sensor.kind), *told)
    return ()


def read_balls(
    network: PhotometricMethod, pictures: Sequence[Bytes], *, balls: Sequence[Ball | None], mm_per_px: Pair
) -> dict[int, UsualReading]:
    """What the `network` reads of `balls`, None where none was found, in rectified pictures (H, W, 3)."""
    known = [number for number, ball in enumerate(balls) if ball is not None]
    some = np.unique(np.linspace(0, len(known) - 1, min(MAX_PICTURES, len(known))).astype(int))
    read = {}
    for number in (known[k] for k in some):
        ball = balls[number]
        assert ball is not None
        read[number] = _reading(network, pictures[number], ball, mm_per_px=mm_per_px)
    return read


def usual_scale_warnings(read: Sequence[UsualReading], *, kind: str) -> tuple[str, ...]:
    """A warning where balls slope far more or less than stated, by the light of a usual `kind` of sensor.

    None where the network points elsewhere than the balls: then it is no such sensor, or a mirrored picture.
    """
    if not read:
        return ()
    gain, alike, grey = np.median([(one.gain, one.alike, one.grey) for one in read], axis=0)
    if gain > MAX_GAIN and alike > MIN_ALIKE:
        cause = "a diameter stated for ball_radius_mm, or is it another kind of sensor"
    elif gain < MIN_GAIN and alike > MIN_ALIKE_LIGHT and grey > MIN_GREY:
        cause = "ball_radius_mm stated too small, mm_per_px too large, or the camera's curve an unusual one"
    else:
        return ()
    return (
        f"by the light of a usual {kind} the balls' slopes are {gain:.2g} times the stated ones: is {cause}? "
        "Depth is in proportion to the radius",
    )


def odd_by_usual_light(read: Mapping[int, UsualReading], *, names: Sequence[str], kind: str) -> tuple[str, ...]:
    """A warning of the one ball whose scale of slope is far from the others' by a usual light, if one is.

    None where the network points elsewhere than the balls: such a light is another.
    """
    if not read or np.median([one.alike for one in read.values()]) < MIN_ALIKE_LIGHT:
        return ()
    gains = {number: np.log(one.gain) for number, one in read.items() if one.alike > MIN_ALIKE_ONE}
    if len(gains) <= MIN_OTHERS:
        return ()
    others = {number: np.array([gains[k] for k in gains if k != number]) for number in gains}
    off = {number: float(gains[number] - np.median(others[number])) for number in gains}
    odd = max(off, key=lambda number: abs(off[number]))
    if abs(off[odd]) < ODD_SIGMA * max(MIN_SCATTER, mad_std(others[odd])):
        return ()
    return (
        f"{names[odd] or f'ball {odd + 1}'}: by the light of a usual {kind} its slopes are "
        f"{np.exp(off[odd]):.2g} times what the other balls make of its ball_radius_mm: another radius, or not "
        "its contact. Correct its ball_radius_mm, or take it out of the balls",
    )


def _reading(network: PhotometricMethod, rgb: Bytes, ball: Ball, *, mm_per_px: Pair) -> UsualReading:
    """What is read under one ball in a rectified picture (H, W, 3)."""
    read = network.slopes(rgb)
    inside = radii_from(ball, read.dz_dx.shape, mm_per_px=mm_per_px) < INSIDE
    under = rows, columns = np.nonzero(inside if read.valid is None else inside & read.valid)
    x, y = ((np.array([columns, rows]).T - ball.centre_px) * mm_per_px).T
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    stated = np.stack(ball_slopes(x, y, contact_mm=contact_mm, radius_mm=ball.radius_mm))
    found = np.stack([read.dz_dx[under], read.dz_dy[under]])
    both, own, true = (float(np.sum(one)) + 1e-12 for one in (found * stated, found**2, stated**2))
    return UsualReading(max(both / true, 1e-3), both / float(np.sqrt(own * true)), float(rgb.mean()))
