"""Laws that never saw some of the balls: what they make of these, and how far what they state is borne out.

A third of the balls is left out at a time. A law f_a that lacks the group a states of itself, by the laws f_ab
that lack another group as well (`jackknife.py`), how far its depth scale is off at the balls of a; and these show
how far it is. All that is stated is taken times

    k^2 = (m + n z^2) / (m + n)        z: what 68 % of the errors of n balls, in stated deviations, do not exceed

with m = PRIOR_BALLS, so that a few balls do not change it much. Balls among the others tell it: what lying beyond
these adds is stated apart (`extrapolation.py`), and no doubt there may make the rest look better. The law that saw
all balls may not be asked instead: what it states of a ball's place is what leaving out that very ball changes
there, which is the error held against it, so that whatever is stated seems right. On eleven simulated lights k was
.5 to 1.1 over all balls, as among the balls a jackknife states too much: without a ball the next one is twice as
far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball.extrapolation import (
    distance_beyond,
    extrapolated_std,
    growth_rate,
    sides_of,
)
from tactilevision.photometric.ball.jackknife import gain_map, places
from tactilevision.photometric.ball.samples import KEPT, Samples
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.records import Floats
from tactilevision.robust import mad_std

FOLDS = 3  # groups of balls; more leave less out at a time, and cost a fit for each pair of groups
PRIOR_BALLS = 4  # balls that what is stated is worth by itself
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
