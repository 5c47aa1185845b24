"""Depth of the upright punch with the same force as a rigid flat punch tilted by theta.

    w_up/(a theta) = f(x, a/h),    x = w/(a theta),    w the depth of the face's centre

The gel may press on the face but not pull (Signorini): over squares of the face, pressure p >= 0 and A p >= w -
theta x with equality where p > 0, A the compliance of the half-space under squares (Love) plus that of the bonded
layer. f is 0 for x <= -1, and x from 2 on, where the whole face is in contact. `solve` solves it for one a/h;
`upright` interpolates the table tilted_punch.csv of `make_table`: a/h 0 (the half-space) to 2, nu = .48, 65
squares across (33 differ by at most .002, 129 by .0013). Force only; the dependence on nu is negligible. Sources:
Love, Phil. Trans. R. Soc. A 228 (1929) 377; Polonsky, Keer, Wear 231 (1999) 206 (the iteration).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactilevision.files.writing import write_text
from tactilevision.mechanics.layer import layer_compliance
from tactilevision.records.constants import NONZERO
from tactilevision.records.measured import Bools, Floats

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

TABLE = Path(__file__).with_name("tilted_punch.csv")
RATIOS = (*(k / 4 for k in range(7)), 2.0)  # a/h, nodes of the table
PLACES = np.linspace(-1, 2, 31)  # place along the tilt, nodes of the table
SQUARES = 65  # squares across the face
NU = 0.48  # Poisson's ratio of the table
MAX_ITERATIONS = 4000  # of the fixed point
CONVERGENCE_TOL = 1e-9  # relative change at which the iteration ends


def upright(x: Floats, a_over_h: float, *, rate: bool = False) -> Floats:
    """Return w_up/(a theta), dimensionless, at x of any shape; a/h beyond the table takes the nearest.

    `rate`: its derivative with respect to x.
    """
    ratio = np.full(x.shape, float(np.clip(a_over_h, RATIOS[0], RATIOS[-1])))
    inside = _spline().ev(np.clip(x, -1, 2), ratio)
    if rate:
        slope = np.where(inside > 0, _spline().ev(np.clip(x, -1, 2), ratio, dx=1), 0.0)
        return np.asarray(np.where(x >= 2, 1.0, np.where(x <= -1, 0.0, slope)))
    return np.asarray(np.where(x >= 2, x, np.where(x <= -1, 0.0, np.maximum(inside, 0.0))))


def solve(x: Floats, a_over_h: float, *, squares: int = SQUARES) -> Floats:
    """Solve the contact for the same ratio at each x (n,); half a second for thirty on one core."""
    side = 2 / squares
    wave = np.fft.rfft2(_influence(squares, side, a_over_h))
    line = (np.arange(squares) + 0.5) * side - 1
    across, along = np.meshgrid(line, line)
    face = np.hypot(across, along) < 1
    whole = _pressed(wave, face, np.ones_like(across))
    return np.array([_pressed(wave, face, one - across) for one in x]) / whole


def make_table(path: Path = TABLE) -> None:
    """Solve anew and write tilted_punch.csv."""
    rows = [
        f"{ratio:g},{x:.3f},{f:.5f}" for ratio in RATIOS for x, f in zip(PLACES, solve(PLACES, ratio), strict=True)
    ]
    head = (
        "# A flat punch tilted by theta: upright depth over a theta; made by mechanics.tilted_punch.make_table,\n"
        f"# {SQUARES} squares across the face, nu = {NU}, 2026-11-21. a_over_h 0 is the half-space.\n"
    )
    write_text(path, head + "a_over_h,x,upright\n" + "\n".join(rows) + "\n")


@lru_cache(maxsize=1)
def _spline() -> RectBivariateSpline:
    from scipy.interpolate import RectBivariateSpline

    values = np.loadtxt(TABLE, delimiter=",", skiprows=3, usecols=2).reshape(len(RATIOS), PLACES.size)
    return RectBivariateSpline(PLACES, RATIOS, values.T)


def _influence(squares: int, side: float, a_over_h: float) -> Floats:
    """Return the depth at each square, wrapped for convolution (2n, 2n), from unit pressure on one.

    E* = 1, lengths in a.
    """
    from scipy.special import j0

    steps = np.minimum(np.arange(2 * squares), 2 * squares - np.arange(2 * squares)) * side
    x, y = np.meshgrid(steps, steps)
    b = side / 2
    table = sum(
        sign * _corner(x + i * b, y + j * b) for i, j, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    )
    table = np.asarray(table) / np.pi
    if a_over_h > 0:
        k = (np.arange(1200) + 0.5) * 12 * a_over_h / 1200
        u = k / a_over_h
        lost = layer_compliance(u, NU).normal * u / (1 - NU) - 1  # the layer over the half-space, less 1
        distance = np.linspace(0, 2 * np.sqrt(2) * 1.01, 400)
        added = j0(distance[:, None] * k) @ lost * (k[1] - k[0]) / np.pi
        table = table + side**2 * np.interp(np.hypot(x, y), distance, added)
    return table


def _corner(x: Floats, y: Floats) -> Floats:
    """Return Love's antiderivative x ln(y + r) + y ln(x + r)."""
    r = np.hypot(x, y)  # the arguments lie off the squares' centres, so neither logarithm meets 0
    return np.asarray(x * np.log(y + r) + y * np.log(x + r))


def _pressed(wave: npt.NDArray[np.complex128], face: Bools, gap: Floats) -> float:
    """Return the total pressure where the face (n, n) overlaps by `gap` (n, n), by conjugate gradients with p >=
    0.
    """
    size = len(gap)

    def depth(p: Floats) -> Floats:
        padded = np.fft.rfft2(p, s=(2 * size, 2 * size)) * wave
        return np.asarray(np.fft.irfft2(padded, s=(2 * size, 2 * size))[:size, :size])

    p = np.where(face & (gap > 0), 1.0, 0.0)
    way, before, go_on = np.zeros_like(p), 1.0, 0.0
    for _ in range(MAX_ITERATIONS):
        rest = np.where(face, depth(p) - gap, 0.0)
        pressed = p > 0
        now = float(np.sum(rest[pressed] ** 2))
        way = np.where(pressed, rest + go_on * now / before * way, 0.0)
        curvature = float(np.sum((way * depth(way))[pressed]))
        if curvature <= 0:
            break
        step, before, old = float(np.sum((rest * way)[pressed])) / curvature, now, p
        p = np.maximum(np.where(pressed, p - step * way, p), 0)
        joins = face & (p == 0) & (rest < 0)
        p = np.where(joins, p - step * rest, p)
        go_on = 0.0 if joins.any() else 1.0
        if np.sum(np.abs(p - old)) < CONVERGENCE_TOL * max(float(p.sum()), NONZERO):
            break
    return float(p.sum())
