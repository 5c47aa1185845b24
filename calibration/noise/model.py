"""The error model: what one sample and one press add at random, and a test for equal variances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.inputs.denoised_depth import LOAD, branches
from calibration.inputs.observations import Ints, Observations
from tactilevision.records.measured import Bools, Floats

# Samples of presses as rectangles, one row a press: one for all, unless presses much longer than most would make
# it mostly padding.

KEPT = 8  # data sets of which the rectangles are kept: a fit asks for them at every step
ROOMY = 200_000  # cells that one rectangle may have, however much of it is padding
MOST_PADDED = 2  # times as long as the shortest press of its rectangle is the longest, beyond that


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Some presses as (m, t): `rows` indices into all samples, `real` False where padded."""

    rows: Ints
    real: Bools

    def padded(self, values: Floats) -> Floats:
        """Columns (N, k) as (m, t, k), 0 where there is no sample."""
        return np.asarray(values[self.rows] * self.real[:, :, None])


@lru_cache(maxsize=KEPT)
def rectangles(data: Observations) -> tuple[Rectangle, ...]:
    """All presses, each in one of them, padded at its end by its last sample."""
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


# The error model: what one sample, and what one press, adds at random.
#
#     y = f + G u + e,    G = [f, df/dw],    u ~ N(0, diag(gain^2, zero^2)) anew for each press,
#     e_i ~ N(0, scale^2 b_i^2),             correlation (1 - white) rho^k between samples k apart in one press
#
# f is the model's force. b is the stated noise, depth carried over by the slope: b^2 = std_F^2 + (df/dw)^2 std_w^2
# (effective variance: Orear, Am. J. Phys. 50 (1982) 912), or 1 N where nobody stated any: scale is then in N.
# Samples of one press are no repeats: whitening takes their common part out.

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


# Does the scatter itself depend on what the punch does? What comes at random places has no mean to be seen.
#
# A gel that sticks and slips, a contact that rattles: the force jumps at another depth in each press, so no
# covariate's mean shows it, but the samples of loading scatter more than those of the hold and the way back. For
# each press
#
#     d = mean v_i^2 over loading less the same over the rest,
#
# v the white residual. Student's t of d over the presses, where above 0, squared.
# A heavy tail widens t's own spread and noise that is correlated throughout cancels, so neither passes for it. The
# mean under the model comes from its bootstrap.

MIN_PRESSES = 6  # that show both loading and rest; fewer cannot say that one scatters more
MIN_SAMPLES = 3  # of each in a press, to have a scatter at all


class Scatter:
    """The statistic for residuals of one set of measurements; `seen` False where they cannot show it."""

    def __init__(self, data: Observations) -> None:
        loading = branches(data) == LOAD
        self._parts = [(p, loading[p.rows] & p.real, ~loading[p.rows] & p.real) for p in rectangles(data)]
        enough = [_enough(load) & _enough(rest) for _, load, rest in self._parts]
        self._use = np.concatenate(enough)
        self.seen = bool(np.count_nonzero(self._use) >= MIN_PRESSES)

    def differences(self, white: Floats) -> Floats:
        """d of each press (M',), for a white residual (N,)."""
        tables = [(white[part.rows] ** 2, load, rest) for part, load, rest in self._parts]
        d = np.concatenate([_mean(table, load) - _mean(table, rest) for table, load, rest in tables])
        return np.asarray(d[self._use])

    def statistic(self, d: Floats, expected: float) -> float:
        """t^2 of `differences` d against the mean that the model lets expect; 0 where loading scatters less."""
        error = max(float(d.std(ddof=1)) / np.sqrt(d.size), 1e-300)
        return float(max((d.mean() - expected) / error, 0.0) ** 2)


def _enough(where: Bools) -> Bools:
    return np.asarray(where.sum(axis=1) >= MIN_SAMPLES)


def _mean(values: Floats, where: Bools) -> Floats:
    return np.asarray(np.sum(values * where, axis=1) / np.maximum(where.sum(axis=1), 1))
