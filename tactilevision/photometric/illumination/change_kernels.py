"""The colour changes of `colour_change.py`, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES3, PLANES, kernel

Planes = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


@kernel(BYTES3, PLANES, PLANES, PLANES, "int64", "int64", "float32", "float32[:, :, ::1]")
def changes(
    rgb: Bytes,
    down: Planes,
    across: Planes,
    scale: Planes,
    top: int,
    left: int,
    softening: float,
    out: Planes,
) -> None:
    """Changes (3, h, w), relative, into `out` from row `top` and column `left` of a picture (H, W, 3) on.

    Its gain is the product of `down` (3, H, 2) and `across` (3, 2, W); `scale` (3, H, W).
    """
    count, height, width = out.shape
    apart = np.empty((count, width), np.float32)
    for row in range(height):
        pixels, red, green, blue = rgb[top + row, left:], apart[0], apart[1], apart[2]
        for i in range(width):
            red[i], green[i], blue[i] = pixels[i, 0], pixels[i, 1], pixels[i, 2]
        for c in range(count):
            first, second = down[c, top + row]
            grey, per_grey, line = apart[c], scale[c, top + row, left:], out[c, row]
            level, lean = across[c, 0, left:], across[c, 1, left:]
            for i in range(width):
                gain = first * level[i] + second * lean[i]
                line[i] = (grey[i] * gain + softening) * per_grey[i] - np.float32(1.0)
