"""Slope as a polynomial of the colour change, its coefficients varying smoothly over the picture.

    p, q = sum_k C_k(X, Y) phi_k(u)        phi: r, g, b, rr, rg, rb, gg, gb, bb
    C_k(X, Y) = sum_m c_km B_m(X, Y)       B: 1, X, Y, XX, XY, YY; X, Y from -1 to 1

u (3,) is the colour change of `change.py`. There is no constant term: no change of colour is no slope. The fit is
ridge regression on the ball samples and on untouched gel (slope 0), the penalty growing with the order in place,
so that where no ball was pressed the light is taken to be as elsewhere. Valid for slopes the balls reached; beyond
them a quadratic runs away, so the result is held to REACH times the steepest slope seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.samples import Samples
from tactilevision.records import Floats

ROWS = 16  # of a picture worked on at once, so that everything stays in the cache
PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
ORDERS = np.array([0, 1, 1, 2, 2, 2])
REACH = 1.5


@dataclass(frozen=True, slots=True)
class Polynomial:
    """`coefficients` (2, 9, 6): slope, colour term, place term. `steepest` slope among the samples."""

    coefficients: Floats
    steepest: float

    name = "polynomial"

    def at(self, change: Floats, place: Floats) -> Floats:
        """Slopes (N, 2) for changes (N, 3) at places (N, 2)."""
        maps = np.einsum("skm,nm->nsk", self.coefficients, _place(place))
        return np.asarray(np.einsum("nsk,nk->ns", maps, _colour(change)))

    def scaled(self, factor: float) -> Polynomial:
        return Polynomial(self.coefficients * factor, self.steepest)

    def evaluator(self, shape: tuple[int, int]) -> PolynomialEvaluator:
        return PolynomialEvaluator(self, shape)

    def arrays(self) -> dict[str, Floats]:
        return {"coefficients": self.coefficients, "steepest": np.array(self.steepest)}


def fit_polynomial(contact: Samples, quiet: Samples, *, ridge: float) -> Polynomial:
    """The polynomial that explains the samples.

    `ridge` is the penalty of the place terms, in parts of their power.
    """
    design = np.concatenate([_design(contact), _design(quiet)])
    target = np.concatenate([contact.slopes, quiet.slopes])
    scale = np.sqrt(np.mean(_colour(contact.change) ** 2, axis=0))[:, None] * np.ones(6)
    design /= scale.ravel()
    normal = design.T @ design / len(contact.place)
    normal[np.diag_indices_from(normal)] += np.tile(1e-6 + ridge * ORDERS, 9)
    solution = np.linalg.solve(normal, design.T @ target / len(contact.place))
    coefficients = (solution.T / scale.ravel()).reshape(2, 9, 6)
    return Polynomial(coefficients, float(np.hypot(*contact.slopes.T).max()))


class PolynomialEvaluator:
    """The polynomial over a whole picture; coefficients per pixel are made once (18 planes)."""

    def __init__(self, polynomial: Polynomial, shape: tuple[int, int]) -> None:
        y, x = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
        basis = _place(np.stack([x.ravel(), y.ravel()], axis=1))
        maps = (polynomial.coefficients.reshape(18, 6) @ basis.T).reshape(2, 9, *shape)
        self.maps = np.ascontiguousarray(maps, dtype=np.float32)
        self.bound = np.float32(REACH * polynomial.steepest)
        self._work = np.empty((2, ROWS, shape[1]), np.float32)

    def __call__(self, change: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Slopes (H, W) and (H, W) of changes (3, H, W)."""
        out = np.empty((2, *change.shape[1:]), np.float32)
        for top in range(0, change.shape[1], ROWS):
            rows = slice(top, top + ROWS)
            red, green, blue = change[:, rows]
            for s in (0, 1):
                self._nested(self.maps[s, :, rows], red, green, blue, out[s, rows])
        np.clip(out, -self.bound, self.bound, out=out)
        return out[0], out[1]

    def _nested(
        self,
        c: npt.NDArray[np.float32],
        red: npt.NDArray[np.float32],
        green: npt.NDArray[np.float32],
        blue: npt.NDArray[np.float32],
        out: npt.NDArray[np.float32],
    ) -> None:
        """r (c0 + c3 r + c4 g + c5 b) + g (c1 + c6 g + c7 b) + b (c2 + c8 b), without a new array."""
        first, second = self._work[:, : len(out)]
        np.multiply(c[3], red, out=out)
        out += c[0]
        for k, channel in ((4, green), (5, blue)):
            np.multiply(c[k], channel, out=second)
            out += second
        out *= red
        np.multiply(c[6], green, out=first)
        first += c[1]
        np.multiply(c[7], blue, out=second)
        first += second
        first *= green
        out += first
        np.multiply(c[8], blue, out=first)
        first += c[2]
        first *= blue
        out += first

    def noise(self, noise: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Standard deviation (H, W) of a slope on untouched gel, from that of the changes (3, H, W)."""
        variance = np.einsum("skhw,khw->hw", self.maps[:, :3] ** 2, noise**2) / 2.0
        return np.asarray(np.sqrt(variance), dtype=np.float32)


def _design(samples: Samples) -> Floats:
    terms = _colour(samples.change)[:, :, None] * _place(samples.place)[:, None, :]
    return np.asarray(terms.reshape(len(terms), -1))


def _colour(change: Floats) -> Floats:
    products = [change[:, i] * change[:, j] for i, j in PRODUCTS]
    return np.concatenate([change, np.stack(products, axis=1)], axis=1)


def _place(place: Floats) -> Floats:
    x, y = place.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
