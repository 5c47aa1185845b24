"""Cells held against the light's law, of `inconsistent_light.py`, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import PLANE, PLANES, kernel

Picture = npt.NDArray[np.float32]
Planes = npt.NDArray[np.float32]


@kernel(PLANES, PLANES, "Array(float32, 4, 'C', True)", "Array(int64, 2, 'C', True)", "float32[:, :, ::1]")
def off_law(change: Planes, slopes: Planes, answers: Planes, powers: npt.NDArray[np.int64], off: Planes) -> None:
    """What changes (3, h, w) are `off` the law of light, of `answers` (k, 3, h, w) to slopes (2, h, w)."""
    width = change.shape[2]
    p, q, light = (
        np.ones((5, width), np.float32),
        np.ones((5, width), np.float32),
        np.empty((3, width), np.float32),
    )
    for row in range(change.shape[1]):
        for n in range(1, 5):
            for i in range(width):
                p[n, i], q[n, i] = p[n - 1, i] * slopes[0, row, i], q[n - 1, i] * slopes[1, row, i]
        light[:] = np.float32(1.0)
        for k in range(powers.shape[0]):
            of_p, of_q = p[powers[k, 0]], q[powers[k, 1]]
            for c in range(3):
                answer, line = answers[k, c, row], light[c]
                for i in range(width):
                    line[i] += answer[i] * (of_p[i] * of_q[i])
        for c in range(3):
            for i in range(width):
                steep = np.sqrt(np.float32(1.0) + p[2, i] + q[2, i])
                off[c, row, i] = change[c, row, i] + np.float32(1.0) - light[c, i] / steep


@kernel(PLANES, PLANE, PLANES, "float32", "float32", "float32", "float32[:, ::1]", "float32[:, ::1]")
def against_law(
    off: Planes,
    size: Picture,
    noise_square: Planes,
    usual: float,
    limit: float,
    tiny: float,
    score: Picture,
    share: Picture,
) -> None:
    """Put in t over its `limit`, and the `share` of the change of colour, of `size`, that is not explained."""
    for row in range(size.shape[0]):
        for i in range(size.shape[1]):
            of_size = usual * size[row, i]
            square, length = np.float32(0.0), np.float32(0.0)
            for c in range(off.shape[0]):
                one = off[c, row, i] * off[c, row, i]
                square += one / (noise_square[c, row, i] + of_size * of_size)
                length += one
            score[row, i] = np.sqrt(square) / limit
            share[row, i] = np.sqrt(length) / (size[row, i] + tiny)
