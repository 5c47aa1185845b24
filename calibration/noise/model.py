"""Error model of samples and presses, and a test for equal variances.

    y = f + G u + e,    G = [f, df/dw],    u ~ N(0, diag(gain^2, zero^2)) anew for each press,
    e_i ~ N(0, scale^2 b_i^2),             correlation (1 - white) rho^k between samples k apart in one press

f is the model's force. b is the stated noise with the depth's carried over by the slope, b^2 = std_F^2 + (df/dw)^2
std_w^2 (effective variance: Orear, Am. J. Phys. 50 (1982) 912), or 1 N where none is stated; scale is then in N.
Samples of one press are not independent: whitening removes their common part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.inputs.denoised_depth import LOAD, branches
from calibration.inputs.observations import Ints, Observations
from tactilevision.records.constants import KILO, NONZERO
from tactilevision.records.measured import Bools, Floats

KEPT = 8  # data sets whose rectangles are cached: a fit asks for them at every step
ROOMY = 200_000  # cells that one rectangle may have, however much of it is padding
MOST_PADDED = 2  # longest over shortest press of a rectangle, beyond that
STATED_DOF = 20  # readings by which a stated noise is taken to be known


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Samples of some presses as (m, t), one row a press: `rows` index all samples, `real` is False if padded."""

    rows: Ints
    real: Bools

    def padded(self, values: Floats) -> Floats:
        """Return columns (N, k) as (m, t, k), 0 where padded."""
        return np.asarray(values[self.rows] * self.real[:, :, None])


@lru_cache(maxsize=KEPT)
def rectangles(data: Observations) -> tuple[Rectangle, ...]:
    """Return all presses in one rectangle, or several where much longer presses would make it mostly padding."""
    first = data.first
    length = np.diff(np.append(first, data.size))
    if length.max() * length.size <= max(ROOMY, MOST_PADDED * data.size):
        return (_rectangle(first, length),)
    order, parts = np.argsort(-length, kind="stable"), []
    while order.size:
        count = int(np.count_nonzero(length[order] * MOST_PADDED >= length[order[0]]))
        parts.append(_rectangle(first[order[:count]], length[order[:count]]))
        order = order[count:]
    return tuple(parts)


def _rectangle(first: Ints, length: Ints) -> Rectangle:
    offset = np.arange(int(length.max()))
    rows = first[:, None] + np.minimum(offset, (length - 1)[:, None])
    return Rectangle(rows, offset < length[:, None])


@dataclass(frozen=True, slots=True)
class Noise:
    """Sizes of the noise: `scale` on the stated noise (or in N), `gain` (1) and `zero_mm` of a press.

    `correlation` of neighbouring samples, but for the share `white` of their variance; `dof` degrees of freedom;
    `stated`: the samples' noise was stated; `overstated`: repeats show significantly less than half of it, so it
    has no weight.
    """

    scale: float
    gain: float = 0.0
    zero_mm: float = 0.0
    correlation: float = 0.0
    white: float = 0.0
    dof: float = np.inf
    stated: bool = True
    overstated: bool = False

    @property
    def trust(self) -> float:
        """Degrees of freedom of the stated noise."""
        return STATED_DOF if self.stated and not self.overstated else 0.0

    def std_N(self, about: Linear) -> Floats:
        """Return the std (N,) of one sample of one press, N, by its own noise and the press's gain and zero."""
        return np.hypot(self.scale * about.base_N, self.of_press_N(about))

    def of_press_N(self, about: Linear) -> Floats:
        """Return the std (N,) of the force, N, by a press's gain and zero."""
        return np.hypot(self.gain * about.force_N, self.zero_mm * about.slope_N_per_mm)

    def parts(self, base_N: Floats) -> dict[str, float]:
        """Return the sizes for a report: mN a sample, per cent and um a press."""
        return {
            "sample_mN": KILO * self.scale * float(np.median(base_N)),
            "press_gain_percent": 100 * self.gain,
            "press_zero_um": KILO * self.zero_mm,
            "correlation": self.correlation,
        }


@dataclass(frozen=True, slots=True)
class Linear:
    """The model at its fit: force (N,), slope (N,), and a sample's noise at scale 1, `base_N` (N,)."""

    force_N: Floats
    slope_N_per_mm: Floats
    base_N: Floats


def base_noise(data: Observations, slope_N_per_mm: Floats) -> tuple[Floats, bool]:
    """Return b (N,) and whether it was stated; where not, its shape with a median of 1."""
    force, depth = data.force_std_N, slope_N_per_mm * data.depth_std_mm
    known = np.isfinite(force) | np.isfinite(depth)
    size = np.hypot(np.nan_to_num(force), np.nan_to_num(depth))
    if not (known.all() and (size > 0).all()):
        shape = np.hypot(1.0, data.depth_over_force_noise * slope_N_per_mm)
        return shape / float(np.median(shape)), False
    return size, True


def depth_share(data: Observations, slope_N_per_mm: Floats) -> Floats:
    """Return the share (N,) of a sample's variance b^2 that comes from its depth; 0 where it is not known."""
    carried = np.square(np.nan_to_num(slope_N_per_mm * data.depth_std_mm))
    of_force = np.square(np.nan_to_num(data.force_std_N))
    if not base_noise(data, slope_N_per_mm)[1]:
        carried, of_force = np.square(data.depth_over_force_noise * slope_N_per_mm), np.ones(data.size)
    return np.asarray(carried / (carried + of_force))


class Whitener:
    """Linear map W with W V W^T = 1 for the covariance V of the samples."""

    def __init__(self, data: Observations, noise: Noise, about: Linear) -> None:
        self._parts = rectangles(data)
        self._std = noise.scale * about.base_N
        self._filter = CorrelatedNoise.of(noise, data)
        shared = np.column_stack([noise.gain * about.force_N, noise.zero_mm * about.slope_N_per_mm])
        self._shared = [
            _Shared.of(self._filter.innovations(part, shared / self._std[:, None])) for part in self._parts
        ]

    def apply(self, values: Floats) -> Floats:
        """Return W values, of shape (N,) or (N, k)."""
        columns = values.reshape(values.shape[0], -1) / self._std[:, None]
        pairs = zip(self._parts, self._shared, strict=True)
        tables = [shared.add(self._filter.innovations(part, columns), -shared.shrink) for part, shared in pairs]
        return self._flat(tables).reshape(values.shape)

    def colour(self, values: Floats) -> Floats:
        """Return the inverse of `apply`: errors in N from white numbers (N, k)."""
        columns = values.reshape(values.shape[0], -1)
        pairs = zip(self._parts, self._shared, strict=True)
        back = [(part.padded(columns), shared, 1 / (1 - shared.shrink) - 1) for part, shared in pairs]
        tables = [self._filter.correlate(shared.add(table, share)) for table, shared, share in back]
        return np.asarray((self._flat(tables) * self._std[:, None]).reshape(values.shape))

    def of_samples(self, values: Floats) -> Floats:
        """Return the part of errors (N,) expected from the samples' own noise, without the part a press shares."""
        white = self.apply(values)[:, None]
        pairs = [(part.padded(white), shared) for part, shared in zip(self._parts, self._shared, strict=True)]
        tables = [self._filter.correlate(shared.add(table, -shared.shrink)) for table, shared in pairs]
        return np.asarray(self._flat(tables)[:, 0] * self._std)

    def _flat(self, tables: Sequence[Floats]) -> Floats:
        """Return the samples (N, k) of rectangles (m, t, k)."""
        if len(tables) == 1:
            return np.asarray(tables[0][self._parts[0].real])
        flat = np.empty((self._std.size, tables[0].shape[2]))
        for part, table in zip(self._parts, tables, strict=True):
            flat[part.rows[part.real]] = table[part.real]
        return flat


@dataclass(frozen=True, slots=True)
class _Shared:
    """Common part of the samples of a press: directions `left` (m, t, 2) and `shrink` (m, 2) along them."""

    left: Floats
    shrink: Floats

    @classmethod
    def of(cls, columns: Floats) -> _Shared:
        """Return that of gain and zero in units of a sample's noise, (m, t, 2)."""
        left, size, _ = np.linalg.svd(columns, full_matrices=False)  # a press at a time
        return cls(left, 1 - 1 / np.sqrt(1 + size**2))

    def add(self, table: Floats, share: Floats) -> Floats:
        """Return the table (m, t, k) plus `share` (m, 2) times its components along the directions."""
        inner = np.einsum("mtr,mtk->mrk", self.left, table)
        return np.asarray(table + np.einsum("mtr,mrk->mtk", self.left, share[:, :, None] * inner))


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """Kalman filter of correlated plus white noise: std of each sample's innovation (T,), and its gain (T,).

    Source: Kalman, J. Basic Eng. 82 (1960) 35.
    """

    std: Floats
    gain: Floats
    correlation: float

    @classmethod
    def of(cls, noise: Noise, data: Observations) -> CorrelatedNoise:
        """Return the filter of a process of variance 1, with as many steps as the longest press."""
        steps = max(part.rows.shape[1] for part in rectangles(data))
        variance: list[float] = []
        expected = 1 - noise.white
        while len(variance) < steps and variance[-1:] != [expected]:  # until the variance is stationary
            variance.append(expected)
            known = expected * (1 - expected / (expected + noise.white))
            expected = noise.correlation**2 * known + (1 - noise.correlation**2) * (1 - noise.white)
        settled = np.pad(variance, (0, steps - len(variance)), mode="edge")
        return cls(np.sqrt(settled + noise.white), settled / (settled + noise.white), noise.correlation)

    def innovations(self, part: Rectangle, columns: Floats) -> Floats:
        """Return the innovations (m, t, k) of columns (N, k) by press; 0 where padded."""
        table = self.decorrelate(part.padded(columns))
        return table * part.real[:, :, None] if self.correlation else table

    def decorrelate(self, table: Floats) -> Floats:
        """Return the innovations of columns (M, T, k), white where the columns are such noise."""
        if not self.correlation:
            return table
        from scipy.linalg.lapack import dtbtrs

        along = np.ascontiguousarray(table.transpose(0, 2, 1))  # (M, k, T)
        gain, std = self.gain[: table.shape[1]], self.std[: table.shape[1]]
        new, kept = self.correlation * gain, self.correlation * (1 - gain)
        begun = np.zeros_like(along)
        begun[..., 1:] = new[:-1] * along[..., :-1]
        columns = begun.reshape(-1, std.size).T
        expected, _ = dtbtrs(np.array([np.ones_like(kept), -kept]), columns, uplo="L", diag="U", overwrite_b=True)
        return np.asarray((along - expected.T.reshape(along.shape)).transpose(0, 2, 1) / std[:, None])

    def correlate(self, innovation: Floats) -> Floats:
        """Return the inverse of `decorrelate`."""
        if not self.correlation:
            return innovation
        table, expected = np.empty_like(innovation), np.zeros_like(innovation[:, 0])
        for k, gain in enumerate(self.gain[: innovation.shape[1]]):
            new = self.std[k] * innovation[:, k]
            table[:, k] = expected + new
            expected = self.correlation * (expected + gain * new)
        return table

    def log_volume(self, parts: Sequence[Rectangle]) -> float:
        """Return ln det of the covariance of such noise."""
        return float(sum(2 * np.sum(part.real * np.log(self.std[: part.rows.shape[1]])) for part in parts))


MIN_PRESSES = 6  # presses with both loading and other samples
MIN_SAMPLES = 3  # samples of each kind in a press


class Scatter:
    """Test whether samples of loading scatter more than the others, as in stick-slip; `seen`: data suffice.

        d = mean v_i^2 over loading - mean v_i^2 over the rest of a press,    v the white residual

    Stick-slip occurs at random depths, so no covariate's mean shows it. The statistic is Student's t of d over the
    presses, squared where above 0. A heavy tail widens t's own scatter, and noise that is correlated throughout
    cancels, so neither is significant.
    """

    def __init__(self, data: Observations) -> None:
        loading = branches(data) == LOAD
        self._parts = [(p, loading[p.rows] & p.real, ~loading[p.rows] & p.real) for p in rectangles(data)]
        enough = [_enough(load) & _enough(rest) for _, load, rest in self._parts]
        self._use = np.concatenate(enough)
        self.seen = bool(np.count_nonzero(self._use) >= MIN_PRESSES)

    def differences(self, white: Floats) -> Floats:
        """Return d of each press (M',), for a white residual (N,), or (M', k) for several (N, k)."""
        tables = [(white[part.rows] ** 2, load, rest) for part, load, rest in self._parts]
        d = np.concatenate([_mean(table, load) - _mean(table, rest) for table, load, rest in tables])
        return np.asarray(d[self._use])

    def statistic(self, d: Floats, expected: float) -> float:
        """Return t^2 of `differences` d about their expected mean; 0 where loading scatters less."""
        error = max(float(d.std(ddof=1)) / np.sqrt(d.size), NONZERO)
        return float(max((d.mean() - expected) / error, 0.0) ** 2)


def _enough(where: Bools) -> Bools:
    return np.asarray(where.sum(axis=1) >= MIN_SAMPLES)


def _mean(values: Floats, where: Bools) -> Floats:
    kept = where.reshape(*where.shape, *[1] * (values.ndim - 2))
    return np.asarray(np.sum(values * kept, axis=1) / np.maximum(kept.sum(axis=1), 1))
