"""The colour changes of `colour_change.py` over a window of a picture, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES3, PLANES, kernel

Planes = npt.NDArray[np.float32]


@kernel(BYTES3, PLANES, PLANES, PLANES, "int64", "int64", "float32", "float32[:, :, ::1]")
def changes(
    rgb: npt.NDArray[np.uint8], down: Planes, across: Planes, scale: Planes,
    top: int, left: int, softening: float, out: Planes,
) -> None:  # fmt: skip
    """Changes (3, h, w) into `out` from row `top` and column `left` of a picture (H, W, 3) on.

    Its gain is the product of `down` (3, H, 2) and `across` (3, 2, W); `scale` (3, H, W).
    """
    for c in range(out.shape[0]):
        for row in range(out.shape[1]):
            first, second = down[c, top + row]
            pixels, per_grey = rgb[top + row, left:, c], scale[c, top + row, left:]
            level, lean, line = across[c, 0, left:], across[c, 1, left:], out[c, row]
            for i in range(out.shape[2]):
                gain = first * level[i] + second * lean[i]
                line[i] = (np.float32(pixels[i]) * gain + softening) * per_grey[i] - np.float32(1.0)
