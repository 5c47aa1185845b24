"""When a signal leaves its smooth course: a broken stick, bent after the break.

    y(x) = b0 + b1 x + b2 x² + A [k d + (1 - k) (√(d² + L²) - L)],   d = max(x - x0, 0),  0 <= k <= 1

x is the depth of the punch in mm, y the signal. The smooth part takes up what is there from the start (a tilted
punch or a gain that differs between the sides is linear in x); b2 is held small against what x itself spans. Of
the growing dent, the gel that a touching edge drags along is linear in d; the wedge that lies on the gel beyond
the edge grows in d² until it fills the window that the signal is averaged over, at d about L, and linearly then.
The share k tells them apart. For each x0 of a grid the rest is linear least squares; the likelihood over the grid
gives x0 and its standard deviation, so a wide or lopsided valley is reported as it is. The noise comes from the
residuals, and is taken to be independent between frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.records import Floats, Pair
from tactilevision.robust import mad_std, second_difference_std

_BEND = 0.02  # the smooth part may change its slope over the range of x by this, one sigma
_GRID = 161  # places of the onset that are tried, from a twentieth of the range of depth on


@dataclass(frozen=True, slots=True)
class Growth:
    """How the signal grows beyond its onset: the share k, and L in mm (0: linear)."""

    share: float = 1.0
    fill_mm: float = 0.0

    def __call__(self, beyond_mm: npt.ArrayLike) -> Floats:
        """Growth at depths beyond the onset (any shape); 0 before it."""
        d = np.maximum(np.asarray(beyond_mm, dtype=np.float64), 0.0)
        wedge = np.hypot(d, self.fill_mm) - self.fill_mm
        return np.asarray(self.share * d + (1 - self.share) * wedge, dtype=np.float64)


_LINEAR = Growth()


@dataclass(frozen=True, slots=True)
class Onset:
    """x0 and its std; A and its std, the shape of its `growth`; `grown` is the signal at the end; `noise` of y.

    `shared_std` is the part of x0's std that all presses of one bevel have in common: they share the shape.

    `gain` is the fall of chi-square against no onset at all, about the square of the detection's sigmas;
    `chi2` what is left, at the noise handed in or found.
    """

    at: float
    std: float
    amplitude: float
    amplitude_std: float
    growth: Growth
    grown: float
    noise: float
    gain: float
    chi2: float
    shared_std: float = 0.0

    def signal(self, x: Floats) -> Floats:
        """What the onset adds to the smooth course at x."""
        return np.asarray(self.amplitude * self.growth(x - self.at), dtype=np.float64)


def find_onset(
    x: Floats, y: Floats, *, growth: Growth = _LINEAR, amplitude: Pair | None = None, noise: float | None = None
) -> Onset | None:
    """The onset of a rise of y over x (N,), or None where there are too few readings or y only falls.

    `amplitude` (mean, std) is what other presses say of A; `noise` of y is estimated where it is not given.
    """
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if x.size < 7 or np.ptp(x) <= 0:
        return None
    keep = np.ones(x.size, dtype=bool)
    scatter = noise or _scatter(x, y)
    search = _search(x, y, scatter, growth=growth, amplitude=amplitude)
    for _ in range(0 if noise else 2):  # again with the noise of the better model, without wild readings
        best = int(search.chi2.argmin())
        residual = y - _basis(x, search.places[[best]], growth)[0] @ search.coefficients[best]
        scatter = _spread(residual[keep], 5)
        keep = np.abs(residual) < 6 * scatter
        if keep.sum() < 7:
            return None
        search = _search(x[keep], y[keep], scatter, growth=growth, amplitude=amplitude)
    return _summary(x[keep], search, scatter, growth)


@dataclass(frozen=True, slots=True)
class _Search:
    places: Floats  # (G,)
    chi2: Floats  # (G,)
    coefficients: Floats  # (G, 4)
    amplitude_std: Floats  # (G,)
    flat: float


def _search(x: Floats, y: Floats, noise: float, *, growth: Growth, amplitude: Pair | None) -> _Search:
    """Penalised chi-square over a grid of x0, and without any onset."""
    span = float(np.ptp(x))
    places = np.linspace(x.min() + 0.05 * span, x.max(), _GRID)
    design = _basis(x, places, growth) / noise
    normal = design.transpose(0, 2, 1) @ design
    right = design.transpose(0, 2, 1) @ (y / noise)
    constant = float(((y / noise) ** 2).sum())
    normal[:, 2, 2] += (span / _BEND) ** 2
    normal += 1e-6 * np.eye(4)  # far below any reading: only for readings that are all alike
    if amplitude is not None:
        normal[:, 3, 3] += 1 / amplitude[1] ** 2
        right[:, 3] += amplitude[0] / amplitude[1] ** 2
        constant += (amplitude[0] / amplitude[1]) ** 2
    coefficients = np.linalg.solve(normal, right[..., None])[..., 0]
    chi2 = constant - (coefficients * right).sum(axis=1)
    flat_answer = np.linalg.solve(normal[-1, :3, :3], right[-1, :3])
    flat = float(((y / noise) ** 2).sum() - flat_answer @ right[-1, :3])
    chi2 = np.where(coefficients[:, 3] > 0, chi2, np.maximum(chi2, flat))
    spread = np.sqrt(np.linalg.inv(normal)[:, 3, 3])
    return _Search(
        places,
        np.asarray(chi2, dtype=np.float64),
        np.asarray(coefficients, dtype=np.float64),
        np.asarray(spread, dtype=np.float64),
        flat,
    )


def _basis(x: Floats, places: Floats, growth: Growth) -> Floats:
    """(places, readings, 4)."""
    after = growth(x[None, :] - places[:, None])
    smooth = np.broadcast_to(np.stack([np.ones_like(x), x, x * x], axis=-1), (places.size, x.size, 3))
    return np.asarray(np.concatenate([smooth, after[..., None]], axis=-1), dtype=np.float64)


def _summary(x: Floats, search: _Search, noise: float, growth: Growth) -> Onset | None:
    best = int(search.chi2.argmin())
    amplitude = float(search.coefficients[best, 3])
    if amplitude <= 0:
        return None
    likelihood = np.exp(-0.5 * (search.chi2 - search.chi2[best]))
    likelihood[search.coefficients[:, 3] <= 0] = 0
    at = float(np.average(search.places, weights=likelihood))
    step = float(search.places[1] - search.places[0])
    variance = float(np.average((search.places - at) ** 2, weights=likelihood)) + step**2 / 12
    return Onset(
        at=at,
        std=float(np.sqrt(variance)),
        amplitude=amplitude,
        amplitude_std=float(search.amplitude_std[best]),
        growth=growth,
        grown=amplitude * float(growth(float(x.max()) - at)),
        noise=noise,
        gain=search.flat - float(search.chi2[best]),
        chi2=float(search.chi2[best]),
    )


def _scatter(x: Floats, y: Floats) -> float:
    """Noise of y from second differences along x, which a smooth course hardly touches."""
    order = np.argsort(x, kind="stable")
    return max(second_difference_std(y[order]), 1e-9 + 1e-6 * float(np.ptp(y)))


def _spread(residual: Floats, parameters: int) -> float:
    robust = mad_std(residual, centre=0.0)
    freedom = max(residual.size - parameters, 1)
    return max(robust, 0.7 * float(np.sqrt((residual**2).sum() / freedom)), 1e-12)
