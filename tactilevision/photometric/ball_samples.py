"""Samples of colour change and slope from ball presses, and whether they determine both slopes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats, Pair, Picture

if TYPE_CHECKING:
    from functools import _lru_cache_wrapper

# Pairs of colour change and slope from ball presses.

TYPICAL = 0.2  # slope below which samples weigh alike in the fits
CONTACT = 9000  # samples under balls, over all presses
RESTING = 4000  # samples of untouched gel
INSIDE = 0.93  # of the contact radius: blur mixes the rim with the gel outside
OUTSIDE = 4  # contact radii beyond which the gel counts as untouched

KEPT = 24  # cached sample sets: contact and rest of all balls, without 3 groups, 3 pairs, 4 sides
T = TypeVar("T")
_caches: list[Any] = []  # of all functions of sample sets


def kept_of_samples(function: Callable[..., T]) -> _lru_cache_wrapper[T]:
    """Return the function with its results kept until `forget_samples`."""
    kept = lru_cache(maxsize=KEPT)(function)
    _caches.append(kept)
    return kept


def forget_samples() -> None:
    """Release the results kept of all sample sets."""
    for cache in _caches:
        cache.cache_clear()


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """`change` (N, 3), `place` (N, 2) from -1 to 1 over the picture, `slopes` (N, 2), `press` (N,) its number.

    `noise` (N, 3): standard deviation of the changes, None where exact. Changes of overexposed colours are NaN.
    """

    change: Floats
    place: Floats
    slopes: Floats
    press: npt.NDArray[np.int64]
    noise: Floats | None = None

    def where(self, chosen: Bools) -> Samples:
        noise = None if self.noise is None else self.noise[chosen]
        return Samples(self.change[chosen], self.place[chosen], self.slopes[chosen], self.press[chosen], noise)

    def complete(self) -> Samples:
        """Return the samples of which all colours are known."""
        known = np.asarray(np.isfinite(self.change).all(axis=1))
        return self if known.all() else self.where(known)

    def steepened(self, by: Mapping[int, float]) -> Samples:
        """Return the samples with the slopes of some balls, by number, multiplied by a factor."""
        factor = np.array([by.get(int(number), 1.0) for number in self.press])
        return replace(self, slopes=self.slopes * factor[:, None])

    def without(self, colour: int) -> Samples:
        """Return the samples whose other two colours are known, with the change of `colour` set to 0."""
        known = np.asarray(np.isfinite(np.delete(self.change, colour, axis=1)).all(axis=1))
        kept, others = self.where(known), np.arange(3) != colour
        noise = None if kept.noise is None else np.where(others, kept.noise, 0.0)
        return replace(kept, change=np.where(others, kept.change, 0.0), noise=noise)

    def with_noise(self, noise: Picture) -> Samples:
        """Return the samples with the relative `noise` (3, H, W) of their changes."""
        return replace(self, noise=self.values_of(noise))

    def values_of(self, pictures: Picture) -> Floats:
        """Return the values (N, 3) of `pictures` (3, H, W) at the places."""
        columns, rows = (
            np.rint(0.5 * (at + 1.0) * (n - 1)).astype(np.intp)
            for at, n in zip(self.place.T, pictures.shape[:0:-1], strict=True)
        )
        return np.asarray(pictures[:, rows, columns].T, np.float64)


def join(parts: Sequence[Samples]) -> Samples:
    """Return the samples of all `parts`, without noise."""
    names = ("change", "place", "slopes", "press")
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def with_same_colours(contact: Samples, untouched_samples: Samples, *, min_balls: int) -> tuple[Samples, Samples]:
    """Return samples of the same known colours: three or, where fewer than `min_balls` have them, the best two."""
    if len(np.unique(contact.complete().press)) >= min_balls:
        return contact.complete(), untouched_samples.complete()
    overexposed = int(np.argmax(np.isnan(contact.change).sum(axis=0)))
    return contact.without(overexposed), untouched_samples.without(overexposed)


def ball_samples(
    change: Picture, ball: Ball, *, mm_per_px: Pair, number: int, most: int, valid: Bools, rng: np.random.Generator
) -> Samples:
    """Return at most `most` random samples inside the contact, of relative `change` (3, H, W), mask `valid`."""
    x, y, distance = from_axis(valid.shape, ball, mm_per_px)
    inside = (distance < INSIDE * ball.contact_radius_px * mm_per_px[0]) & valid
    index = _draw(inside, most, rng)
    p, q = ball_slopes(
        x[index], y[index], contact_mm=ball.contact_radius_px * mm_per_px[0], radius_mm=ball.radius_mm
    )
    return _at(change, index, np.stack([p, q], axis=1), number)


def resting_samples(
    change: Picture, ball: Ball, *, mm_per_px: Pair, number: int, most: int, valid: Bools, rng: np.random.Generator
) -> Samples:
    """Return samples far from the ball, where the slope is 0 and `change` (3, H, W) is noise."""
    _, _, distance = from_axis(valid.shape, ball, mm_per_px)
    index = _draw((distance > OUTSIDE * ball.contact_radius_px * mm_per_px[0]) & valid, most, rng)
    return _at(change, index, np.zeros((len(index[0]), 2)), number)


def far_from(ball: Ball, shape: tuple[int, ...], *, mm_per_px: Pair) -> Bools:
    """Return the mask (H, W) of gel that counts as untouched by the ball."""
    return radii_from(ball, shape, mm_per_px=mm_per_px) > OUTSIDE


def radii_from(ball: Ball, shape: tuple[int, ...], *, mm_per_px: Pair) -> Floats:
    """Return the distance (H, W) from the ball's axis, in contact radii."""
    return from_axis(shape, ball, mm_per_px)[2] / (ball.contact_radius_px * mm_per_px[0])


def from_axis(shape: tuple[int, ...], ball: Ball, mm_per_px: Pair) -> tuple[Floats, Floats, Floats]:
    """Return x, y and the distance (H, W) mm of a picture's pixels from the ball's axis."""
    x = (np.arange(shape[1]) - ball.centre_px[0]) * mm_per_px[0]
    y = (np.arange(shape[0]) - ball.centre_px[1])[:, None] * mm_per_px[1]
    distance = np.sqrt(x * x + y * y)
    return np.broadcast_to(x, distance.shape), np.broadcast_to(y, distance.shape), distance


def places_of(columns: npt.NDArray[Any], rows: npt.NDArray[Any], shape: tuple[int, ...]) -> Floats:
    """Return the places (N, 2), from -1 to 1, of pixels (N,) of a picture (H, W)."""
    height, width = shape
    return np.stack([2.0 * columns / (width - 1) - 1.0, 2.0 * rows / (height - 1) - 1.0], axis=1)


def _draw(where: Bools, most: int, rng: np.random.Generator) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    rows, columns = np.nonzero(where)
    chosen = rng.choice(len(rows), min(most, len(rows)), replace=False)
    return rows[chosen], columns[chosen]


def _at(
    change: Picture, index: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]], slopes: Floats, number: int
) -> Samples:
    place = places_of(index[1], index[0], change.shape[1:])
    changes = np.asarray(change[:, *index].T, dtype=np.float64)
    return Samples(changes, place, slopes, np.full(len(place), number))


# Observability of both directions of slope.
#
# To first order in slope, and in place X, Y (from -1 to 1) for near lamps, the colours change by
#
#     u / sigma = A(X, Y) (p, q),        A = A0 + A1 X + A2 Y        (3, 2), sigma the noise of one pixel
#
# A slope of 1/s along the direction of the smaller singular value s equals the noise of a pixel. With two lamps of
# one colour opposite each other, or one colour on all sides, s = 0 and no method can read that direction. Two
# lamps alone leave a gap of more than half a circle between the directions in which colours brighten. Samples are
# weighted as in the fit; terms of second order are even in slope and cancel.

MAX_PLACES = 500  # places at which A is evaluated
MIN_SHARE = 0.1  # of the greatest answer: a colour below has no lamp of its own
MIN_ANSWER = 1e-6  # change of colour in deviations per unit of slope: none


@dataclass(frozen=True, slots=True)
class Observability:
    """Slopes `best` and `worst` that equal a pixel's noise along the best and worst directions (medians).

    `worst_deg`: the worst direction, from x towards y. `gap_deg`: the widest gap between sides that colours light
    the gel from, about `dark_deg`; 0 where a colour is overexposed.
    """

    best: float
    worst: float
    worst_deg: float
    gap_deg: float = 0.0
    dark_deg: float = 0.0


def slope_observability(samples: Samples) -> Observability:
    """Return the observability of slopes by the colours of `samples`, whose noise is known."""
    assert samples.noise is not None
    x, y = samples.place.T
    where = np.stack([np.ones_like(x), x, y], axis=1)
    design = (where[:, :, None] * samples.slopes[:, None, :]).reshape(len(x), 6)
    weights = 1.0 / np.sqrt(np.sum(samples.slopes**2, axis=1) + TYPICAL**2)
    signal = samples.change / np.maximum(samples.noise, TINY)
    answers = np.linalg.lstsq(design * weights[:, None], signal * weights[:, None], rcond=None)[0].reshape(3, 2, 3)
    changes = np.einsum("nm,mkc->nkc", where[:: max(1, len(x) // MAX_PLACES)], answers)
    best, worst = 1.0 / np.maximum(np.median(np.linalg.svd(changes, compute_uv=False), axis=0), MIN_ANSWER)
    least = np.linalg.eigh(np.einsum("nkc,nlc->kl", changes, changes))[1][:, 0]
    gap = (0.0, 0.0) if np.any(samples.noise.max(axis=0) <= 0.0) else _dark_side(changes.mean(axis=0).T)
    return Observability(float(best), float(worst), float(np.degrees(np.arctan2(least[1], least[0])) % 180), *gap)


def _dark_side(changes: Floats) -> Pair:
    """Return the widest gap between the lit sides of colours of `changes` (3, 2), and its middle, in degrees."""
    answers = np.hypot(*changes.T)
    x, y = -changes[answers > MIN_SHARE * answers.max()].T  # gel that faces a lamp rises away from it
    sides = np.sort(np.degrees(np.arctan2(y, x)))
    gaps = np.diff(sides, append=sides[0] + 360)
    widest = int(np.argmax(gaps))
    return float(gaps[widest]), float((sides[widest] + 0.5 * gaps[widest]) % 360)
