"""Are pictures as a ready network takes them, neither mirrored nor red changed for blue?

Slopes of a surface have no curl. Of the squared slopes that a network reads, the best surface leaves .04 to .21 on
nine real sensors, and .30 to .69 with red and blue exchanged or the picture mirrored. On untouched gel both are
alike. Where lamps stand symmetrically, either exchange makes up for the other. A picture turned by 180 degrees
only changes the sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.integration.poisson import integrate
from tactilevision.photometric import load_network, make_reference
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.records import Bytes, Pair, Sensor, SlopeMap
from tactilevision.sensors import may_have_marks

FRAMES_FOR_ORDER = 6  # spread over the recording
BLUR_PX = 2.0  # sigma: noise of single pixels is half curl
BETTER = 0.6  # of the curl: exchanging what is right doubles it at least, what is wrong leaves half at most
EXCHANGES: dict[str, Callable[[Bytes], Bytes]] = {
    "red and blue exchanged (BGR for RGB)": lambda rgb: rgb[..., ::-1],
    "the picture mirrored": lambda rgb: rgb[:, ::-1],
}


def order_warnings(
    path: Path, flats: Sequence[Bytes], frames: Sequence[Bytes], *, sensor: Sensor
) -> tuple[str, ...]:
    """A warning where slopes of `frames` by the network at `path` fit a surface far better if they are exchanged.

    `flats` and `frames` are rectified pictures (H, W, 3).
    """

    def curl(exchange: Callable[[Bytes], Bytes]) -> float:
        untouched, seen = ([np.ascontiguousarray(exchange(rgb)) for rgb in many] for many in (flats, frames))
        reference = make_reference(untouched, may_have_marks=may_have_marks(sensor))
        return curl_share(load_network(path, reference), seen, sensor.mm_per_px)

    plain = curl(lambda rgb: rgb)
    shares = {name: curl(exchange) for name, exchange in EXCHANGES.items()}
    better = [name for name, share in shares.items() if share < BETTER * plain]
    if not better:
        return ()
    return (
        f"as they are, the frames show no surface to the ready network for {sensor.kind} ({100 * plain:.0f} % of "
        f"the slopes is curl); with {' or '.join(better)} they do ({100 * min(shares.values()):.0f} %). Save "
        "frames and reference as the maker's software shows them; depths are false",
    )


def curl_share(method: PhotometricMethod, frames: Sequence[Bytes], mm_per_px: Pair) -> float:
    """The share, 0 to 1, of squared slopes in rectified `frames` (H, W, 3) that no surface has; NaN of none."""
    left = whole = 0.0
    for rgb in frames:
        with suppress(InputError):
            read = method.slopes(rgb)
            known = 1.0 if read.valid is None else read.valid
            p, q = (cv2.GaussianBlur(slope * known, (0, 0), BLUR_PX) for slope in (read.dz_dx, read.dz_dy))
            down, along = np.gradient(integrate(SlopeMap(p, q), mm_per_px), *mm_per_px[::-1])
            left += float(np.sum((p - along) ** 2 + (q - down) ** 2))
            whole += float(np.sum(p**2 + q**2))
    return left / whole if whole else float("nan")
