"""Surface compliance of a bonded layer in wave numbers, and punches on it solved numerically."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactilevision.records.measured import Floats

NU = 0.48  # only ratios of forces are taken from here; they hardly know nu


def compliance(wave: Floats, thickness: float, *, bending: float = 0.0) -> Floats:
    """Depth over pressure (E = 1) of a wave on a bonded layer, frictionless, under a coat that bends.

    A coat of bending stiffness D stands in parallel: 1/C = 1/C_layer + D k^4. Layer: K(u) of
    Hayes et al. (1972). `wave` (K,) in 1/mm, `bending` D/E in mm^3.
    """
    u, k = np.minimum(wave * thickness, 40.0), 3 - 4 * NU
    layer = (2 * k * np.sinh(2 * u) - 4 * u) / (2 * k * np.cosh(2 * u) + 4 * u**2 + 1 + k**2)
    bare = 2 * (1 - NU**2) * layer / wave
    return np.asarray(1 / (1 / bare + bending * wave**4))


def stiffness_of_coated(radius: float, thickness: float, bending: float) -> float:
    """Force over depth of a flat punch (E = 1): the largest complementary energy over sixteen pressures.

    Pressures: eight that end like (1 - r^2)^(n - 1/2) and eight rings, the last of them at the edge, where a coat
    hands its shear force to the punch.
    """
    from scipy.special import j0, jv

    wave = np.geomspace(1e-4, 4e3, 6000) / radius
    x = wave * radius
    smooth = [jv(n + 0.5, x) / x ** (n + 0.5) for n in range(8)]
    rings = [j0(x * place) for place in np.sqrt(np.linspace(0.3, 1, 8))]
    shapes = np.array([s / s[0] for s in (*smooth, *rings)])
    weight = np.gradient(wave) * wave * compliance(wave, thickness, bending=bending) / (2 * np.pi)
    if bending == 0:
        shapes = shapes[:8]
    energy = (shapes * weight) @ shapes.T
    total = np.ones(len(shapes))
    return float(total @ np.linalg.lstsq(energy, total, rcond=1e-11)[0])


@lru_cache(maxsize=64)
def coat_factor(radius: float, thickness: float, bending: float) -> float:
    """How much stiffer the coat makes the gel under this punch."""
    return stiffness_of_coated(radius, thickness, bending) / stiffness_of_coated(radius, thickness, 0.0)


@lru_cache(maxsize=16)
def askew(ratio: float) -> tuple[Floats, Floats]:
    """Force of a punch that stands askew by theta, as the depth of the upright one: x = w/(a theta) -> w_up/(a
    theta).

    The face is cut into squares; where they would pull they let go, and the rest is solved anew (Signorini).
    `ratio` a/h. Returns x (25,) from -1 up and the answers, which end on w_up = w.
    """
    size = 17
    line = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    inside = np.hypot(x, y) < 1
    x, y = x[inside], y[inside]
    table = _influence(np.hypot(x[:, None] - x, y[:, None] - y), 2 / size, 1 / ratio)
    upright = float(np.linalg.solve(table, np.ones(x.size)).sum())
    depth = np.concatenate([np.linspace(-1, 2, 19), np.linspace(2.5, 8, 6)])
    force = np.array([_pressed(table, w - x) for w in depth]) / upright
    return depth, np.where(depth > 3, depth, force)


def _pressed(table: Floats, gap: Floats) -> float:
    """Total force where the face overlaps by `gap` (n,): the least energy without tension."""
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    root = cholesky(table)
    force, _ = nnls(root, solve_triangular(root, gap, trans="T"), maxiter=20 * gap.size)
    return float(force.sum())


def _influence(distance: Floats, side: float, thickness: float) -> Floats:
    """Depth at one square from a unit force on another (E = 1); lengths in radii of the punch."""
    from scipy.special import j0

    modulus = 1 / (1 - NU**2)
    wave = np.linspace(1e-3, 12 / thickness, 500)
    far = (compliance(wave, thickness) - 2 / (modulus * wave)) * wave / (2 * np.pi) * (wave[1] - wave[0])
    place = np.linspace(0, 2.1, 60)
    layer = np.interp(distance, place, j0(place[:, None] * wave) @ far)
    own = 4 * np.log(1 + np.sqrt(2)) / (np.pi * modulus * side)
    with np.errstate(divide="ignore"):
        half_space = np.where(distance > 0, 1 / (np.pi * modulus * distance), own)
    return np.asarray(half_space + layer)
