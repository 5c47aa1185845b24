"""Cross-validate methods over balls: slope errors, extrapolation, jackknife and colour residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_samples import Samples, kept_of_samples
from tactilevision.photometric.protocols import ColourLaw, Stored
from tactilevision.photometric.shading_law import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.records.measured import Array, Floats, Picture
from tactilevision.robust import mad_std

# Extrapolation: error of the depth scale beyond the outermost balls.
#
#     sigma(X, Y) = min(s d(X, Y), 1)
#     s^2 = (m s_0^2 <d_i^2> + sum max(e_i^2 - f^2, 0)) / (m <d_i^2> + sum d_i^2)
#
# d is the distance from the convex hull of the samples under the balls, X and Y from -1 to 1. The outer fifth of
# the balls on each of four sides is held out: e_i is the relative error of the depth scale at ball i by a law of
# the others, d_i its distance from them, f the error at balls of the fit. The prior s_0 has the weight of m balls.

OUTER_SHARE = 0.2  # of the balls, held out on each side
PRIOR_RATE = 0.5  # of the scale per half picture; eight sets have .3 to 1.4
PRIOR_BALLS = 4  # weight of the prior; 2 to 8 cover alike on nine sets
MAX_STD = 1.0  # of the scale


def sides_of(contact: Samples) -> list[npt.NDArray[np.int64]]:
    """Return the numbers (balls,), one array per side, of the outermost balls on right, left, bottom and top."""
    numbers = np.unique(contact.press)
    centres = np.array([contact.place[contact.press == number].mean(axis=0) for number in numbers])
    count = max(1, round(OUTER_SHARE * len(numbers)))
    return [numbers[np.argsort(sign * along)[-count:]] for along in centres.T for sign in (1, -1)]


def distance_beyond(places: Floats, at: Floats) -> Floats:
    """Return the distance (N,) of points `at` (N, 2) from the convex hull of `places` (M, 2); 0 inside."""
    hull = cv2.convexHull(np.asarray(places, np.float32))
    inwards = [cv2.pointPolygonTest(hull, (float(x), float(y)), measureDist=True) for x, y in at]
    return np.asarray(np.maximum(0.0, -np.array(inwards)))


def growth_rate(errors: Floats, beyond: Floats, *, inside_std: float) -> float:
    """Return s, the error per half picture, of relative `errors` (n,) of the scale at distances `beyond` (n,).

    `inside_std`: relative error at balls of the fit.
    """
    square = beyond**2
    prior = PRIOR_BALLS * float(square.mean())
    if prior == 0.0:
        return PRIOR_RATE
    excess = float(np.maximum(errors**2 - inside_std**2, 0.0).sum())
    return float(np.sqrt((prior * PRIOR_RATE**2 + excess) / (prior + square.sum())))


def extrapolated_std(rate: float, beyond: Floats) -> Floats:
    """Return the relative deviation (n,) of the depth scale at distances `beyond` (n,) from the hull."""
    return np.asarray(np.minimum(rate * beyond, MAX_STD))


# Jackknife: scatter of the depth scale over the choice of balls.
#
# A law f is fitted to all balls, laws f_1 .. f_K each without a K-th of them. The delete-a-group jackknife
# (Wolter, Introduction to Variance Estimation, 2007, 4.2) gives
#
#     std^2 = (K - 1)/K sum_k (f_k - f)^2
#
# for the gain, the quantity that depth follows. With u the colours of a slope s in the direction n,
#
#     gain_k(X, Y) = mean over n and s of n . (f_k(u) - f(u)) / s
#
# u is from the shading law. Among the balls the result is up to 1.6 times too large, which `coverage_factor`
# corrects. Beyond the outermost balls, where three laws may agree by chance, the nearest value among the balls is
# taken, and the extrapolation error is added. Errors that all laws share are not included.

PLACES = (16, 12)  # places across and down the picture; the gain changes slowly between them
DIRECTIONS = 12  # of slope, averaged at each place
CONTACT = 1.0  # places over which a contact extends
STEEP = (0.25, 0.5)  # of the steepest slope under the balls; most of a contact is that gentle


def jackknife_std(others: Sequence[Array]) -> Floats:
    """Return the standard deviation (any shape, any unit) from K changes without one group each."""
    return np.asarray(np.sqrt((len(others) - 1) / len(others) * np.sum(np.square(others), axis=0)), np.float64)


def gain_map(law: ColourLaw, others: Sequence[ColourLaw], *, contact: Samples) -> Floats:
    """Return the relative standard deviation (12, 16) over the picture of the depth scale of `law`.

    `others` are laws fitted without one group of balls each, `contact` the samples under all balls.
    """
    place = places()
    light = fit_light(contact)
    gains = np.zeros((len(others), len(place)))
    for steep in np.hypot(*contact.slopes.T).max() * np.array(STEEP):
        for angle in 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            along = np.array([np.cos(angle), np.sin(angle)])
            colours = colours_of(light, np.tile(steep * along, (len(place), 1)), place=place)
            slope = law.at(colours, place) @ along
            gains += [(other.at(colours, place) @ along - slope) / steep for other in others]
    gains /= DIRECTIONS * len(STEEP)
    maps = [
        cv2.GaussianBlur(gain, (0, 0), CONTACT, borderType=cv2.BORDER_REPLICATE)
        for gain in gains.reshape(len(others), *PLACES[::-1])
    ]
    return nearest_inside(jackknife_std(maps), distance_beyond(contact.place, place))


def places() -> Floats:
    """Return the places (192, 2), from -1 to 1, of the gain map, row by row."""
    x, y = (2.0 * (np.arange(count) + 0.5) / count - 1.0 for count in PLACES)
    return np.stack([grid.ravel() for grid in np.meshgrid(x, y)], axis=1)


def nearest_inside(values: Floats, beyond: Floats) -> Floats:
    """Return `values` (12, 16), in any unit; `beyond` (192,) the balls the nearest among them."""
    at, inside = places(), np.flatnonzero(beyond == beyond.min())
    nearest = np.argmin(np.hypot(*(at[:, None] - at[inside]).T), axis=0)
    return np.asarray(values.ravel()[inside[nearest]].reshape(values.shape))


# Cross-validation: errors at held-out balls, and whether stated deviations cover them.
#
# A third of the balls is held out at a time. A law without the group a states, by laws that lack another group as
# well, the deviation of its depth scale at the balls of a, whose errors are known. All deviations are multiplied
# by
#
#     k^2 = (m + n z^2) / (m + n)        z: the 68 % quantile of n errors, in stated deviations
#
# with a prior weight of m = PRIOR_BALLS. Only balls among the others count, since the extrapolation error is
# separate. On eleven simulated lights k is .5 to 1.1.

FOLDS = 3  # groups of balls
MIN_AMONG = 4  # balls among the others that determine k alone
SLOPE_SOFTENING = 0.1  # slope below which errors are not relative
PATCHES = (8, 3)  # of a ball: sectors and rings
ONE_SIGMA_SHARE = 0.6827  # of normal errors within one standard deviation
BELOW_ONE = 0.999999  # keeps the greatest value in the last patch


class Fitter(Protocol):
    """Fits a colour law to samples of balls and of untouched gel; `ridge` sets its smoothness.

    It may list `ridges` to choose from, or `ways`: pairs of a fitter and a ridge. A method `prepared` returns the
    fitter for certain ball pictures, given their colour change, the pictures, their balls and the scale.
    """

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw: ...


@dataclass(frozen=True, slots=True)
class HeldOutLaw:
    """A `law` fitted without a ball, and the relative deviation of its depth scale there.

    `inside_std` as among the balls of the fit, `outside_std` by the distance beyond them.
    """

    law: ColourLaw
    inside_std: float
    outside_std: float

    @property
    def std(self) -> float:
        return float(np.hypot(self.inside_std, self.outside_std))


@dataclass(frozen=True, slots=True)
class ScaleUncertainty:
    """`gain_std` (12, 16): relative deviation of a law's depth scale, times the `coverage_factor` k.

    `extrapolated_std` (12, 16): further deviation beyond the balls, without k. `held_out_laws`: a law fitted
    without each ball, by its number.
    """

    gain_std: Floats
    extrapolated_std: Floats
    coverage_factor: float
    held_out_laws: dict[int, HeldOutLaw]


def groups_of(contact: Samples) -> list[npt.NDArray[np.int64]]:
    """Return the numbers (balls,) of the balls that are held out together, one array per group."""
    numbers = np.unique(contact.press)
    return [numbers[fold::FOLDS] for fold in range(FOLDS)]


@dataclass(frozen=True, eq=False)
class BallFit:
    """A `fitter` with its `ridge`, and samples to fit: of balls, `contact`, and of untouched gel, `resting`."""

    fitter: Fitter
    ridge: float
    contact: Samples
    resting: Samples

    @cached_property
    def law(self) -> ColourLaw:
        """Return the law of all balls."""
        return self.fitter(self.contact, self.resting, ridge=self.ridge)

    @cached_property
    def others(self) -> list[ColourLaw]:
        """Return the laws without one group of balls each."""
        return [self.without(group) for group in groups_of(self.contact)]

    @cached_property
    def held_out(self) -> Floats:
        """Return the slopes (N, 2) of every sample by the law fitted without its ball."""
        slopes = np.empty_like(self.contact.slopes)
        for group, law in zip(groups_of(self.contact), self.others, strict=True):
            held = np.isin(self.contact.press, group)
            slopes[held] = law.at(self.contact.change[held], self.contact.place[held])
        return slopes

    @cached_property
    def gains(self) -> dict[int, float]:
        """Return the relative depth scale at each ball by the law fitted without it."""
        return gains_of(self.held_out, self.contact)

    @cached_property
    def error(self) -> float:
        """Return the `patch_error` at held-out balls."""
        return patch_error(self.held_out, self.contact)

    def without(self, group: npt.NDArray[np.int64]) -> ColourLaw:
        """Return the law without a `group` of balls (balls,), by their numbers."""
        numbers = tuple(group.tolist())
        return self.fitter(_without(self.contact, numbers), _without(self.resting, numbers), ridge=self.ridge)

    def gains_without(self, group: npt.NDArray[np.int64]) -> dict[int, float]:
        """Return the relative depth scale at each ball of a `group` (balls,), by the law of the others."""
        held = self.contact.where(np.isin(self.contact.press, group))
        return gains_of(self.without(group).at(held.change, held.place), held)

    def light_law(self) -> LightLaw | None:
        """Fit the shading law to the balls; its error is that at the slopes of held-out balls.

        None where only two colours are known: they leave no residual.
        """
        contact = self.contact
        if not contact.change.any(axis=0).all():
            return None
        patch, count = patches_of(contact)
        off = np.empty_like(contact.change)
        for group in groups_of(contact):
            out = np.isin(contact.press, group)
            light = fit_light(contact.where(~out), PLACE_PENALTIES[1])
            off[out] = contact.change[out] - colours_of(light, self.held_out[out], place=contact.place[out])
        misfit, size = (
            sum(float(np.sum(np.bincount(patch, column) ** 2 / count)) for column in many.T)
            for many in (off, contact.change)
        )
        return LightLaw(fit_light(contact, PLACE_PENALTIES[1]), float(np.sqrt(misfit / size)))


def scale_uncertainty(of: BallFit) -> ScaleUncertainty:
    """Return the uncertainty of the depth scale of the law."""
    contact, stated = of.contact, _stated_std(of)
    fitted_std = gain_std(of.law.at(contact.change, contact.place), contact)
    rate = _growth_rate(of, inside_std=fitted_std)
    gains, outside = of.gains, dict[int, float]()
    for group in groups_of(contact):
        beyond = beyond_others(contact, group)
        outside |= dict(zip(beyond, extrapolated_std(rate, np.array([*beyond.values()])).tolist(), strict=True))
    errors = np.array([gains[number] - 1.0 for number in stated])
    off = off_inside(errors, np.hypot(list(stated.values()), fitted_std), [outside[number] for number in stated])
    factor = coverage_factor(off)
    held_out_laws = {
        number: HeldOutLaw(other, factor * stated[number], outside[number])
        for group, other in zip(groups_of(contact), of.others, strict=True)
        for number in map(int, group)
    }
    inside = gain_map(of.law, of.others, contact=contact)
    extrapolated = extrapolated_std(rate, distance_beyond(contact.place, places())).reshape(inside.shape)
    return ScaleUncertainty(factor * inside, extrapolated, factor, held_out_laws)


def _growth_rate(of: BallFit, *, inside_std: float) -> float:
    """Return the error of the depth scale per half picture beyond the balls, from held-out sides."""
    errors, far = list[float](), list[float]()
    for side in sides_of(of.contact):
        gains = of.gains_without(side)
        beyond = beyond_others(of.contact, side)
        errors += [gains[number] - 1.0 for number in beyond]
        far += beyond.values()
    return growth_rate(np.array(errors), np.array(far), inside_std=inside_std)


def beyond_others(contact: Samples, group: npt.NDArray[np.int64]) -> dict[int, float]:
    """Return the distance of each ball of a `group` (balls,) from the others' samples, in px per half picture."""
    others = contact.place[~np.isin(contact.press, group)]
    centres = np.array([contact.place[contact.press == number].mean(axis=0) for number in group])
    return dict(zip(map(int, group), map(float, distance_beyond(others, centres)), strict=True))


def _stated_std(of: BallFit) -> dict[int, float]:
    """Return the deviation of the depth scale stated by each law without a group, at the balls of this group."""
    contact, groups, stated = of.contact, groups_of(of.contact), dict[int, float]()
    pairs = {(a, b): of.without(np.concatenate([groups[a], groups[b]])) for a in range(FOLDS) for b in range(a)}
    for a, (law, group) in enumerate(zip(of.others, groups, strict=True)):
        others = [pair for both, pair in pairs.items() if a in both]
        gains = gain_map(law, others, contact=contact.where(~np.isin(contact.press, group)))
        for number in map(int, group):
            x, y = 0.5 * (contact.place[contact.press == number].mean(axis=0) + 1.0)
            row, column = (int(np.clip(at * n, 0, n - 1)) for at, n in zip((y, x), gains.shape, strict=True))
            stated[number] = float(gains[row, column])
    return stated


def off_inside(errors: Floats, inside: Floats, outside: Sequence[float]) -> Floats:
    """Return the errors (m,) of balls in deviations stated `inside`: of those among the others, if MIN_AMONG are.

    Else of all (n,), with the variance stated `outside` subtracted from their squares. All three (n,) are
    relative.
    """
    beyond = np.array(outside)
    ratio = np.sqrt(np.maximum(errors**2 - beyond**2, 0.0)) / inside
    among = beyond == 0.0
    return np.asarray(ratio[among] if np.count_nonzero(among) >= MIN_AMONG else ratio)


def coverage_factor(off: Floats) -> float:
    """Return the ratio k of errors `off` (n,), in stated deviations."""
    if len(off) == 0:
        return 1.0
    ratio = float(np.quantile(np.abs(off), ONE_SIGMA_SHARE))
    return float(np.sqrt((PRIOR_BALLS + len(off) * ratio**2) / (PRIOR_BALLS + len(off))))


def gains_of(slopes: Floats, samples: Samples) -> dict[int, float]:
    """Return the depth scale at each ball: `slopes` (N, 2) over the true ones."""
    return {
        int(number): float(np.sum((slopes * samples.slopes)[at]) / np.sum(samples.slopes[at] ** 2))
        for number in np.unique(samples.press)
        for at in [samples.press == number]
    }


def gain_std(slopes: Floats, samples: Samples) -> float:
    """Return the robust scatter about 1 of the depth scale over balls, by `slopes` (N, 2)."""
    return mad_std(np.array([*gains_of(slopes, samples).values()]), centre=1.0)


def patch_error(slopes: Floats, samples: Samples) -> float:
    """Return the mean relative error of `slopes` (N, 2), averaged over PATCHES of each ball.

    Depth is a sum over many pixels in which noise averages out: pixel by pixel the least error would be that of a
    law that reads all slopes too low.
    """
    patch, count = patches_of(samples)
    true, off = (
        np.hypot(*(np.bincount(patch, values) / count for values in many.T))
        for many in (samples.slopes, slopes - samples.slopes)
    )
    return float(np.average(off / (true + SLOPE_SOFTENING), weights=count))


@kept_of_samples
def patches_of(samples: Samples) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the number (N,) of the patch of each sample, and the number of samples in each patch."""
    steepness = np.hypot(*samples.slopes.T)
    angle = np.arctan2(samples.slopes[:, 1], samples.slopes[:, 0])
    sector = np.floor((angle / np.pi + 1.0) * PATCHES[0] / 2 * BELOW_ONE)
    ring = np.floor(PATCHES[1] * BELOW_ONE * (steepness / steepness.max()) ** 2)
    _, patch = np.unique(np.stack([samples.press, sector, ring]), axis=1, return_inverse=True)
    return patch.ravel(), np.bincount(patch.ravel())


@kept_of_samples
def _without(samples: Samples, numbers: tuple[int, ...]) -> Samples:
    """Return the samples of other balls: one object for all fitters, which cache by it."""
    return samples.where(~np.isin(samples.press, numbers))


# Shading law kept with a method: the colour that a slope should have, and the error of that at held-out balls,
#
#     share^2 = sum over patches of held-out balls of <u - u_law(p, q)>^2 / sum of <u>^2
#
# with u the change of colour, u_law the shading law of the other balls, p and q the slopes by their colour law,
# and < > the mean over a patch, weighted by its samples.


@dataclass(frozen=True, slots=True)
class LightLaw(Stored):
    """`terms` (46, 3) of the shading law; `share`: its relative error of a colour change at held-out balls.

    `noise` (3, h, w): error on untouched gel; `limit`: greatest error in ball pictures, in deviations. Both are
    measured when a reader is made; an infinite limit flags nothing.
    """

    terms: Floats
    share: float
    noise: Picture = field(default_factory=lambda: np.zeros((3, 1, 1), np.float32))
    limit: float = np.inf
