"""Slopes on half squares to depth on squares: no blur of wide squares, and what is hidden is left out."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.heightmap.poisson import integrate_half_squares
from tactilevision.records.measured import Floats

HALF = (0.1, 0.125)  # mm
PER_HALF = 8  # samples to the side of a half square
WAVE = 2.1  # per mm


def fine(rows: int, columns: int) -> tuple[Floats, Floats]:
    """x, y (n, m) mm of the samples of (rows, columns) half squares."""
    x, y = ((np.arange(n * PER_HALF) + 0.5) / PER_HALF * mm for n, mm in zip((columns, rows), HALF, strict=True))
    return np.asarray(np.meshgrid(x, y)[0]), np.asarray(np.meshgrid(x, y)[1])


def means(values: Floats, width: int) -> Floats:
    rows, columns = (n // width for n in values.shape)
    return np.asarray(values.reshape(rows, width, columns, width).mean((1, 3)), np.float64)


def made(shape: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Slopes on half squares and mean depth on squares of a surface that curves within a few of them."""
    x, y = fine(*shape)
    z, p, q = (
        np.sin(WAVE * x) * np.cos(0.7 * WAVE * y),
        WAVE * np.cos(WAVE * x) * np.cos(0.7 * WAVE * y),
        -0.7 * WAVE * np.sin(WAVE * x) * np.sin(0.7 * WAVE * y),
    )
    return means(p, PER_HALF), means(q, PER_HALF), means(z, 2 * PER_HALF)


def test_a_wave_comes_back_whole() -> None:
    p, q, z = made((36, 44))
    depth, known = integrate_half_squares(p, q, share=np.ones_like(p), least=0.9, mm_per_px=HALF)
    assert known.all()
    assert depth.shape == z.shape
    off = depth - (z - z.mean())
    assert np.abs(off).max() < 0.015
    gain = float(np.vdot(depth, z - z.mean()) / np.vdot(z - z.mean(), z - z.mean()))
    assert gain == pytest.approx(1, abs=0.008), "slopes of whole squares would bring back .976"


def test_what_is_hidden_is_left_out_whatever_stands_there() -> None:
    p, q, z = made((36, 44))
    share = np.ones_like(p)
    share[10:18, 12:20] = 0.0
    p[10:18, 12:20], q[10:18, 12:20] = 3.0, -2.0
    depth, known = integrate_half_squares(p, q, share=share, least=0.9, mm_per_px=HALF)
    assert not known[5:9, 6:10].any()
    assert np.count_nonzero(~known) == 16
    off = (depth - z)[known]
    assert np.ptp(off) < 0.02


def test_a_square_that_is_mostly_hidden_is_not_known() -> None:
    p, q, _ = made((12, 16))
    share = np.ones_like(p)
    share[4, 6] = 0.5
    _, known = integrate_half_squares(p, q, share=share, least=0.9, mm_per_px=HALF)
    assert not known[2, 3]
    assert known.sum() == known.size - 1
