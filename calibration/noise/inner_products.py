"""Inner products under the error model, worked out once for every size of its parts.

    A^T V^-1 B = sum over presses of (A^T B - A^T G S (1 + S G^T G S)^-1 S G^T B) / scale^2

S = diag(gain, zero)/scale, columns in units of a sample's own noise and with their correlation taken out: only
G's part depends on the sizes, and of each press it is 2 x 2 (Woodbury's identity). A search for the sizes, and a
bootstrap that estimates them anew for each draw, then never touch the samples again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.inputs.observations import Observations
from calibration.noise.model import Alike, Linear, Noise
from calibration.noise.rectangles import rectangles
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns (N, k) as the error model weighs them: `tables` (m, t, k), one a rectangle of presses, and `beside`
    (M, 2, k) with gain and zero.
    """

    tables: Sequence[Floats]
    beside: Floats

    @property
    def flat(self) -> Floats:
        """(cells, k)."""
        return _joined([table.reshape(-1, table.shape[2]) for table in self.tables])


@dataclass(frozen=True, slots=True)
class Product:
    """A^T V^-1 B for any sizes: `rest` (a, b), `left` (M, 2, a), `right` (M, 2, b), `common` (M, 2, 2).

    With `rest` (b,) A and B are the same, and only the diagonal is meant.
    """

    rest: Floats
    left: Floats
    right: Floats
    common: Floats

    def under(self, noise: Noise) -> Floats:
        """At these sizes, (a, b) or (b,)."""
        return np.asarray(self.under_each([noise])[0])

    def under_each(self, noises: Sequence[Noise]) -> Floats:
        """At the sizes of each, (n, a, b) or (n, b)."""
        square = _squares(noises)
        weight = inverse_beside_one(self.common * square)[0] * square
        right = weight @ self.right
        if self.rest.ndim == 1:
            lost = np.sum(self.left * right, axis=(1, 2))
        else:
            lost = self.left.reshape(-1, self.left.shape[2]).T @ right.reshape(len(noises), -1, right.shape[3])
        scale = np.array([noise.scale for noise in noises]).reshape(-1, *[1] * self.rest.ndim)
        return np.asarray((self.rest - lost) / scale**2)

    def of(self, k: int) -> Product:
        """With the k-th column of B alone; of a diagonal its k-th number."""
        left = self.left if self.rest.ndim > 1 else self.left[:, :, k : k + 1]
        return Product(self.rest[..., k : k + 1], left, self.right[:, :, k : k + 1], self.common)


class Weighing:
    """What the samples of some presses weigh, about one model: of `noise` only how alike neighbours are."""

    def __init__(self, data: Observations, about: Linear, noise: Noise) -> None:
        self._parts, self._base = rectangles(data), about.base_N
        self._alike = Alike.of(noise, data)
        self._shared = self._weighed(np.column_stack([about.force_N, about.slope_N_per_mm]))
        self._common = self._beside(self._shared)

    def take(self, columns: Floats) -> Columns:
        """Columns (N, k), N."""
        tables = self._weighed(columns)
        return Columns(tables, self._beside(tables))

    def product(self, one: Columns, other: Columns) -> Product:
        """Of all of one with all of the other."""
        return Product(one.flat.T @ other.flat, one.beside, other.beside, self._common)

    def squares(self, one: Columns) -> Product:
        """Of each column with itself."""
        rest = sum(np.einsum("mtk,mtk->k", table, table) for table in one.tables)
        return Product(np.asarray(rest), one.beside, one.beside, self._common)

    def log_volume(self, noise: Noise) -> float:
        """ln det V, but for the samples' own noise at scale 1."""
        return float(self.log_volumes([noise])[0])

    def log_volumes(self, noises: Sequence[Noise]) -> Floats:
        """The same of each, (n,)."""
        _, volumes = inverse_beside_one(self._common * _squares(noises))
        scale = np.array([noise.scale for noise in noises])
        own = 2 * float(self._base.size) * np.log(scale) + self._alike.log_volume(self._parts)
        return np.asarray(own + np.sum(np.log(volumes), axis=1))

    def _weighed(self, columns: Floats) -> list[Floats]:
        scaled = columns / self._base[:, None]
        return [self._alike.innovations(part, scaled) for part in self._parts]

    def _beside(self, tables: Sequence[Floats]) -> Floats:
        """Gain and zero with these columns, (M, 2, k); presses in the order of the rectangles."""
        return _joined([s.transpose(0, 2, 1) @ t for s, t in zip(self._shared, tables, strict=True)])


def _joined(parts: Sequence[Floats]) -> Floats:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def inverse_beside_one(inner: Floats) -> tuple[Floats, Floats]:
    """(1 + A)^-1 and det(1 + A) for positive A (..., 2, 2): by hand, since sizes that a search only
    passes through make A so large that 1 is lost beside it.
    """
    a, b, d = inner[..., 0, 0], inner[..., 0, 1], inner[..., 1, 1]
    volume = 1 + a + d + np.maximum(a * d - b * b, 0.0)
    inverse = np.stack([1 + d, -b, -b, 1 + a], axis=-1) / volume[..., None]
    return inverse.reshape(inner.shape), volume


def _squares(noises: Sequence[Noise]) -> Floats:
    """Of each, the products of its gain and zero over its scale, (n, 1, 2, 2)."""
    size = np.array([[noise.gain / noise.scale, noise.zero_mm / noise.scale] for noise in noises])
    return np.asarray(size[:, None, :, None] * size[:, None, None, :])
