"""The error model: what one sample, and what one press, adds at random.

    y = f + G u + e,    G = [f, df/dw],    u ~ N(0, diag(gain^2, zero^2)) anew for each press,
    e_i ~ N(0, scale^2 b_i^2),             correlation (1 - white) rho^k between samples k apart in one press

f is the model's force. b is the stated noise, depth carried over by the slope: b^2 = std_F^2 + (df/dw)^2 std_w^2
(effective variance: Orear, Am. J. Phys. 50 (1982) 912), or 1 N where nobody stated any: scale is then in N.
Samples of one press are no repeats: whitening takes their common part out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.inputs.observations import Observations
from calibration.noise.rectangles import Rectangle, rectangles
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

    def of_press_N(self, about: Linear) -> float:
        """What a press's gain and zero make of its force, N, rms over the samples."""
        parts = np.stack([self.gain * about.force_N, self.zero_mm * about.slope_N_per_mm])
        return float(np.sqrt(np.mean(np.sum(parts**2, axis=0))))

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


def depth_share(data: Observations, slope_N_per_mm: Floats) -> Floats:
    """The share (N,) of a sample's variance b^2 that its depth reading brings; 0 where none is known."""
    carried = np.square(np.nan_to_num(slope_N_per_mm * data.depth_std_mm))
    of_force = np.square(np.nan_to_num(data.force_std_N))
    if not base_noise(data, slope_N_per_mm)[1]:
        carried, of_force = np.square(data.depth_over_force_noise * slope_N_per_mm), np.ones(data.size)
    return np.asarray(carried / (carried + of_force))


class Whitener:
    """W with W V W^T = 1 for the covariance V of the samples. `apply` takes (N,) or (N, k)."""

    def __init__(self, data: Observations, noise: Noise, about: Linear) -> None:
        self._parts = rectangles(data)
        self._std = noise.scale * about.base_N
        self._alike = Alike.of(noise, data)
        shared = np.column_stack([noise.gain * about.force_N, noise.zero_mm * about.slope_N_per_mm])
        self._shared = [
            _Shared.of(self._alike.innovations(part, shared / self._std[:, None])) for part in self._parts
        ]

    def apply(self, values: Floats) -> Floats:
        """W values."""
        columns = values.reshape(values.shape[0], -1) / self._std[:, None]
        pairs = zip(self._parts, self._shared, strict=True)
        tables = [shared.add(self._alike.innovations(part, columns), -shared.shrink) for part, shared in pairs]
        return self._flat(tables).reshape(values.shape)

    def colour(self, values: Floats) -> Floats:
        """The inverse of `apply`: white numbers (N, k) become errors in N."""
        columns = values.reshape(values.shape[0], -1)
        pairs = zip(self._parts, self._shared, strict=True)
        back = [(part.padded(columns), shared, 1 / (1 - shared.shrink) - 1) for part, shared in pairs]
        tables = [self._alike.correlate(shared.add(table, share)) for table, shared, share in back]
        return np.asarray((self._flat(tables) * self._std[:, None]).reshape(values.shape))

    def of_samples(self, values: Floats) -> Floats:
        """What of errors (N,) the samples' own noise is expected to bring; the rest is what a press shares."""
        white = self.apply(values)[:, None]
        pairs = [(part.padded(white), shared) for part, shared in zip(self._parts, self._shared, strict=True)]
        tables = [self._alike.correlate(shared.add(table, -shared.shrink)) for table, shared in pairs]
        return np.asarray(self._flat(tables)[:, 0] * self._std)

    def _flat(self, tables: Sequence[Floats]) -> Floats:
        """The samples (N, k) of rectangles (m, t, k)."""
        if len(tables) == 1:
            return np.asarray(tables[0][self._parts[0].real])
        flat = np.empty((self._std.size, tables[0].shape[2]))
        for part, table in zip(self._parts, tables, strict=True):
            flat[part.rows[part.real]] = table[part.real]
        return flat


@dataclass(frozen=True, slots=True)
class _Shared:
    """What the samples of a press share: directions `left` (m, t, 2), `shrink` (m, 2) along them."""

    left: Floats
    shrink: Floats

    @classmethod
    def of(cls, columns: Floats) -> _Shared:
        """From gain and zero in units of a sample's noise, (m, t, 2)."""
        left, size, _ = np.linalg.svd(columns, full_matrices=False)  # a press at a time
        return cls(left, 1 - 1 / np.sqrt(1 + size**2))

    def add(self, table: Floats, share: Floats) -> Floats:
        """The table (m, t, k) and so much again, `share` (m, 2), of what lies along them."""
        inner = np.einsum("mtr,mtk->mrk", self.left, table)
        return np.asarray(table + np.einsum("mtr,mrk->mtk", self.left, share[:, :, None] * inner))


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
    def of(cls, noise: Noise, data: Observations) -> Alike:
        """The filter's steps for a process of variance 1, as many as the longest press has."""
        steps = max(part.rows.shape[1] for part in rectangles(data))
        variance: list[float] = []
        expected = 1 - noise.white
        while len(variance) < steps and variance[-1:] != [expected]:  # until nothing changes any more
            variance.append(expected)
            known = expected * (1 - expected / (expected + noise.white))
            expected = noise.correlation**2 * known + (1 - noise.correlation**2) * (1 - noise.white)
        settled = np.pad(variance, (0, steps - len(variance)), mode="edge")
        return cls(np.sqrt(settled + noise.white), settled / (settled + noise.white), noise.correlation)

    def innovations(self, part: Rectangle, columns: Floats) -> Floats:
        """The innovation (m, t, k) of columns (N, k) by press; 0 where there is no sample."""
        table = self.decorrelate(part.padded(columns))
        return table * part.real[:, :, None] if self.correlation else table

    def decorrelate(self, table: Floats) -> Floats:
        """The innovation of columns (M, T, k), white where the columns are such noise."""
        if not self.correlation:
            return table
        from scipy.linalg.lapack import dtbtrs

        along = np.ascontiguousarray(table.transpose(0, 2, 1))  # (M, k, T)
        gain, std = self.gain[: table.shape[1]], self.std[: table.shape[1]]
        told, kept = self.correlation * gain, self.correlation * (1 - gain)
        begun = np.zeros_like(along)
        begun[..., 1:] = told[:-1] * along[..., :-1]
        columns = begun.reshape(-1, std.size).T
        expected, _ = dtbtrs(np.array([np.ones_like(kept), -kept]), columns, uplo="L", diag="U", overwrite_b=True)
        return np.asarray((along - expected.T.reshape(along.shape)).transpose(0, 2, 1) / std[:, None])

    def correlate(self, innovation: Floats) -> Floats:
        """The inverse."""
        if not self.correlation:
            return innovation
        table, expected = np.empty_like(innovation), np.zeros_like(innovation[:, 0])
        for k, gain in enumerate(self.gain[: innovation.shape[1]]):
            new = self.std[k] * innovation[:, k]
            table[:, k] = expected + new
            expected = self.correlation * (expected + gain * new)
        return table

    def log_volume(self, parts: Sequence[Rectangle]) -> float:
        """ln det of the covariance of such noise."""
        return float(sum(2 * np.sum(part.real * np.log(self.std[: part.rows.shape[1]])) for part in parts))
