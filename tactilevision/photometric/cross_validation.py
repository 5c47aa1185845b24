"""Cross-validate methods over balls: slope errors, extrapolation, jackknife and colour residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_samples import KEPT, Samples
from tactilevision.photometric.protocols import ColourLaw, Picture
from tactilevision.photometric.shading_law import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.records.measured import Floats
from tactilevision.robust import mad_std

# Beyond the outermost balls: how fast the depth scale is lost with the distance from them.
#
#     sigma(X, Y) = min(s d(X, Y), 1)
#     s^2 = (m s_0^2 <d_i^2> + sum max(e_i^2 - f^2, 0)) / (m <d_i^2> + sum d_i^2)
#
# d is the distance from the convex hull of the samples under the balls, X and Y from -1 to 1. The outer fifth of
# the balls on each of four sides is left out, and read by a law of the others: e_i is how far the depth scale is
# off at ball i, d_i how far that lies beyond the others, f how far balls of the fit are off. s_0 counts as m =
# PRIOR_BALLS. None has a unit. Vanishes among the balls. Assumes that light goes on changing outside as it does at
# the sides.

OUTER_SHARE = 0.2  # of the balls, left out on each side; real_frames.md, beyond the outermost balls
PRIOR_RATE = 0.5  # of the scale for each half picture; eight sets have .3 to 1.4: real_frames.md
PRIOR_BALLS = 4  # balls that PRIOR_RATE is worth; 2 to 8 cover alike on nine sets
MAX_STD = 1.0  # of the scale: more says no more


def sides_of(contact: Samples) -> list[npt.NDArray[np.int64]]:
    """The numbers (balls,) of the outermost balls on the right, left, bottom and top, one array per side."""
    numbers = np.unique(contact.press)
    centres = np.array([contact.place[contact.press == number].mean(axis=0) for number in numbers])
    count = max(1, round(OUTER_SHARE * len(numbers)))
    return [numbers[np.argsort(sign * along)[-count:]] for along in centres.T for sign in (1, -1)]


def distance_beyond(places: Floats, at: Floats) -> Floats:
    """Distance (N,), in any unit, of points `at` (N, 2) from the convex hull of `places` (M, 2); 0 inside."""
    hull = cv2.convexHull(np.asarray(places, np.float32))
    inwards = [cv2.pointPolygonTest(hull, (float(x), float(y)), measureDist=True) for x, y in at]
    return np.asarray(np.maximum(0.0, -np.array(inwards)))


def growth_rate(errors: Floats, beyond: Floats, *, inside_std: float) -> float:
    """s: relative error of the depth scale for each half picture, of `errors` (n,) at distances `beyond` (n,).

    `inside_std` is how far balls of the fit are off. None has a unit.
    """
    square = beyond**2
    prior = PRIOR_BALLS * float(square.mean())
    if prior == 0.0:
        return PRIOR_RATE
    excess = float(np.maximum(errors**2 - inside_std**2, 0.0).sum())
    return float(np.sqrt((prior * PRIOR_RATE**2 + excess) / (prior + square.sum())))


def extrapolated_std(rate: float, beyond: Floats) -> Floats:
    """Deviation (n,) of the depth scale, relative, at distances `beyond` (n,) from the hull."""
    return np.asarray(np.minimum(rate * beyond, MAX_STD))


# How differently a calibration would have read slopes, place by place, had other balls been pressed.
#
# A law f is fitted to all balls, and laws f_1 .. f_K each without a K-th of them. What other balls would have made
# of f scatters by
#
#     std^2 = (K - 1)/K sum_k (f_k - f)^2
#
# (the delete-a-group jackknife; Wolter, Introduction to Variance Estimation, 2007, 4.2), which needs no truth. Of
# slopes it is asked what a contact's depth rests on: with u the colours that a slope of s in the direction n
# gives,
#
#     gain_k(X, Y) = mean over n and s of n . (f_k(u) - f(u)) / s
#
# u is drawn from the light's law (`shading_fit.py`). Among the balls it is rather too large (by up to 1.6), which
# balls left out show (`cross_validation.py`). Where three laws cross beyond the outermost balls it vanishes by
# chance: there it is taken as at the nearest place among them. What is lost beyond them is told by sides left out
# (`extrapolation.py`). What no choice of balls mends, as a light that the law cannot follow, is not in it: balls
# of the fit show that.

PLACES = (16, 12)  # places across and down the picture; gain changes slowly between them
DIRECTIONS = 12  # of slope, averaged over at each place: a contact holds all of them
CONTACT = 1.0  # places over which a contact reaches: its depth rests on the gain all over it
STEEP = (0.25, 0.5)  # of the steepest slope under the balls; most of a contact is that gentle


def jackknife_std(others: Sequence[npt.NDArray[np.floating[Any]]]) -> Floats:
    """Standard deviation of a quantity from what leaving out each of K groups adds to it.

    `others` are K arrays of one shape; the result has this shape and their unit.
    """
    return np.asarray(np.sqrt((len(others) - 1) / len(others) * np.sum(np.square(others), axis=0)), np.float64)


def gain_map(law: ColourLaw, others: Sequence[ColourLaw], *, contact: Samples) -> Floats:
    """Relative standard deviation (12, 16), over the picture, of the depth scale of `law`, a ratio.

    `others` are the laws fitted without a group of balls each, `contact` the samples under all of them.
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
    """The places (192, 2), from -1 to 1, at which gain is told; row by row."""
    x, y = (2.0 * (np.arange(count) + 0.5) / count - 1.0 for count in PLACES)
    return np.stack([grid.ravel() for grid in np.meshgrid(x, y)], axis=1)


def nearest_inside(values: Floats, beyond: Floats) -> Floats:
    """`values` (12, 16), in any unit; at a distance `beyond` (192,) from the balls the nearest among them."""
    at, inside = places(), np.flatnonzero(beyond == beyond.min())
    nearest = np.argmin(np.hypot(*(at[:, None] - at[inside]).T), axis=0)
    return np.asarray(values.ravel()[inside[nearest]].reshape(values.shape))


# Laws that never saw some of the balls: what they make of these, and how far what they state is borne out.
#
# A third of the balls is left out at a time. A law f_a that lacks the group a states of itself, by the laws f_ab
# that lack another group as well (`jackknife.py`), how far its depth scale is off at the balls of a; and these
# show how far it is. All that is stated is taken times
#
#     k^2 = (m + n z^2) / (m + n)        z: what 68 % of the errors of n balls, in stated deviations, do not exceed
#
# with m = PRIOR_BALLS, so that a few balls do not change it much. Balls among the others tell it: what lying
# beyond these adds is stated apart (`extrapolation.py`), and no doubt there may make the rest look better. The law
# that saw all balls may not be asked instead: what it states of a ball's place is what leaving out that very ball
# changes there, which is the error held against it, so that whatever is stated seems right. On eleven simulated
# lights k was .5 to 1.1 over all balls, as among the balls a jackknife states too much: without a ball the next
# one is twice as far away.

FOLDS = 3  # groups of balls; more leave less out at a time, and cost a fit for each pair of groups
MIN_AMONG = 4  # balls among the others that tell k alone; with fewer, those beyond them help
SLOPE_SOFTENING = 0.1  # slopes below are not asked to be right in proportion
PATCHES = (8, 3)  # of a ball: round it, and outwards
ONE_SIGMA_SHARE = 0.6827  # share of normal errors within one standard deviation


class Fitter(Protocol):
    """Makes a colour law of samples of balls and of untouched gel; `ridge` says how smooth.

    It may list the `ridges` to choose from, or the `ways`: pairs of a fitter and a ridge.
    """

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> ColourLaw: ...


@dataclass(frozen=True, slots=True)
class HeldOutLaw:
    """A `law` that never saw a ball, and the relative deviation of its depth scale there.

    `inside_std` as among the balls that it saw, `outside_std` by how far it lies beyond these.
    """

    law: ColourLaw
    inside_std: float
    outside_std: float

    @property
    def std(self) -> float:
        return float(np.hypot(self.inside_std, self.outside_std))


@dataclass(frozen=True, slots=True)
class ScaleUncertainty:
    """`gain_std` (12, 16): relative deviation of a law's depth scale; `coverage_factor` (k) in it.

    `extrapolated_std` (12, 16): what lying beyond the balls adds to it, of which k is no part.
    `held_out_laws`: for each ball, by its number, a law that never saw it.
    """

    gain_std: Floats
    extrapolated_std: Floats
    coverage_factor: float
    held_out_laws: dict[int, HeldOutLaw]


def groups_of(contact: Samples) -> list[npt.NDArray[np.int64]]:
    """The numbers (balls,) of the balls that are left out together, one array per group."""
    numbers = np.unique(contact.press)
    return [numbers[fold::FOLDS] for fold in range(FOLDS)]


def held_out(
    fit: Fitter, contact: Samples, *, untouched_samples: Samples, ridge: float
) -> tuple[Floats, list[ColourLaw]]:
    """Slopes (N, 2) of every sample, each predicted by a law that never saw its ball; and these laws."""
    slopes, laws = np.empty_like(contact.slopes), []
    for group in groups_of(contact):
        left_out = np.isin(contact.press, group)
        laws.append(_fit_without(group, fit, contact, untouched_samples, ridge=ridge))
        slopes[left_out] = laws[-1].at(contact.change[left_out], contact.place[left_out])
    return slopes, laws


def scale_uncertainty(
    fit: Fitter,
    contact: Samples,
    *,
    untouched_samples: Samples,
    ridge: float,
    law: ColourLaw,
    others: list[ColourLaw],
) -> ScaleUncertainty:
    """How far the depth scale of `law` may be off; `others` are fitted alike, each without a group."""
    stated = _stated_std(fit, contact, untouched_samples, ridge=ridge, laws=others)
    fitted_std = gain_std(law.at(contact.change, contact.place), contact)
    rate = _growth_rate(fit, contact, untouched_samples, ridge=ridge, inside_std=fitted_std)
    gains, outside = dict[int, float](), dict[int, float]()
    for group, other in zip(groups_of(contact), others, strict=True):
        left_out = contact.where(np.isin(contact.press, group))
        gains |= gains_of(other.at(left_out.change, left_out.place), left_out)
        beyond = beyond_others(contact, group)
        outside |= dict(zip(beyond, extrapolated_std(rate, np.array([*beyond.values()])).tolist(), strict=True))
    errors = np.array([gains[number] - 1.0 for number in stated])
    off = off_inside(errors, np.hypot(list(stated.values()), fitted_std), [outside[number] for number in stated])
    factor = coverage_factor(off)
    held_out_laws = {
        number: HeldOutLaw(other, factor * stated[number], outside[number])
        for group, other in zip(groups_of(contact), others, strict=True)
        for number in map(int, group)
    }
    inside = gain_map(law, others, contact=contact)
    extrapolated = extrapolated_std(rate, distance_beyond(contact.place, places())).reshape(inside.shape)
    return ScaleUncertainty(factor * inside, extrapolated, factor, held_out_laws)


def _growth_rate(
    fit: Fitter, contact: Samples, untouched_samples: Samples, *, ridge: float, inside_std: float
) -> float:
    """How fast the depth scale is lost beyond the balls, for each half picture, by sides left out."""
    errors, far = list[float](), list[float]()
    for side in sides_of(contact):
        gains = gains_without(side, fit, contact=contact, untouched_samples=untouched_samples, ridge=ridge)
        beyond = beyond_others(contact, side)
        errors += [gains[number] - 1.0 for number in beyond]
        far += beyond.values()
    return growth_rate(np.array(errors), np.array(far), inside_std=inside_std)


def beyond_others(contact: Samples, group: npt.NDArray[np.int64]) -> dict[int, float]:
    """How far each ball of a `group` (balls,) lies beyond the samples under the others, px over half a side."""
    others = contact.place[~np.isin(contact.press, group)]
    centres = np.array([contact.place[contact.press == number].mean(axis=0) for number in group])
    return dict(zip(map(int, group), map(float, distance_beyond(others, centres)), strict=True))


def _stated_std(
    fit: Fitter, contact: Samples, untouched_samples: Samples, *, ridge: float, laws: list[ColourLaw]
) -> dict[int, float]:
    """What `laws`, each without a group, state of their depth scale's deviation at each ball they never saw."""
    groups, stated = groups_of(contact), dict[int, float]()
    pairs = {
        (a, b): _fit_without(np.concatenate([groups[a], groups[b]]), fit, contact, untouched_samples, ridge=ridge)
        for a in range(FOLDS)
        for b in range(a)
    }
    for a, (law, group) in enumerate(zip(laws, groups, strict=True)):
        others = [pair for both, pair in pairs.items() if a in both]
        gains = gain_map(law, others, contact=contact.where(~np.isin(contact.press, group)))
        for number in map(int, group):
            x, y = 0.5 * (contact.place[contact.press == number].mean(axis=0) + 1.0)
            row, column = (int(np.clip(at * n, 0, n - 1)) for at, n in zip((y, x), gains.shape, strict=True))
            stated[number] = float(gains[row, column])
    return stated


def off_inside(errors: Floats, inside: Floats, outside: Sequence[float]) -> Floats:
    """How far (m,) balls are off, in deviations stated `inside`: those among the others, if there are MIN_AMONG.

    Else all (n,), by what `errors` have over the deviation stated `outside`, in squares.
    All three (n,) in one unit; what comes back is a ratio, without unit.
    """
    beyond = np.array(outside)
    ratio = np.sqrt(np.maximum(errors**2 - beyond**2, 0.0)) / inside
    among = beyond == 0.0
    return np.asarray(ratio[among] if np.count_nonzero(among) >= MIN_AMONG else ratio)


def coverage_factor(off: Floats) -> float:
    """k: how many times as far as stated two thirds of the balls are off, or nearly so.

    `off` (n,): how far, in stated deviations; a ratio, as k is.
    """
    if len(off) == 0:
        return 1.0
    ratio = float(np.quantile(np.abs(off), ONE_SIGMA_SHARE))
    return float(np.sqrt((PRIOR_BALLS + len(off) * ratio**2) / (PRIOR_BALLS + len(off))))


def gains_of(slopes: Floats, samples: Samples) -> dict[int, float]:
    """The depth scale at each ball: `slopes` (N, 2) over the true ones."""
    return {
        int(number): float(np.sum((slopes * samples.slopes)[at]) / np.sum(samples.slopes[at] ** 2))
        for number in np.unique(samples.press)
        for at in [samples.press == number]
    }


def gains_without(
    group: npt.NDArray[np.int64], fit: Fitter, *, contact: Samples, untouched_samples: Samples, ridge: float
) -> dict[int, float]:
    """The depth scale, a ratio, at each ball of a `group` (balls,), by a law of the others."""
    left_out = contact.where(np.isin(contact.press, group))
    law = _fit_without(group, fit, contact, untouched_samples, ridge=ridge)
    return gains_of(law.at(left_out.change, left_out.place), left_out)


def gain_std(slopes: Floats, samples: Samples) -> float:
    """Scatter of the depth scale over balls, by `slopes` (N, 2): 1.48 times the median distance from 1."""
    return mad_std(np.array([*gains_of(slopes, samples).values()]), centre=1.0)


def patch_error(slopes: Floats, samples: Samples) -> float:
    """Mean distance of `slopes` (N, 2) from the true ones, in parts of these.

    Gentle slopes carry the rise, steep ones the depth.

    Of means over PATCHES of each ball, as depth is a sum over many pixels in which their noise averages out: pixel
    by pixel the best guess is one that reads all slopes too low.
    """
    patch, count = patches_of(samples)
    true, off = (
        np.hypot(*(np.bincount(patch, values) / count for values in many.T))
        for many in (samples.slopes, slopes - samples.slopes)
    )
    return float(np.average(off / (true + SLOPE_SOFTENING), weights=count))


def patches_of(samples: Samples) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The patch (N,) of its ball, out of PATCHES, that each sample is in, by number; samples in each patch."""
    steepness = np.hypot(*samples.slopes.T)
    sector = np.floor(
        (np.arctan2(samples.slopes[:, 1], samples.slopes[:, 0]) / np.pi + 1.0) * PATCHES[0] / 2 * 0.999999
    )
    ring = np.floor(PATCHES[1] * 0.999999 * (steepness / steepness.max()) ** 2)
    _, patch = np.unique(np.stack([samples.press, sector, ring]), axis=1, return_inverse=True)
    return patch.ravel(), np.bincount(patch.ravel())


def _fit_without(
    group: npt.NDArray[np.int64], fit: Fitter, contact: Samples, untouched_samples: Samples, *, ridge: float
) -> ColourLaw:
    numbers = tuple(group.tolist())
    return fit(_without(contact, numbers), _without(untouched_samples, numbers), ridge=ridge)


@lru_cache(maxsize=KEPT)
def _without(samples: Samples, numbers: tuple[int, ...]) -> Samples:
    """The samples of other balls: one object for all ways to fit, which know by it what they have worked out."""
    return samples.where(~np.isin(samples.press, numbers))


# The light's law kept with a method: which colour a slope should have, and how far balls left out had another.
#
#     share^2 = sum over patches of balls left out of <u - u_law(p, q)>^2 / sum of <u>^2
#
# u is the change of colour, u_law the shading law (ball/shading_fit.py) of the other balls, p and q the slopes
# that their colour law reads; < > is the mean over a patch, which counts as often as it has samples. What a
# frame's colours have beyond that, the light that the balls saw does not explain
# (heightmap/inconsistent_light.py).


@dataclass(frozen=True, slots=True)
class LightLaw:
    """`terms` (46, 3) of the shading law; `share` of a change of colour that it is off by at balls left out.

    `noise` (3, h, w): what untouched gel is off by; `limit`: what ball pictures reach, in deviations. Both are
    measured when a reader is made; an infinite limit flags nothing.
    """

    terms: Floats
    share: float
    noise: Picture = field(default_factory=lambda: np.zeros((3, 1, 1), np.float32))
    limit: float = np.inf

    def arrays(self) -> dict[str, Floats]:
        """As they are stored: `terms`, `noise`, and `limits` (share, limit)."""
        return {
            "terms": self.terms,
            "noise": self.noise.astype(np.float64),
            "limits": np.array([self.share, self.limit]),
        }


def fit_light_law(contact: Samples, held_out: Floats, *, others: Sequence[ColourLaw]) -> LightLaw | None:
    """The light's law of samples of balls; `held_out` slopes (N, 2) by `others`, each of which lacks a group.

    None where only two colours tell the balls: they leave no residual.
    """
    if not contact.change.any(axis=0).all():
        return None
    patch, count = patches_of(contact)
    off = np.empty_like(contact.change)
    for group, _ in zip(groups_of(contact), others, strict=True):
        out = np.isin(contact.press, group)
        light = fit_light(contact.where(~out), PLACE_PENALTIES[1])
        off[out] = contact.change[out] - colours_of(light, held_out[out], place=contact.place[out])
    misfit, size = (
        sum(float(np.sum(np.bincount(patch, column) ** 2 / count)) for column in many.T)
        for many in (off, contact.change)
    )
    return LightLaw(fit_light(contact, PLACE_PENALTIES[1]), float(np.sqrt(misfit / size)))
