"""Estimate the sizes of the error model by restricted maximum likelihood, with weak priors where repeats are few.

    -2 log L = sum over presses of log|V_p| + log|J^T V^-1 J + Lambda| + r^T P r

J holds the model's derivatives, Lambda the priors' precision; P projects the fitted part out. With few presses the
sizes of gain and zero are hardly determined: log-normal priors about .5 % and 4 um (a factor 2.7 either way) keep
them from collapsing to 0, and lose weight as presses are added. Sources: Patterson, Thompson, Biometrika 58 (1971)
545; Harville, J. Am. Stat. Assoc. 72 (1977) 320.

Inner products under the error model are computed once for every size of its parts:

    A^T V^-1 B = sum over presses of (A^T B - A^T G S (1 + S G^T G S)^-1 S G^T B) / scale^2,    S = diag(gain,
    zero)/scale

with columns decorrelated and in units of a sample's own noise. Only G's part depends on the sizes, a 2 x 2 matrix
a press (Woodbury's identity), so neither a search nor a bootstrap touches the samples again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Observations
from calibration.noise.model import STATED_DOF, CorrelatedNoise, Linear, Noise, rectangles
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns (N, k) weighted by the noise: `tables` (m, t, k), one a rectangle of presses.

    `shared` (M, 2, k) are their inner products with gain and zero.
    """

    tables: Sequence[Floats]
    shared: Floats

    @property
    def flat(self) -> Floats:
        """All tables as one, (cells, k)."""
        return _joined([table.reshape(-1, table.shape[2]) for table in self.tables])


@dataclass(frozen=True)
class Product:
    """A^T V^-1 B for any sizes: `rest` (a, b), `left` (M, 2, a), `right` (M, 2, b), `common` (M, 2, 2).

    With `rest` (b,) it is the diagonal alone, with A = B.
    """

    rest: Floats
    left: Floats
    right: Floats
    common: Floats

    def under(self, noise: Noise) -> Floats:
        """Return the product at these sizes, (a, b) or (b,)."""
        return np.asarray(self.under_each(sizes_of([noise]))[0])

    def under_each(self, sizes: Floats) -> Floats:
        """Return the product at each of the sizes (n, 3), (n, a, b) or (n, b)."""
        return self.weighted(weigh(self.common, sizes)[0], sizes[:, 0])

    def weighted(self, weight: Floats, scale: Floats) -> Floats:
        """Return the same at weights (n, M, 2, 2) and scales (n,) of the sizes."""
        if len(weight) > 3 * len(self.common):  # then a table of all products pays
            parts = weight[..., [0, 0, 1], [0, 1, 1]].swapaxes(1, 2)
            lost = (parts.reshape(len(weight), -1) @ self._shared).reshape(-1, *self.rest.shape)
        elif self.rest.ndim == 1:
            lost = np.sum(self.left * (weight @ self.right), axis=(1, 2))
        else:
            right = (weight @ self.right).reshape(len(weight), -1, self.right.shape[2])
            lost = self.left.reshape(-1, self.left.shape[2]).T @ right
        scale = scale.reshape(-1, *[1] * self.rest.ndim)
        return np.asarray((self.rest - lost) / scale**2)

    @cached_property
    def _shared(self) -> Floats:
        """Products of both with gain and zero, (3 M, a b): of gain, of one with the other, of zero."""
        (x, y), (u, v) = self.left.transpose(1, 0, 2), self.right.transpose(1, 0, 2)
        if self.rest.ndim > 1:
            x, y, u, v = x[:, :, None], y[:, :, None], u[:, None], v[:, None]
        return np.concatenate([x * u, x * v + y * u, y * v]).reshape(3 * len(self.common), -1)


class Weighing:
    """Weights of samples at one model; of `noise` only the correlation matters."""

    def __init__(self, data: Observations, about: Linear, noise: Noise) -> None:
        self._parts, self._base = rectangles(data), about.base_N
        self._filter = CorrelatedNoise.of(noise, data)
        self._shared = self._weighed(np.column_stack([about.force_N, about.slope_N_per_mm]))
        self._common = self._with_shared(self._shared)

    def take(self, columns: Floats) -> Columns:
        """Return columns (N, k), in N, weighted."""
        tables = self._weighed(columns)
        return Columns(tables, self._with_shared(tables))

    def product(self, one: Columns, other: Columns) -> Product:
        """Return the product of each column of one with each of the other."""
        return Product(one.flat.T @ other.flat, one.shared, other.shared, self._common)

    def squares(self, one: Columns) -> Product:
        """Return the product of each column with itself."""
        rest = sum(np.einsum("mtk,mtk->k", table, table) for table in one.tables)
        return Product(np.asarray(rest), one.shared, one.shared, self._common)

    def weigh(self, sizes: Floats) -> tuple[Floats, Floats]:
        """Return the weights of gain and zero of each press (n, M, 2, 2), and ln det V (n,), without the constant
        of the samples' noise at scale 1, at each of the sizes (n, 3).
        """
        weight, volume = weigh(self._common, sizes)
        own = 2 * float(self._base.size) * np.log(sizes[:, 0]) + self._volume
        return weight, own + np.sum(np.log(volume), axis=1)

    @cached_property
    def _volume(self) -> float:
        return self._filter.log_volume(self._parts)

    def white(self, columns: Columns, sizes: Floats) -> Floats:
        """Return columns (N, n), each whitened by the noise of its own sizes (n, 3), (N, n)."""
        squares, flat = _squares(sizes), np.empty((self._base.size, len(sizes)))
        for part, basis, root, table in zip(
            self._parts, *zip(*self._bases, strict=True), columns.tables, strict=True
        ):
            size, axes = np.linalg.eigh(root @ squares @ root.transpose(0, 2, 1))
            shrink = (axes * (1 - 1 / np.sqrt(1 + np.maximum(size, 0)))[..., None, :]) @ axes.swapaxes(2, 3)
            along = shrink @ (basis.transpose(0, 2, 1) @ table).transpose(2, 0, 1)[..., None]
            white = (table - basis @ along[..., 0].transpose(1, 2, 0)) / sizes[:, 0]
            flat[part.rows[part.real]] = white[part.real]
        return flat

    @cached_property
    def _bases(self) -> list[tuple[Floats, Floats]]:
        """Orthonormal bases (m, t, 2) of gain and zero of each press, and their roots (m, 2, 2)."""
        return [(basis, root) for basis, root in map(np.linalg.qr, self._shared)]

    def log_volume(self, noise: Noise) -> float:
        """Return ln det V, without the constant of the samples' noise at scale 1."""
        return float(self.weigh(sizes_of([noise]))[1][0])

    def _weighed(self, columns: Floats) -> list[Floats]:
        scaled = columns / self._base[:, None]
        return [self._filter.innovations(part, scaled) for part in self._parts]

    def _with_shared(self, tables: Sequence[Floats]) -> Floats:
        """Return the products of gain and zero with these columns, (M, 2, k), presses in order of rectangles."""
        return _joined([s.transpose(0, 2, 1) @ t for s, t in zip(self._shared, tables, strict=True)])


def _joined(parts: Sequence[Floats]) -> Floats:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def inverse_of_one_plus(inner: Floats) -> tuple[Floats, Floats]:
    """Return (1 + A)^-1 and det(1 + A) for positive A (..., 2, 2).

    In closed form: a search passes through sizes that make A so large that 1 is lost in rounding.
    """
    a, b, d = inner[..., 0, 0], inner[..., 0, 1], inner[..., 1, 1]
    volume = 1 + a + d + np.maximum(a * d - b * b, 0.0)
    inverse = np.empty_like(inner)
    inverse[..., 0, 0], inverse[..., 1, 1] = 1 + d, 1 + a
    inverse[..., 0, 1] = inverse[..., 1, 0] = -b
    inverse /= volume[..., None, None]
    return inverse, volume


def sizes_of(noises: Sequence[Noise]) -> Floats:
    """Return the scale, the gain and the zero in mm of each, (n, 3)."""
    return np.array([(noise.scale, noise.gain, noise.zero_mm) for noise in noises])


def weigh(common: Floats, sizes: Floats) -> tuple[Floats, Floats]:
    """Return (1 + S G^T G S)^-1 S S' (n, M, 2, 2), the weights of gain and zero, and the determinants (n, M) of
    what is inverted, for `common` (M, 2, 2) at each of the sizes (n, 3).
    """
    square = _squares(sizes)
    inverse, volume = inverse_of_one_plus(common * square)
    return inverse * square, volume


def _squares(sizes: Floats) -> Floats:
    """Return the products of each gain and zero over the scale, (n, 1, 2, 2)."""
    ratio = sizes[:, 1:] / sizes[:, :1]
    return np.asarray(ratio[:, None, :, None] * ratio[:, None, None, :])


SPREAD = 1.0  # std of the prior of ln gain and ln zero: a factor 2.7 either way
UNKNOWN_SHARE = 0.02  # of the largest force: noise to assume where none is stated and nothing determines it
FAR_LESS = 0.5  # of the stated noise: below, it cannot be explained by what samples of a press share
BEYOND_CHANCE = 0.01  # p below which chance does not explain a difference
STEP = 0.05  # in the logarithm of a size, for slope and curvature
CLOSE = 1e-3  # last step in ln size
MAX_STEPS = 40  # of Newton's method
FINEST = MICRO  # least size: of the largest force, of the stated noise, of a gain, in mm
CORRELATIONS = (0.2, 0.4, 0.6, 0.8, 0.9, 0.95)  # of neighbouring samples, tried
WHITE = (0.0, 0.4, 0.7, 0.85)  # shares of uncorrelated variance, tried


def estimate_noise(data: Observations, about: Linear, *, residual_N: Floats, jacobian: Floats,
                   precision: Floats, stated: bool, of_presses: bool | None = None) -> Noise:  # fmt: skip
    """Return the likeliest noise for residuals (N,), a `jacobian` (N, p) and the priors' `precision` (p, p).

    `of_presses`: whether presses have a gain and a zero of their own; None: for curves.
    """
    dof = max(data.size - jacobian.shape[1] + float(np.count_nonzero(np.diag(precision))), 0.0)
    finest = FINEST * float(np.max(np.abs(about.force_N)))
    first = Noise(1.0 if stated else max(float(np.std(residual_N)), finest, TINY), stated=stated)
    shared = data.is_curves if of_presses is None else of_presses
    if dof < 1 and not stated:  # no degrees of freedom to estimate it from
        return replace(first, scale=UNKNOWN_SHARE * float(np.max(np.abs(about.force_N))), dof=1.0)
    columns = np.column_stack([jacobian, residual_N])

    def likeliest(alike: Noise) -> tuple[Noise, float]:
        weighing = Weighing(data, about, alike)
        taken = weighing.take(columns)
        product = weighing.product(taken, taken)
        cost = partial(minus_two_log_likelihood, weighing=weighing, product=product, precision=precision)
        return _best(cost, alike, shared, finest)

    best = _over_correlations(likeliest, first, data)
    if stated and far_below_stated(best, dof):
        best = _over_correlations(likeliest, replace(best, correlation=0.0, white=0.0, overstated=True), data)
    freedom = dof + best.trust
    if data.is_curves:
        freedom = max(data.count - 1.0, 1.0) + STATED_DOF / 2
    return replace(best, dof=max(freedom, TINY))


def _over_correlations(
    likeliest: Callable[[Noise], tuple[Noise, float]], first: Noise, data: Observations
) -> Noise:
    """Return the likeliest sizes and correlation, by a grid over the latter."""
    best, lowest = likeliest(first)
    for white in WHITE if data.is_curves else ():
        row = np.inf
        for rho in (rho for rho in CORRELATIONS if rho >= best.correlation):  # what is not white is longer
            found, cost = likeliest(replace(best, correlation=rho, white=white))
            cost += float(np.log(data.size)) * (1 + (white > 0))  # cost of each parameter: Schwarz (1978)
            if cost < lowest:
                best, lowest = found, cost
            row = min(row, cost)
            if cost > row + 20:  # past the best correlation the cost only grows
                break
    return best


def own_scale(noise: Noise, dof: float) -> float:
    """Return the samples' std over the stated one, without the prior's weight."""
    return float(np.sqrt(max(((dof + noise.trust) * noise.scale**2 - noise.trust) / dof, 0.0)))


def far_below_stated(noise: Noise, dof: float) -> bool:
    """Return whether samples scatter significantly less than half as much as stated, by F of the two variances.

    Above half, the stated noise may include what all samples of a press share.
    """
    from scipy.special import fdtr

    own = own_scale(noise, dof) if dof >= 1 else 1.0
    return own < FAR_LESS and float(fdtr(dof, STATED_DOF, own**2)) < BEYOND_CHANCE


def minus_two_log_likelihood(sizes: Floats, weighing: Weighing, *, product: Product, precision: Floats) -> Floats:
    """Return -2 ln L (n,), dimensionless, of each of these sizes (n, 3), but for a constant.

    `product` is that of [jacobian | residual], `precision` (p, p) that of the priors, in the parameters' units.
    The last element of Cholesky's factor of [J r]^T V^-1 [J r] is the root of r^T P r.
    """
    weight, of_noise = weighing.weigh(sizes)
    total = product.weighted(weight, sizes[:, 0])
    squares = total[:, -1, -1].copy()
    total[:, :-1, :-1] += precision
    total[:, -1, -1] *= 2  # where the model explains all, rounding would leave less than nothing
    try:
        root = np.linalg.cholesky(total)
    except np.linalg.LinAlgError:
        if len(sizes) == 1:
            return np.array([1e30])  # finite, so that a search can step back
        each = [minus_two_log_likelihood(n[None], weighing, product=product, precision=precision) for n in sizes]
        return np.concatenate(each)
    diagonal = np.diagonal(root, axis1=1, axis2=2)
    volume = 2 * np.sum(np.log(diagonal[:, :-1]), axis=1)
    return np.asarray(of_noise + volume + diagonal[:, -1] ** 2 - squares)


def prior_cost(logs: Floats, *, trust: Floats | float) -> Floats:
    """Return -2 ln of the prior (n,) of logs (n, 1) or (n, 3) = ln scale, ln gain, ln zero in mm.

    Log-normal about the usual gain and zero; a stated noise has a scale of 1 (scaled inverse chi-squared, `trust`
    dof).
    """
    usual = np.log([TYPICAL_GAIN, TYPICAL_ZERO_MM])[: logs.shape[1] - 1]
    scale = logs[:, 0]
    cost = np.sum(((logs[:, 1:] - usual) / SPREAD) ** 2, axis=1)
    return np.asarray(cost + trust * (2 * scale + np.exp(-2 * scale)) if np.any(trust) else cost)


def log_sizes(sizes: Floats) -> Floats:
    """Return ln scale, ln gain, ln zero in mm, of sizes (..., 3)."""
    return np.asarray(np.log(np.maximum(sizes, (0.0, FINEST, FINEST / 10))))


def sized(noise: Noise, logs: Floats) -> Noise:
    """Return the noise with logs (1,) or (3,) = ln scale, ln gain, ln zero in mm."""
    sizes = np.exp(logs).tolist()
    return replace(noise, **dict(zip(("scale", "gain", "zero_mm"), sizes, strict=False)))


def stencil(size: int) -> Floats:
    """Return offsets (k, size) that determine slope and curvature of a cost: 0, either side, and pairs."""
    unit = np.eye(size)
    pairs = [unit[i] + unit[j] for i, j in combinations(range(size), 2)]
    return STEP * np.array([np.zeros(size), *unit, *-unit, *pairs])


def newton_move(costs: Floats, size: int) -> Floats:
    """Return Newton's step (size,) from the costs (k,) on the stencil.

    At most a factor e along each axis of the curvature, so that it always leads downhill.
    """
    ahead, behind = costs[1 : size + 1], costs[size + 1 : 2 * size + 1]
    curvature, axes = _curvature(costs, size)
    along = axes.T @ (ahead - behind) / (2 * STEP) / curvature
    return np.asarray(-axes @ np.clip(along, -1, 1))


def spread(costs: Floats, size: int) -> Floats:
    """Return a root (size, size) of the covariance of ln sizes, dimensionless, from costs (k,) on the stencil."""
    curvature, axes = _curvature(costs, size)
    return np.asarray(axes * np.sqrt(2 / curvature))  # of -2 ln L


def _curvature(costs: Floats, size: int) -> tuple[Floats, Floats]:
    """Return eigenvalues (size,), at least those of a size known to a factor 7, and axes (size, size)."""
    ahead, behind = costs[1 : size + 1], costs[size + 1 : 2 * size + 1]
    hessian = np.diag((ahead + behind - 2 * costs[0]) / STEP**2)
    for value, (i, j) in zip(costs[2 * size + 1 :], combinations(range(size), 2), strict=True):
        hessian[i, j] = hessian[j, i] = (value - ahead[i] - ahead[j] + costs[0]) / STEP**2
    curvature, axes = np.linalg.eigh(hessian)
    return np.maximum(curvature, 0.5), axes


def _best(
    likelihood: Callable[[Floats], Floats], first: Noise, shared: bool, finest_N: float
) -> tuple[Noise, float]:
    """Return the likeliest sizes and their cost, by Newton's steps downhill."""
    sizes = [first.scale, first.gain or TYPICAL_GAIN, first.zero_mm or TYPICAL_ZERO_MM]
    here = np.log(sizes[: 3 if shared else 1])
    offsets = stencil(here.size)
    low = np.log([FINEST if first.stated else finest_N, FINEST, FINEST])[: here.size]

    def cost(places: Floats) -> Floats:
        sizes = np.zeros((len(places), 3))
        sizes[:, : here.size] = np.exp(places)
        return np.asarray(likelihood(sizes) + prior_cost(places, trust=first.trust))

    for _ in range(MAX_STEPS):
        costs = cost(here + offsets)
        move = newton_move(costs, here.size)
        while np.abs(move).max() > CLOSE and cost((here + move)[None])[0] > costs[0]:
            move = move / 2
        here = np.maximum(here + move, low)
        if np.abs(move).max() <= CLOSE:
            break
    return sized(first, here), float(cost(here[None])[0])
