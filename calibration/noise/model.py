"""The error model: what one sample, and what one press, adds at random.

    y = f + G u + e,    G = [f, df/dw],    u ~ N(0, diag(gain^2, zero^2)) anew for each press,
    e_i ~ N(0, scale^2 b_i^2),             correlation (1 - white) rho^k between samples k apart in one press

f is the model's force. b is the stated noise, depth carried over by the slope: b^2 = std_F^2 + (df/dw)^2 std_w^2
(effective variance: Orear, Am. J. Phys. 50 (1982) 912), or 1 N where nobody stated any: scale is then in N.
Samples of one press are no repeats: whitening takes their common part out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.effects.support.hereditary import Grid
from calibration.inputs.observations import Observations
from tactilevision.records import Floats

STATED_DOF = 20.0  # a stated noise is trusted like one measured on so many readings


@dataclass(frozen=True, slots=True)
class Noise:
    """`scale` on the stated noise (or in N), `gain` (1) and `zero_mm` of a press, `correlation` of neighbours in
    all of a sample's noise but the share `white` of its variance.

    `dof`: how many degrees of freedom stand behind it; `stated`: True where the samples' noise came with the data;
    `belied`: repeats show less than half of it beyond chance, so that it is trusted no more.
    """

    scale: float
    gain: float = 0.0
    zero_mm: float = 0.0
    correlation: float = 0.0
    white: float = 0.0
    dof: float = np.inf
    stated: bool = True
    belied: bool = False

    @property
    def trust(self) -> float:
        """Readings that what was stated is worth."""
        return STATED_DOF if self.stated and not self.belied else 0.0

    def parts(self, base_N: Floats) -> dict[str, float]:
        """For a report: mN a sample, per cent and um a press."""
        return {
            "sample_mN": 1e3 * self.scale * float(np.median(base_N)),
            "press_gain_percent": 100 * self.gain,
            "press_zero_um": 1e3 * self.zero_mm,
            "correlation": self.correlation,
        }


@dataclass(frozen=True, slots=True)
class Linear:
    """The model about its fit: force (N,), slope (N,), and a sample's noise at scale 1, `base_N` (N,)."""

    force_N: Floats
    slope_N_per_mm: Floats
    base_N: Floats


def base_noise(data: Observations, slope_N_per_mm: Floats) -> tuple[Floats, bool]:
    """b (N,) and whether it was stated; where not, its shape alone, about 1."""
    force, depth = data.force_std_N, slope_N_per_mm * data.depth_std_mm
    known = np.isfinite(force) | np.isfinite(depth)
    size = np.hypot(np.nan_to_num(force), np.nan_to_num(depth))
    if not (known.all() and (size > 0).all()):
        shape = np.hypot(1.0, data.depth_over_force_noise * slope_N_per_mm)
        return shape / float(np.median(shape)), False
    return size, True


class Whitener:
    """W with W V W^T = 1 for the covariance V of the samples. `apply` takes (N,) or (N, k)."""

    def __init__(self, data: Observations, noise: Noise, about: Linear) -> None:
        self._grid = Grid.of(data)
        self._std = noise.scale * about.base_N
        self._alike = Alike.of(noise, self._grid)
        shared = np.column_stack([noise.gain * about.force_N, noise.zero_mm * about.slope_N_per_mm])
        table = self._decorrelate(shared)
        left, size, _ = np.linalg.svd(table, full_matrices=False)  # a press at a time: (M, T, 2)
        self._left = left
        self._shrink = 1 - 1 / np.sqrt(1 + size**2)

    def apply(self, values: Floats) -> Floats:
        """W values."""
        table = self._decorrelate(values.reshape(values.shape[0], -1))
        inner = np.einsum("mtr,mtk->mrk", self._left, table)
        table = table - np.einsum("mtr,mrk->mtk", self._left, self._shrink[:, :, None] * inner)
        return np.asarray(table[self._grid.real].reshape(values.shape))

    def colour(self, values: Floats) -> Floats:
        """The inverse of `apply`: white numbers (N, k) become errors in N."""
        table = self._padded(values.reshape(values.shape[0], -1))
        grow = 1 / (1 - self._shrink) - 1
        inner = np.einsum("mtr,mtk->mrk", self._left, table)
        table = table + np.einsum("mtr,mrk->mtk", self._left, grow[:, :, None] * inner)
        table = self._alike.correlate(table)
        flat = table[self._grid.real] * self._std[:, None]
        return np.asarray(flat.reshape(values.shape))

    def _padded(self, columns: Floats) -> Floats:
        return np.asarray(columns[self._grid.rows] * self._grid.real[:, :, None])

    def _decorrelate(self, columns: Floats) -> Floats:
        return self._alike.decorrelate(self._padded(columns / self._std[:, None]))


@dataclass(frozen=True, slots=True)
class Alike:
    """What neighbours share: the std of each sample's innovation (T,), and how far it moves what is expected next.

    White noise beside noise with a memory is itself no simple memory: a Kalman filter tells the innovation from
    what was to be expected. Source: Kalman, J. Basic Eng. 82 (1960) 35.
    """

    std: Floats
    gain: Floats
    correlation: float

    @classmethod
    def of(cls, noise: Noise, grid: Grid) -> Alike:
        """The filter's steps for a process of variance 1."""
        std, gain, expected = [], [], 1 - noise.white
        for _ in range(grid.rows.shape[1]):
            std.append(float(np.sqrt(expected + noise.white)))
            gain.append(expected / (expected + noise.white))
            known = expected * (1 - gain[-1])
            expected = noise.correlation**2 * known + (1 - noise.correlation**2) * (1 - noise.white)
        return cls(np.array(std), np.array(gain), noise.correlation)

    def decorrelate(self, table: Floats) -> Floats:
        """The innovation of columns (M, T, k), white where the columns are such noise."""
        if not self.correlation:
            return table
        from scipy.linalg.lapack import dtbtrs

        along = np.ascontiguousarray(table.transpose(0, 2, 1))  # (M, k, T)
        told, kept = self.correlation * self.gain, self.correlation * (1 - self.gain)
        begun = np.zeros_like(along)
        begun[..., 1:] = told[:-1] * along[..., :-1]
        columns = begun.reshape(-1, self.std.size).T
        expected, _ = dtbtrs(np.array([np.ones_like(kept), -kept]), columns, uplo="L", diag="U", overwrite_b=True)
        return np.asarray((along - expected.T.reshape(along.shape)).transpose(0, 2, 1) / self.std[:, None])

    def correlate(self, innovation: Floats) -> Floats:
        """The inverse."""
        if not self.correlation:
            return innovation
        table, expected = np.empty_like(innovation), np.zeros_like(innovation[:, 0])
        for k, (std, gain) in enumerate(zip(self.std, self.gain, strict=True)):
            new = std * innovation[:, k]
            table[:, k] = expected + new
            expected = self.correlation * (expected + gain * new)
        return table

    def log_volume(self, grid: Grid) -> float:
        """ln det of the covariance of such noise."""
        return float(2 * np.sum(grid.real * np.log(self.std)))
