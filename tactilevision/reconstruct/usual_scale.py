"""Are balls as large as they are stated? Alike ones do not tell each other, a usual light of their sensor does.

Slopes of balls stated k times too large are 1/k of what the picture shows. A ready network, which knows no ball,
reads them at .68 to 1.32 times the stated ones on eight real sensors, so at 1.4 to 2.6 times where a diameter is
stated for the radius, and at .34 to .66 times where half of it is. Under another light it reads less, too, .56
times on the simulated sample, but then it points elsewhere as well: the cosine between slopes read and stated is
.89 there, .94 to .95 on seven of the eight. Of 1097 drawn lights where it is above .92 none reads less than .6.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric import Reference, load_network
from tactilevision.photometric.ball.detection import Ball, ball_slopes
from tactilevision.photometric.ball.samples import INSIDE, radii_from
from tactilevision.photometric.methods.weights import find_model
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.records import Bytes, Floats, Pair, Sensor

MAX_PICTURES = 8  # that are read, spread evenly
MIN_ALIKE = 0.7  # cosine between slopes read and stated, the median over balls
MAX_GAIN = 1.5  # 2.5 deviations of eight real sensors' scales, which scatter by 16 %
MIN_GAIN = 0.6  # the least of real sensors is .68
MIN_GREY = 40.0  # mean of the pictures: at 45 it reads .9 of what it does at 110, at 16 .68, and points alike
MIN_ALIKE_LIGHT = 0.92  # cosine from which the light is a usual one, so that too little counts


def doubt_of_radii(
    sensor: Sensor, reference: Reference, pictures: Sequence[Bytes], balls: Sequence[Ball | None]
) -> tuple[str, ...]:
    """The warning of `usual_scale_warnings` by the network that is ready for the kind of `sensor`, if one is.

    Rectified `pictures` (H, W, 3), and the balls found in them, None where none was.
    """
    path = find_model(sensor.kind.removesuffix("_markers"))
    if path is None:
        return ()
    with suppress(InputError):  # a doubt, and no more
        return usual_scale_warnings(
            load_network(path, reference), pictures, balls=balls, mm_per_px=sensor.mm_per_px, kind=sensor.kind
        )
    return ()


def usual_scale_warnings(
    network: PhotometricMethod,
    pictures: Sequence[Bytes],
    *,
    balls: Sequence[Ball | None],
    mm_per_px: Pair,
    kind: str,
) -> tuple[str, ...]:
    """A warning where `balls` slope far more or less than stated, read by the `network` of a `kind` of sensor.

    None where the network points elsewhere than the balls: then it is no such sensor, or a mirrored picture.
    """
    known = [(rgb, ball) for rgb, ball in zip(pictures, balls, strict=True) if ball is not None]
    if not known:
        return ()
    some = np.unique(np.linspace(0, len(known) - 1, min(MAX_PICTURES, len(known))).astype(int))
    read = np.array([_products(network, *known[number], mm_per_px=mm_per_px) for number in some])
    both, found, stated = read.T
    alike, gain = float(np.median(both / np.sqrt(found * stated))), float(np.median(both / stated))
    if gain > MAX_GAIN and alike > MIN_ALIKE:
        cause = "a diameter stated for ball_radius_mm, or is it another kind of sensor"
    elif gain < MIN_GAIN and alike > MIN_ALIKE_LIGHT and np.mean([known[k][0].mean() for k in some]) > MIN_GREY:
        cause = "ball_radius_mm stated too small, mm_per_px too large, or the camera's curve an unusual one"
    else:
        return ()
    return (
        f"by the light of a usual {kind} the balls' slopes are {gain:.2g} times the stated ones: is {cause}? "
        "Depth is in proportion to the radius",
    )


def _products(network: PhotometricMethod, rgb: Bytes, ball: Ball, *, mm_per_px: Pair) -> Floats:
    """Sums under one ball (3,): slopes read times stated ones, read ones squared, stated ones squared."""
    read = network.slopes(rgb)
    inside = radii_from(ball, read.dz_dx.shape, mm_per_px=mm_per_px) < INSIDE
    under = rows, columns = np.nonzero(inside if read.valid is None else inside & read.valid)
    places: Floats = (np.array([columns, rows]).T - ball.centre_px) * mm_per_px
    x, y = places.T
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    stated = np.stack(ball_slopes(x, y, contact_mm=contact_mm, radius_mm=ball.radius_mm))
    found = np.stack([read.dz_dx[under], read.dz_dy[under]])
    return np.array([np.sum(found * stated), np.sum(found**2), np.sum(stated**2)]) + 1e-12
