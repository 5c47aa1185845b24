"""Slope as a polynomial of the colour change, with coefficients varying smoothly over the picture.

    p, q = sum_k C_k(X, Y) phi_k(u)        phi: the 19 products of one to three of the colour changes r, g, b
    C_k(X, Y) = sum_m c_km X^i Y^j         i + j up to 5, 2, 1 for products of one, two, three; X, Y from -1 to 1

Near lamps turn and fade over the picture: on a GelSlim 3.0 with 14 balls, slopes of .1 are off by 8 % (rms over
places) with order 3 instead of 5, by 6 % with 5. There is no constant term: no change of colour is no slope. The
fit is ridge regression on the ball samples with weights 1/(slope^2 + TYPICAL^2); the ridge grows with the order in
place. With D the simulated noise of the products phi, the law without the bias by noise (4 % for u of .014) solves

    (phi'W phi - D'W D) c = phi'W s

The variance that noise adds to slopes is penalised with weight 1 / AVERAGED over samples and untouched gel, which
limits dark channels. `fit_fourth_order` adds the 15 products of four colours, with i + j up to 1 and a penalty:
light ends where gel turns from a low lamp. Directions of held-out real balls improve from 2.03 to 1.99 degrees (a
GelSight Mini) and 3.35 to 3.23 (a GelSlim). Valid for slopes within those of the balls; results are limited to
REACH times the steepest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate, combinations_with_replacement

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_samples import TYPICAL, Samples, kept_of_samples
from tactilevision.photometric.colour_change import Window
from tactilevision.photometric.protocols import ColourLaw, Evaluator, Stored
from tactilevision.photometric.shading_law import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats, Picture

PRODUCTS = tuple(pick for n in (1, 2, 3, 4) for pick in combinations_with_replacement(range(3), n))
RAISED = tuple(  # a colour, the products of one order from it on, their products with it
    (slice(c, c + 1), slice(start + skip, end), slice(above, above + end - start - skip))
    for start, end, skips, aboves in (
        (0, 3, (0, 1, 2), (3, 6, 8)),
        (3, 9, (0, 3, 5), (9, 15, 18)),
        (9, 19, (0, 6, 9), (19, 29, 33)),
    )
    for c, skip, above in zip(range(3), skips, aboves, strict=True)
)
PLACE_ORDER = {1: 5, 2: 2, 3: 1, 4: 1}
MAX_ORDER = max(PLACE_ORDER.values())
LOW = 2 * (PLACE_ORDER[2] + 1)  # sums of a row, of both slopes, to which products of two to four contribute
POWERS = tuple((i, n - i) for n in range(MAX_ORDER + 1) for i in range(n + 1))
FOURTH = 1.0  # penalty of products of four, relative to their power
AVERAGED = 450  # pixels of a contact of 12 px in radius, the smallest whose depth is to be right
MAX_NOISE_SHARE = 0.5  # of a combination's power that is subtracted as noise
REACH = 1.5  # of the steepest slope of the samples; beyond, a polynomial diverges
RIDGES = (1e-4, 1e-3, 1e-2, 1e-1)  # relative to the power of the terms; held-out balls choose


def terms_of(place_order: Mapping[int, int]) -> npt.NDArray[np.intp]:
    """Return the colour product and the power in place (terms, 2), dimensionless, by orders in place."""
    return np.array(
        [
            (k, m)
            for k, product in enumerate(PRODUCTS)
            for m, power in enumerate(POWERS)
            if sum(power) <= place_order.get(len(product), -1)
        ]
    )


TERMS = terms_of(PLACE_ORDER)
ORDERS = np.array([len(PRODUCTS[k]) for k in TERMS[:, 0]])  # in colour
CUBIC = sum(len(product) < 4 for product in PRODUCTS)  # products of three colours at most


@dataclass(frozen=True, slots=True)
class Polynomial(Stored):
    """`coefficients` (2, 34, 21): slope, colour product, power in place. `steepest` slope among the samples."""

    coefficients: Floats
    steepest: float

    name = "polynomial"

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) for changes (N, 3) at places (N, 2)."""
        terms = TERMS if self.fourth else TERMS[ORDERS <= 3]
        slopes = design(change, place, terms) @ self.coefficients[:, terms[:, 0], terms[:, 1]].T
        bound = REACH * self.steepest
        return np.asarray(np.clip(slopes, -bound, bound))

    @property
    def fourth(self) -> bool:
        """Whether it has products of four colours."""
        return bool(self.coefficients[:, CUBIC:].any())

    def averaged(self, noise: Floats) -> Polynomial:
        """Return itself: noise hardly changes its mean, other than the bias on untouched gel."""
        return self

    def evaluator(self, shape: tuple[int, int]) -> PolynomialEvaluator:
        return PolynomialEvaluator(self, shape)


def fit_polynomial(
    contact: Samples,
    untouched_samples: Samples,
    *,
    ridge: float,
    simulated: Samples | None = None,
    share: float = 0.0,
    order: int = 3,
) -> Polynomial:
    """Fit a polynomial of products of `order` (3 or 4) colours at most to samples.

    `ridge` penalises the place terms, relative to their power. Samples `simulated` by another law, without noise,
    have `share` of the weight.
    """
    terms = TERMS[order >= ORDERS]
    equations, target, scale = _equations(contact, untouched_samples, simulated, share, order)
    of_place = np.array([sum(POWERS[m]) for m in terms[:, 1]])
    normal = equations + np.diag(1e-6 + ridge * of_place + FOURTH * (ORDERS[order >= ORDERS] == 4))
    solution = np.linalg.solve(normal, target) / scale
    coefficients = np.zeros((2, len(PRODUCTS), len(POWERS)))
    coefficients[:, terms[:, 0], terms[:, 1]] = solution.T
    return Polynomial(coefficients, float(np.hypot(*contact.slopes.T).max()))


def fit_fourth_order(contact: Samples, untouched_samples: Samples, *, ridge: float) -> Polynomial:
    """Fit as `fit_polynomial`, with products of four colours."""
    return fit_polynomial(contact, untouched_samples, ridge=ridge, order=4)


@kept_of_samples
def _equations(
    contact: Samples, untouched_samples: Samples, simulated: Samples | None, share: float, order: int
) -> tuple[Floats, Floats, Floats]:
    """Return the equations without a ridge, (K, K) and (K, 2), of coefficients times their `scale` (K, 1)."""
    power, noise, target = _sums(contact, order)
    if simulated is not None:
        more = _sums(simulated, order)
        power, noise, target = (
            (1.0 - share) * a + share * b for a, b in zip((power, noise, target), more, strict=True)
        )
    scale = np.sqrt(np.diag(power)) + 1e-12
    noise = noise / np.outer(scale, scale)
    resting = design(untouched_samples.change, untouched_samples.place, TERMS[order >= ORDERS]) / scale
    normal = _less_noise(power / np.outer(scale, scale), noise)
    normal += (noise + resting.T @ resting / max(1, len(resting))) / AVERAGED
    return normal, target / scale[:, None], scale[:, None]


@kept_of_samples
def _sums(samples: Samples, order: int) -> tuple[Floats, Floats, Floats]:
    """Return weighted means over samples: of design products, of those of its noise, of design times slope."""
    weights = 1.0 / (np.sum(samples.slopes**2, axis=1) + TYPICAL**2)
    root = np.sqrt(weights / weights.sum())
    terms = TERMS[order >= ORDERS]
    weighted = _columns(_products(samples.change, terms) * root, samples.place, terms)
    noise = np.zeros((len(terms), len(terms)))
    if samples.noise is not None:
        rng = np.random.default_rng(0)  # fixed: a calibration does not change between runs
        error = samples.noise * rng.standard_normal(samples.noise.shape)
        above, below = (_products(samples.change + e, terms) for e in (error, -error))
        scatter = _columns((above - below) * (0.5 * root), samples.place, terms)
        noise = scatter.T @ scatter
    return weighted.T @ weighted, noise, weighted.T @ (samples.slopes * root[:, None])


def _less_noise(power: Floats, noise: Floats) -> Floats:
    """Return `power` minus `noise`, both (K, K), of each combination at most MAX_NOISE_SHARE."""
    root = np.linalg.cholesky(power + TINY * np.eye(len(power)))
    half = np.linalg.solve(root, noise)
    parts, directions = np.linalg.eigh(np.linalg.solve(root, half.T))
    turned = root @ directions
    return np.asarray(power - (turned * np.clip(parts, 0.0, MAX_NOISE_SHARE)) @ turned.T)


class PolynomialEvaluator(Evaluator):
    """The polynomial over a whole picture, row by row: in a row it is a polynomial of X alone.

    slope(X) = sum_i X^i sum_k c_ik(Y) phi_k(u), so that one small matrix product per row does most of the work.
    The products phi are ordered so that r, g, b times those that follow give all of the next order.
    """

    def __init__(self, polynomial: Polynomial, shape: tuple[int, int]) -> None:
        y = np.linspace(-1, 1, shape[0])[:, None] ** np.arange(MAX_ORDER + 1)[None, :]
        self.products = len(PRODUCTS) if polynomial.fourth else CUBIC
        self.raised = RAISED if polynomial.fourth else RAISED[:6]  # those that make products of three at most
        per_row = np.zeros((shape[0], MAX_ORDER + 1, 2, self.products))
        for m, (i, j) in enumerate(POWERS):
            per_row[:, i] += y[:, j, None, None] * polynomial.coefficients[:, : self.products, m]
        self.per_row: Picture = per_row.reshape(shape[0], -1, self.products).astype(np.float32)
        # high powers of X belong to single colours alone
        self._low = np.ascontiguousarray(self.per_row[:, :LOW])
        self._high = np.ascontiguousarray(self.per_row[:, LOW:, :3])
        self.x: Picture = np.linspace(-1, 1, shape[1], dtype=np.float32)
        self.bound = np.float32(REACH * polynomial.steepest)

    def strip(self, change: Picture, window: Window, out: Picture) -> None:
        """Write slopes (2, h, w) of the changes (3, h, w) of a window, one of `strips`, to `out`."""
        size = change.shape[1:]
        # allocated anew for each strip: at the address of the last one, which is still in the cache
        products = np.empty((self.products, *size), np.float32)
        products[:3] = change
        for first, below, above in self.raised:
            np.multiply(products[below], products[first], out=products[above])
        by_row = np.empty((self.per_row.shape[1], *size), np.float32)
        rows, lines = products.transpose(1, 0, 2), by_row.transpose(1, 0, 2)
        np.matmul(self._low[window[0]], rows, out=lines[:, :LOW])
        np.matmul(self._high[window[0]], rows[:, :3], out=lines[:, LOW:])
        sums, x = by_row.reshape(-1, 2, *size), self.x[window[1]]
        slopes = sums[MAX_ORDER]
        for i in reversed(range(MAX_ORDER)):
            slopes *= x
            slopes += sums[i]
        np.clip(slopes, -self.bound, self.bound, out=out)

    def noise(self, noise: Picture) -> Picture:
        """Return the standard deviation (H, W) of a slope on untouched gel from that of the changes (3, H, W)."""
        x = self.x[None, :] ** np.arange(MAX_ORDER + 1)[:, None]
        linear = self.per_row.reshape(-1, MAX_ORDER + 1, 2, self.products)[..., :3].transpose(2, 0, 3, 1) @ x
        square = np.square(linear).sum(axis=0) * np.square(noise).transpose(1, 0, 2)  # (H, 3, W)
        return np.asarray(np.sqrt(square.sum(axis=1) / 2.0), dtype=np.float32)


def design(change: Floats, place: Floats, terms: npt.NDArray[np.intp]) -> Floats:
    """Return the values (N, K) of `terms` (K, 2), dimensionless, of changes (N, 3) at places (N, 2), -1 to 1."""
    return _columns(_products(change, terms), place, terms)


def _products(change: Floats, terms: npt.NDArray[np.intp]) -> Floats:
    """Return the products (P, N) of the colours' changes (N, 3), up to the last that `terms` have."""
    colours = np.ascontiguousarray(change.T)
    return np.stack([reduce(np.multiply, colours[list(pick)]) for pick in PRODUCTS[: terms[-1, 0] + 1]])


def _columns(products: Floats, place: Floats, terms: npt.NDArray[np.intp]) -> Floats:
    of_x, of_y = (
        list(accumulate([axis] * MAX_ORDER, np.multiply, initial=np.ones_like(axis))) for axis in place.T
    )
    powers = [of_x[i] * of_y[j] for i, j in POWERS]
    columns = np.empty((len(terms), len(place)), np.result_type(products, place))
    for column, (k, m) in zip(columns, terms, strict=True):
        np.multiply(products[k], powers[m], out=column)
    return columns.T


# Regularisation by the shading law.
#
#     (1 + u_c) sqrt(1 + p^2 + q^2) - 1 = sum_ij L_cij(X, Y) p^i q^j        1 <= i + j <= 4
#
# A matt surface under one far light makes the left side a plane through 0; higher terms are highlights, shadows
# and several lights in one channel. Fitting colours to the known slopes of balls is well-posed where a polynomial
# of slope in noisy colours has too much freedom. The law is then sampled over all slopes and places, and
# `Polynomial` is fitted to the balls and, with a share of the weight, to these samples.
#
# On five simulated sensors with 8 or 14 balls the depth of held-out balls is off by 7 9 13 16 30 um, with the
# direct fit by 19 14 15 27 38. As real light may deviate from the law, held-out balls choose the fit
# (`AutoMethod`).

SHARES = (0.1, 0.5)  # of the weight on the shading law; held-out balls choose
LAW_SAMPLES = 8000  # of the law, about as many as of the balls (CONTACT)
MAX_SLOPE_SHARE = 1.1  # of the steepest slope of the balls
LAW_RIDGE = 1e-6  # of the polynomial through samples of the law, which cover all slopes and places


@dataclass(frozen=True)
class InverseShading:
    """Fitter of a polynomial to balls and to samples of the shading law, which have `share` of the weight.

    `uneven` penalises the change of the law over the picture.
    """

    uneven: float
    share: float

    @property
    def __name__(self) -> str:
        return f"through_light: uneven {self.uneven:g}, share {self.share:g}"

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> Polynomial:
        simulated = _law_samples(contact, self.uneven)
        return fit_polynomial(contact, untouched_samples, ridge=ridge, simulated=simulated, share=self.share)


class AutoMethod:
    """Fitters among which held-out balls choose: polynomials of third or fourth order, or `InverseShading`."""

    ways = (
        *((fit, ridge) for fit in (fit_polynomial, fit_fourth_order) for ridge in RIDGES),
        *((InverseShading(uneven, share), LAW_RIDGE) for uneven in PLACE_PENALTIES for share in SHARES),
    )

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw:
        return fit_polynomial(contact, untouched_samples, ridge=ridge)


@kept_of_samples
def _law_samples(contact: Samples, uneven: float) -> Samples:
    """Return samples of the shading law of `contact`, spread evenly over slopes and places."""
    law = fit_light(contact, uneven)
    even = _evenly(LAW_SAMPLES, 4)
    steep = MAX_SLOPE_SHARE * np.hypot(*contact.slopes.T).max() * even[:, 0] ** 0.75
    angle, place = 2 * np.pi * even[:, 1], 2.0 * even[:, 2:4] - 1.0
    slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    return Samples(colours_of(law, slopes, place=place), place, slopes, np.zeros(LAW_SAMPLES, np.int64))


def _evenly(count: int, dimensions: int) -> Floats:
    """Return points (count, dimensions) in the unit cube by Roberts' sequence, x^(d+1) = x + 1."""
    root = 1.5
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
