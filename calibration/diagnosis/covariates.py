"""Dependence of residuals on recorded covariates: steps, trends and change points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.sensitivity import force_without
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit
from calibration.fit.repeats import LEVEL
from calibration.inputs.conditions import Covariate, bins, covariates, repeat_groups
from calibration.model.stages import Stage
from tactilevision.records.constants import MICRO, NONZERO, TINY
from tactilevision.records.measured import Floats

# Step functions of all recorded covariates, as directions of the force, and the allowance for an effect's form.

DEPTH_BINS = 16  # steps of the depth
FORM = 0.1  # std of a gel effect's form in each step of each covariate, over what the effect adds (others_curves)
HOW_A_PRESS_GOES = ("w", "w/h", "1/w", "P", "t", "load/unload", "log rate", "a")  # may change any effect of a gel
OTHER_BINS = 6  # steps of every other covariate
PRESS_BINS = 8  # groups of presses, between which a step may lie
OVER = " by "  # between a parameter and the covariate over which it has to be constant
SAME = MICRO  # of the largest singular value: less is linearly dependent
IN_WORDS = {
    "w": "the depth",
    "w/h": "the depth",
    "1/w": "the depth",
    "P": "the force",
    "t": "the time in the press",
    "a": "the punch's radius",
    "T": "the temperature",
    "x": "the place in x",
    "y": "the place in y",
    "log rate": "the speed",
    "order": "the order of pressing",
    "recording date": "the day",
    "azimuth": "the direction on the pad",
    "Fx": "the tangential force in x",
    "Fy": "the tangential force in y",
    "indenter": "the indenter",
    "wait": "the wait before",
    "load/unload": "loading or unloading",
    "time": "the time",
    "slope": "the slope next to the face",
    "azimuth beside the face": "the direction about the face",
    "certified against reconstructed depth": "the reconstructed depth over the certified one",
}


def covariate_steps(steady: Fit) -> dict[str, Floats]:
    """Return steps (N, k) of a sample's covariates, and of parameters that have to be constant, by name."""
    seen = seen_covariates(steady)
    return {c.name: _steps(steady, c) for c in seen if not c.of_press} | _of_one_size(steady, seen)


def press_terms(steady: Fit) -> dict[str, Floats]:
    """Return changes (N, k) of the presses' stiffness over each press covariate: steps, a line, a parabola."""
    return {c.name: _press_terms(steady, c) for c in seen_covariates(steady) if c.of_press}


def _press_terms(fitted: Fit, covariate: Covariate) -> Floats:
    beyond = np.cumsum(indicators(covariate, PRESS_BINS)[:, :0:-1], axis=1)  # one step each
    along = (covariate.values - np.mean(covariate.values)) / np.ptp(covariate.values)
    smooth = [along, along**2] if beyond.shape[1] > 2 else []
    terms = np.column_stack([*beyond.T, *smooth])
    return np.asarray(terms * (np.abs(fitted.about.force_N) + fitted.about.base_N * fitted.noise.scale)[:, None])


def seen_covariates(steady: Fit) -> tuple[Covariate, ...]:
    """Return the covariates with the fitted force; bins of the measured one would sort residuals by noise."""
    return covariates(steady.data.with_force(steady.force_N))


def form_errors(steady: Fit) -> Floats:
    """Return the errors that the form of the gel's effects in the fit may have (N, m), N, one std a column.

    Each is a random share of what the effect adds, in each step of how a press goes and of the covariates that the
    effect states. Errors of depth and of force have an exact form.
    Source: Kennedy, O'Hagan, J. R. Stat. Soc. B 63 (2001) 425 (a discrepancy as a random function).
    """
    model, seen = steady.model, seen_covariates(steady)
    found = [np.zeros((steady.data.size, 0))]
    for effect in (e for e in model.effects if e.stage not in (Stage.DEPTH, Stage.INSTRUMENT)):
        without = force_without(model, steady.values, steady.data, key=effect.key)
        own = {*HOW_A_PRESS_GOES, *effect.seen_in}
        added = FORM * (steady.force_N - without)[:, None]
        found += [added * indicators(c, OTHER_BINS) for c in seen if c.name in own]
    # independent columns of the same covariance: bins of similar covariates repeat
    columns = np.hstack(found)
    _, sizes, axes = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(columns @ axes[sizes > SAME * sizes.max(initial=0.0)].T)


def _steps(fitted: Fit, covariate: Covariate) -> Floats:
    """Return step functions (N, k) of the depth over a covariate."""
    carried = fitted.about.slope_N_per_mm
    hot = indicators(covariate, DEPTH_BINS if covariate.name == "w" else OTHER_BINS)
    return np.asarray(hot * (np.abs(carried) + fitted.about.base_N * fitted.noise.scale)[:, None])


def indicators(covariate: Covariate, most: int) -> Floats:
    """Return 1 for the bin of each sample (N, k), else 0."""
    number = bins(covariate, most)
    return np.asarray(np.eye(int(number.max()) + 1)[number])


def _of_one_size(fitted: Fit, seen: Sequence[Covariate]) -> dict[str, Floats]:
    """Return step functions (N, k) of parameters of effects in the fit that have to be constant (`same_over`)."""
    found = {}
    for effect in fitted.model.effects:
        for name in (f"{effect.key}.{p.name}" for p in effect.parameters if effect.same_over):
            change = fitted.jacobian[:, fitted.index(name)]
            for covariate in (c for c in seen if c.name in effect.same_over):
                found[f"{name}{OVER}{covariate.name}"] = indicators(covariate, OTHER_BINS) * change[:, None]
    return found


# Trends of presses' residuals along the covariates.
#
# A press's residual is the mean of its samples' over the std of its noise, its covariate the mean there.
# Spearman's rank correlation of the two over the presses is compared with presses in random order; p is
# Bonferroni's. It detects a slow drift of few presses, which free steps of a covariate do not. Source: Hollander,
# Wolfe, Chicken, Nonparametric Statistical Methods, 3rd ed. (2014), ch. 8.

TREND_SHUFFLES = 9999  # of the presses: p to 1e-4
MOST_VALUES = 4_000_000  # values shuffled at once: fewer shuffles of more than 400 presses
NO_QUANTITY = ("load/unload", "indenter", "azimuth", "azimuth beside the face")  # names, and directions around


def press_trends(fitted: Fit) -> dict[str, float]:
    """Return p of each covariate's trend over the presses, by its name.

    Names, directions around the axis, and what is the same in all presses are not tested.
    """
    fitted = at_denoised_depth(fitted)
    data, seen = fitted.data, seen_covariates(fitted)
    count = np.bincount(data.press)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(data.press, values) / count)

    along = {one.name: _ranks(mean(one.values)) for one in seen if one.name not in NO_QUANTITY}
    along = {name: ranks for name, ranks in along.items() if np.ptp(ranks) > 0}
    own = mean(fitted.residual_N)
    if not along or np.ptp(own) == 0:
        return {}
    noise, about = fitted.noise, fitted.about
    of_samples = noise.scale**2 * mean(about.base_N**2) / count
    of_press = (noise.gain * mean(about.force_N)) ** 2 + (noise.zero_mm * mean(about.slope_N_per_mm)) ** 2
    ranks = _ranks(own / np.sqrt(of_samples + of_press))
    draws = int(min(TREND_SHUFFLES, MOST_VALUES / own.size))
    rows = np.vstack([ranks, np.random.default_rng(0).permuted(np.tile(ranks, (draws, 1)), axis=1)])
    score = np.abs(rows @ np.column_stack(list(along.values())))
    p = np.mean(score >= score[0] * (1 - TINY), axis=0)
    return {name: min(1.0, len(along) * float(one)) for name, one in zip(along, p, strict=True)}


def _ranks(values: Floats) -> Floats:
    """Return ranks about their mean (M,), equal values with one rank."""
    ranks = np.unique(np.round(values, 9), return_inverse=True)[1].astype(float)
    return np.asarray(ranks - ranks.mean())


# Change point: a jump in the mean residual of presses.
#
# The largest cumulative sum of the presses' means in order of time is compared with that of other orders, in which
# like presses (same indenter and rate) change places, so that a protocol from small to large punches is no jump.

CHANGE_SHUFFLES = 999  # p to .001
MIN_COUNT = 8  # presses that show a trend


def change_point(fitted: Fit, rng: np.random.Generator) -> str | None:
    """Return the first press after the jump; None where none is significant or presses are fewer than eight."""
    data = fitted.data
    if data.count < MIN_COUNT:
        return None
    weight = np.bincount(data.press, fitted.about.force_N**2)
    mean = np.bincount(data.press, fitted.residual_N * fitted.about.force_N) / np.maximum(weight, NONZERO)
    groups = repeat_groups(data)
    rest = mean - (np.bincount(groups, mean) / np.bincount(groups))[groups]
    if not np.std(rest) > 0:
        return None
    place, size = _largest(rest)
    chance = [_largest(_shuffled(rest, groups, rng))[1] for _ in range(CHANGE_SHUFFLES)]
    beyond = (1 + np.count_nonzero(np.array(chance) >= size)) / (1 + CHANGE_SHUFFLES)
    return data.presses.label[place + 1] if beyond < LEVEL else None


def _largest(values: Floats) -> tuple[int, float]:
    path = np.abs(np.cumsum(values)[:-1])
    k = int(np.argmax(path))
    return k, float(path[k])


def _shuffled(
    values: Floats, groups: np.ndarray[tuple[int], np.dtype[np.int64]], rng: np.random.Generator
) -> Floats:
    """Return the values of each group in another order."""
    mixed = values.copy()
    for group in np.unique(groups):
        mine = np.flatnonzero(groups == group)
        mixed[mine] = values[rng.permutation(mine)]
    return mixed
