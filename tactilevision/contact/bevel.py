"""Onset of the bevel's touch, from the gel between the punch and its bevel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.contact.footprint import sample
from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.measured import Floats, Pair
from tactilevision.robust import mad_std, second_difference_std

# Onset of a signal's rise from a smooth course (broken stick with a curved rise):
#
#     y(x) = b0 + b1 x + b2 x² + A [k d + (1 - k) (√(d² + L²) - L)],   d = max(x - x0, 0),  0 <= k <= 1
#
# x is the depth of the punch in mm, y the signal. The smooth part contains what does not come from the touch (a
# tilted punch or a gain that differs between the sides is linear in x); b2 has a prior of 0. Of the dent, the gel
# that a touching edge drags along is linear in d, with the share k; the wedge beyond the edge grows in d² until it
# fills the window over which the signal is averaged, at d about L, and linearly then. For each x0 of a grid the
# rest is linear least squares; mean and standard deviation of x0 are those of the likelihood over the grid. The
# noise is estimated from the residuals, and is assumed independent between frames.

_BEND = 0.02  # prior std of the smooth part's change of slope over the range of x
_GRID = 161  # onsets that are tried, from a twentieth of the range of depth on
_RIDGE = 1e-6  # of normal equations in units of the noise: negligible, except for constant readings


@dataclass(frozen=True, slots=True)
class Growth:
    """Growth of the signal beyond its onset: the share k, and L in mm (0: linear)."""

    share: float = 1.0
    fill_mm: float = 0.0

    def __call__(self, beyond_mm: npt.ArrayLike) -> Floats:
        """Return the growth at depths beyond the onset (any shape); 0 before it."""
        d = np.maximum(np.asarray(beyond_mm, dtype=np.float64), 0.0)
        wedge = np.hypot(d, self.fill_mm) - self.fill_mm
        return np.asarray(self.share * d + (1 - self.share) * wedge, dtype=np.float64)


_LINEAR = Growth()


@dataclass(frozen=True, slots=True)
class Onset:
    """x0 and its std; A and its std, the shape of its `growth`; `noise` of y.

    `shared_std` is the part of x0's std that all presses of one bevel have in common, since they share the shape.
    `gain` is the decrease of chi-square by the onset, about the square of the detection's sigmas; `chi2` is that
    of the fit, at the given or estimated noise.
    """

    at: float
    std: float
    amplitude: float
    amplitude_std: float
    growth: Growth
    noise: float
    gain: float
    chi2: float
    shared_std: float = 0.0

    def signal(self, x: Floats) -> Floats:
        """Return what the onset adds to the smooth course at x."""
        return np.asarray(self.amplitude * self.growth(x - self.at), dtype=np.float64)


def find_onset(
    x: Floats, y: Floats, *, growth: Growth = _LINEAR, amplitude: Pair | None = None, noise: float | None = None
) -> Onset | None:
    """Find the onset of a rise of y over x (N,); None if there are too few readings or y only falls.

    `amplitude` (mean, std) is a prior of A from other presses; `noise` of y is estimated if it is not given.
    """
    sums = onset_sums(x, y, growth.fill_mm)
    if noise or sums is None:
        return onset_of(sums, growth, noise=noise or 0.0, amplitude=amplitude)
    x, y = sums.x, sums.y
    keep, scatter = np.ones(x.size, dtype=bool), _scatter(x, y)
    for _ in range(2):  # again with the noise of the better model, without outliers
        search = _search(sums, growth, noise=scatter, amplitude=amplitude)
        best = int(search.chi2.argmin())
        smooth, rise = _smooth(x) @ search.smooth[best], search.amplitude[best] * growth(x - sums.places[best])
        residual = y - smooth - rise
        scatter = _spread(residual[keep], 5)
        keep = np.abs(residual) < 6 * scatter
        sums = onset_sums(x[keep], y[keep], growth.fill_mm)
        if sums is None:
            return None
    return onset_of(sums, growth, noise=scatter, amplitude=amplitude)


@dataclass(frozen=True, slots=True)
class OnsetSums:
    """Sums over readings x, y (N,) for onsets at `places` (G,), whatever the noise and the share of the growth.

    With S (N, 3) the smooth course, D (G, 2, N) the growth's parts, d and the wedge: S'S, S'y, D S, D D', D y.
    """

    x: Floats
    y: Floats
    places: Floats
    smooth: Floats
    smooth_y: Floats
    growth_smooth: Floats
    growth: Floats
    growth_y: Floats


def onset_sums(x: Floats, y: Floats, fill_mm: float) -> OnsetSums | None:
    """Return the sums of readings (N,) for growths of length `fill_mm`; None where there are too few readings."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if x.size < 7 or np.ptp(x) <= 0:
        return None
    places = np.linspace(x.min() + 0.05 * np.ptp(x), x.max(), _GRID)
    beyond, smooth = x - places[:, None], _smooth(x)
    parts = np.stack([Growth(share, fill_mm)(beyond) for share in (1.0, 0.0)], axis=1)
    return OnsetSums(
        x, y, places, smooth.T @ smooth, smooth.T @ y, parts @ smooth, parts @ parts.transpose(0, 2, 1), parts @ y
    )


def onset_of(
    sums: OnsetSums | None, growth: Growth, *, noise: float, amplitude: Pair | None = None
) -> Onset | None:
    """Return the onset at a known noise of y, as find_onset; None without sums, or if y only falls."""
    if sums is None:
        return None
    return _summary(_search(sums, growth, noise=noise, amplitude=amplitude), noise, growth)


@dataclass(frozen=True, slots=True)
class _Search:
    places: Floats  # (G,)
    chi2: Floats  # (G,)
    smooth: Floats  # (G, 3)
    amplitude: Floats  # (G,)
    amplitude_std: Floats  # (G,)
    flat: float


def _search(sums: OnsetSums, growth: Growth, *, noise: float, amplitude: Pair | None) -> _Search:
    """Compute the penalised chi-square over a grid of x0, and without any onset.

    The smooth course's three coefficients are eliminated first, once for all x0.
    """
    span, weight, parts = float(np.ptp(sums.x)), 1 / noise**2, np.array([growth.share, 1 - growth.share])
    bend = np.diag([0.0, 0.0, (span / _BEND) ** 2])
    inverse = np.linalg.inv(weight * sums.smooth + bend + _RIDGE * np.eye(3))
    course = inverse @ (weight * sums.smooth_y)
    cross = weight * (parts @ sums.growth_smooth)
    carried = cross @ inverse
    square = weight * (parts @ sums.growth @ parts) + _RIDGE
    right = weight * (sums.growth_y @ parts)
    flat = weight * float(sums.y @ sums.y - sums.smooth_y @ course)
    constant = flat
    if amplitude is not None:
        square += 1 / amplitude[1] ** 2
        right += amplitude[0] / amplitude[1] ** 2
        constant += (amplitude[0] / amplitude[1]) ** 2
    square = np.maximum(square - (carried * cross).sum(axis=1), _RIDGE)  # never below, but for rounding
    found = (right - cross @ course) / square
    chi2 = constant - square * found**2
    chi2 = np.where(found > 0, chi2, np.maximum(chi2, flat))
    return _Search(sums.places, chi2, course - carried * found[:, None], found, 1 / np.sqrt(square), flat)


def _smooth(x: Floats) -> Floats:
    """Return the smooth course's basis functions (N, 3)."""
    return np.stack([np.ones_like(x), x, x * x], axis=-1)


def _summary(search: _Search, noise: float, growth: Growth) -> Onset | None:
    best = int(search.chi2.argmin())
    amplitude = float(search.amplitude[best])
    if amplitude <= 0:
        return None
    likelihood = np.exp(-0.5 * (search.chi2 - search.chi2[best]))
    likelihood[search.amplitude <= 0] = 0
    likelihood /= likelihood.sum()
    at = float(likelihood @ search.places)
    step = float(search.places[1] - search.places[0])
    variance = float(likelihood @ (search.places - at) ** 2) + step**2 / 12
    return Onset(
        at=at,
        std=float(np.sqrt(variance)),
        amplitude=amplitude,
        amplitude_std=float(search.amplitude_std[best]),
        growth=growth,
        noise=noise,
        gain=search.flat - float(search.chi2[best]),
        chi2=float(search.chi2[best]),
    )


def _scatter(x: Floats, y: Floats) -> float:
    """Return the noise of y from second differences along x, which a smooth course hardly affects."""
    order = np.argsort(x, kind="stable")
    return max(second_difference_std(y[order]), TINY + 1e-6 * float(np.ptp(y)))


def _spread(residual: Floats, parameters: int) -> float:
    robust = mad_std(residual, centre=0.0)
    freedom = max(residual.size - parameters, 1)
    return max(robust, 0.7 * float(np.sqrt((residual**2).sum() / freedom)), _EXACT)


# Signals of the bevel's touch. A strip is the mean of a field over the width of the line from the punch's axis to
# its bevel, against the distance s from the axis: s > 0 on the bevel's side, s < 0 on the mirrored one. The height
# map's signal is the dent along the bevel's edge, less the same on the mirrored side: the rise of the gel, the
# gain and a drifting light are equal on both and cancel. The picture's signal is the change of its colours there,
# along the change by the touch. Distances in mm.

SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "bottom": (0.0, 1.0), "top": (0.0, -1.0)}
STEP_MM = 0.1  # mm between the places of a strip, about a pixel
HALF_WIDTH_MM = 1.5  # along a straight edge at twice the radius the gel's rise is even within that
EDGE_MM = 0.15  # to both sides of the bevel's edge: the width of a shallow dent
FLANK_MM = (0.6, 1.2)  # from the edge: near enough to share its long-waved noise, outside the dent
_CLEAR = 2.0  # stds before a first onset, until when the picture counts as untouched; tests/contact/test_onset
_LATE = 0.3  # of the largest growth, from which the picture's change is the template
_MIN_FRAMES = 3  # before the onset, for a straight course
_WALL_MM = 0.4  # beyond the punch's edge: its steep wall
_EXACT = 1e-12  # noise of exact readings: below the rounding of a constant picture, which is no signal


def mean_distance_mm(distance_mm: float) -> float:
    """Return the mean distance from the axis, over the strip's width, of an edge `distance_mm` off at its
    nearest.
    """
    return float(np.hypot(distance_mm, HALF_WIDTH_MM / np.sqrt(3)))


def strip_places(reach_mm: float) -> Floats:
    """Return the distances s (n,) of a strip in mm, symmetric about the axis, out to `reach_mm`."""
    count = int(np.floor(reach_mm / STEP_MM))
    return np.linspace(-count, count, 2 * count + 1) * STEP_MM


def strip(field: npt.NDArray[Any], centre_px: Pair, *, px_per_mm: Pair, side: str, reach_mm: float) -> Floats:
    """Return the mean of `field` (H, W[, C]) over the strip's width at strip_places(reach_mm), (S[, C]).

    NaN out of view.
    """
    s, t = np.meshgrid(strip_places(reach_mm), np.arange(-HALF_WIDTH_MM, HALF_WIDTH_MM + ROUNDING, STEP_MM))
    along, across = SIDES[side], (-SIDES[side][1], SIDES[side][0])
    x = centre_px[0] + (along[0] * s + across[0] * t) * px_per_mm[0]
    y = centre_px[1] + (along[1] * s + across[1] * t) * px_per_mm[1]
    values = sample(field, np.stack([x, y], axis=-1))
    seen = np.isfinite(values)
    enough = seen.mean(axis=0) > 0.5
    mean = np.where(seen, values, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return np.where(enough, mean, np.nan)


def height_signal(strips: Floats, s: Floats, *, distance_mm: float, radius_mm: float) -> Floats | None:
    """Return the depth (N,) at the bevel's edge less that of its surroundings, less the same on the mirrored side.

    The noise of a height map is long-waved (slopes are integrated) and cancels, the dent of a touching edge is
    short. None if the edge is out of view.
    """
    here = _dent(strips, s, distance_mm, radius_mm)
    if here is None:
        return None
    mirrored = _dent(strips, -s, distance_mm, radius_mm)
    return here if mirrored is None else here - mirrored


def _dent(strips: Floats, s: Floats, distance_mm: float, radius_mm: float) -> Floats | None:
    edge = _mean(strips, s, distance_mm - EDGE_MM, distance_mm + EDGE_MM)
    outer = _mean(strips, s, distance_mm + FLANK_MM[0], distance_mm + FLANK_MM[1])
    first = max(distance_mm - FLANK_MM[1], radius_mm + _WALL_MM)
    inner = _mean(strips, s, first, distance_mm - FLANK_MM[0])
    flanks = [flank for flank in (inner, outer) if flank is not None]
    if edge is None or not flanks:
        return None
    return np.asarray(edge - np.mean(flanks, axis=0), dtype=np.float64)


def _mean(strips: Floats, s: Floats, first: float, last: float) -> Floats | None:
    chosen = strips[:, (s >= first - ROUNDING) & (s <= last + ROUNDING)]
    if chosen.shape[1] == 0 or not np.isfinite(chosen).all():
        return None
    return np.asarray(chosen.mean(axis=1), dtype=np.float64)


def picture_signal(
    colours: Floats, s: Floats, *, depth_mm: Floats, distance_mm: float, onset: Onset
) -> Floats | None:
    """Return the change of the colours (N, S, 3) next to the bevel's edge, along the change after a first onset.

    The course of each colour and place before the onset, straight in depth, is subtracted; the mean change long
    after it is the template, which does not depend on an error of the onset of some deviations. Colours are
    weighted by their noise, places are not, since those where a late onset fits best would weigh most. In units of
    the template, growing with the depth beyond the touch. None if the touch does not show in the colours.
    """
    near = np.asarray(np.abs(s - distance_mm) <= FLANK_MM[1])
    traces = colours[:, near].reshape(len(colours), -1).astype(np.float64)
    seen = np.isfinite(traces).all(axis=0)
    grown = onset.growth(depth_mm - onset.at)
    before, late = depth_mm < onset.at - _CLEAR * onset.std, grown > _LATE * grown.max()
    if before.sum() < _MIN_FRAMES:
        before = depth_mm < onset.at
    if not seen.any() or before.sum() < _MIN_FRAMES or not grown.any():
        return None
    course = np.c_[np.ones_like(depth_mm), depth_mm]
    coefficients, *_ = np.linalg.lstsq(course[before], traces[np.ix_(before, seen)], rcond=None)
    change = np.zeros_like(traces)
    change[:, seen] = traces[:, seen] - course @ coefficients
    template = grown[late] @ change[late] / (grown[late] @ grown[late])
    if np.abs(template).max() <= ROUNDING * np.abs(traces[:, seen]).max():  # pictures that do not change
        return None
    scatter = change[before].reshape(int(before.sum()), -1, colours.shape[-1])
    noise = np.sqrt((scatter**2).mean(axis=(0, 1))) + TINY
    weights = template / np.resize(noise, template.size) ** 2
    strength = float(weights @ template)
    return np.asarray(change @ weights / strength, dtype=np.float64) if strength > 0 else None
