"""What `colour_change.py` asks of every pixel, compiled: its colour changes, and which of its colours are told."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES2, BYTES3, PLANES, kernel

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


@kernel(BYTES2, BYTES3, BYTES2, BYTES2, "uint8", "uint8", "uint8[:, :, ::1]", *["uint8[:, ::1]"] * 3)
def told(
    rgb: Bytes,
    overexposed: Bytes,
    lit_by_two: Bytes,
    usable: Bytes,
    saturated: int,
    least: int,
    missing: Bytes,
    lacking: Bytes,
    partly: Bytes,
    valid: Bytes,
) -> None:
    """Put in which colours (3, H, W) of a picture (H, 3 W) are `missing`, how many (H, W) each pixel is `lacking`.

    And where (H, W) it is told by two colours, `partly`, or `valid`, by all, none in shadow. Masks are 0 and 1.
    """
    for row in range(rgb.shape[0]):
        pixels, two, known = rgb[row], lit_by_two[row], usable[row]
        over_r, over_g, over_b = overexposed[0, row], overexposed[1, row], overexposed[2, row]
        red, green, blue = missing[0, row], missing[1, row], missing[2, row]
        count, part, whole = lacking[row], partly[row], valid[row]
        for i in range(lacking.shape[1]):
            r, g, b = pixels[3 * i], pixels[3 * i + 1], pixels[3 * i + 2]
            red[i] = np.uint8(r >= saturated) | over_r[i]
            green[i] = np.uint8(g >= saturated) | over_g[i]
            blue[i] = np.uint8(b >= saturated) | over_b[i]
            count[i] = red[i] + green[i] + blue[i]
            part[i] = two[i] & np.uint8(count[i] == 1)
            brightest = max(r, g, b)
            whole[i] = known[i] & np.uint8(brightest >= least) & np.uint8(brightest < saturated)
