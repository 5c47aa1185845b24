"""Gels drawn with marks or grain at places that a formula moves, and lit as a contact lights them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.records.measured import Bytes, Floats

SHAPE = (240, 320)
CENTRE = (170.0, 110.0)


def motion(x: Floats, y: Floats, *, push_px: tuple[float, float], bulge_px: float = 0.0) -> tuple[Floats, Floats]:
    """A dragged patch (Gaussian of 40 px) and a bulge away from its middle, in pixels."""
    dx, dy = x - CENTRE[0], y - CENTRE[1]
    fall = np.exp(-(dx**2 + dy**2) / (2 * 40.0**2))
    return (push_px[0] + bulge_px * dx / 40) * fall, (push_px[1] + bulge_px * dy / 40) * fall


def origin(push_px: tuple[float, float], bulge_px: float = 0.0) -> tuple[Floats, Floats]:
    """For each pixel of the moved picture, where its material came from."""
    y, x = (np.asarray(p, dtype=float) for p in np.indices(SHAPE))
    from_x, from_y = x.copy(), y.copy()
    for _ in range(30):
        u, v = motion(from_x, from_y, push_px=push_px, bulge_px=bulge_px)
        from_x, from_y = x - u, y - v
    return from_x, from_y


def light(shade: float) -> Floats:
    """(H, W, 3) brightness: coloured fall-off, and a contact's coloured shading of strength `shade`."""
    y, x = np.indices(SHAPE)
    dx, dy = (x - CENTRE[0]) / 30, (y - CENTRE[1]) / 30
    dent = np.exp(-(dx**2 + dy**2) / 2)
    sides = np.stack([dx, -dy, (dy - dx) / 2], axis=-1)
    fall = np.stack([0.7 + 0.3 * x / 320, 0.7 + 0.3 * y / 240, 1.0 - 0.3 * x / 320], axis=-1)
    return np.asarray(fall * (1 + shade * sides * dent[..., None]))


def photograph(reflectance: Floats, shade: float, rng: np.random.Generator) -> Bytes:
    """8-bit picture with two grey levels of noise."""
    picture = 150 * reflectance[..., None] * light(shade) + 2 * rng.standard_normal((*SHAPE, 3))
    return np.asarray(np.clip(picture, 0, 255), dtype=np.uint8)


def marks(from_x: Floats, from_y: Floats, skip: npt.NDArray[np.bool_] | None = None) -> Floats:
    """Reflectance with dark dots every 18 px of the material, those of `skip` (rows, columns) left out."""
    shape = tuple(len(range(12, size - 6, 18)) for size in SHAPE)
    dotted = np.ones(shape, np.bool_) if skip is None else ~skip[: shape[0], : shape[1]]
    row, column = (np.rint((place - 12) / 18).astype(int) for place in (from_y, from_x))  # of the nearest dot
    off = (from_x - 12 - 18 * column) ** 2 + (from_y - 12 - 18 * row) ** 2
    there = np.pad(dotted, 1)[np.clip(row + 1, 0, shape[0] + 1), np.clip(column + 1, 0, shape[1] + 1)]
    return np.asarray(1 - 0.6 * there * np.exp(-((off / (2 * 2.2**2)) ** 2)))


def ink(from_x: Floats, from_y: Floats, rng: np.random.Generator) -> Floats:
    """Reflectance with a grain of 3 to 12 px wavelength, 8 % strong."""
    total = np.zeros(SHAPE)
    for _ in range(150):
        k, turn, phase = 2 * np.pi / rng.uniform(3.5, 12), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
        total += np.cos(k * (np.cos(turn) * from_x + np.sin(turn) * from_y) + phase)
    return np.asarray(1 + 0.08 * total / np.sqrt(75))
