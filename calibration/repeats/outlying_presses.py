"""Do the presses repeat each other? One that stands out of the others, or a zero that wanders over the presses.

Each press has an own offset, its residual e projected on what a depth zero does to it:

    z = sum s e/b^2 / sum s^2/b^2,    s = df/dw, b the samples' noise

The error model takes any scatter of z for granted, however large, so two things are asked beside it. Is one z too
far from those of presses like it (of one radius, three at least), each over what its gain, zero and samples let
expect: Student's t over their robust spread, 1.4826 times the median of |z|, Bonferroni over the presses. It is
`foreign` if it is as far beyond what the tails of all the others let expect: some readings' noise is heavy-tailed,
and then the likeliest t has few degrees of freedom. And does
z jump or drift over the order or the date: the largest cumulative sum of z along it, held against the same z with
like presses in another order, which is exact whatever z's distribution is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import covariates
from calibration.inputs.observations import Ints
from calibration.inputs.press_noise import TYPICAL_GAIN, TYPICAL_ZERO_MM
from tactilevision.records import Floats
from tactilevision.robust import MAD_TO_STD

MIN_COUNT = 8  # presses; fewer have no spread to stand out of
REPEATS = 3  # presses of one radius that a press is compared with, itself among them
SHUFFLES = 999  # orders that chance is read from: p to .001
LEVEL = 0.005  # of either finding where nothing is there: beside the screen's own
TAILS = (2.0, 3.0, 4.0, 6.0, 10.0, 30.0, 1000.0)  # degrees of freedom
DOF_SHARE = 0.37  # of the presses: what the median of absolute deviations is worth (Huber, Robust Statistics, 1.1)
MIN_SPREAD_MM = 1e-3  # mm, spread of zeros that is always allowed for
MIN_SPREAD = 0.3  # of what is expected: presses that stand out have made that larger than it is
BEYOND_TYPICAL = 8.0  # times the usual gain and zero: two of the e-folds that the prior gives rigs (reml.SPREAD)
OF_PRESSES = ("order", "recording date")  # for place, wait and temperature there are effects
OF_SENSOR = (*OF_PRESSES, "T")  # what a force sensor's zero may follow
SAMPLES = 6  # of a press: fewer do not tell a force's zero from its depth's and its gain


@dataclass(frozen=True, slots=True)
class OutlyingPresses:
    """Labels of presses that stand out, covariates that the presses' zeros depend on with p for all looks, and
    whether like presses scatter far more than any rig's. `foreign` where the others' own tails reach none of them.
    """

    presses: tuple[str, ...] = ()
    foreign: bool = False
    wanders: tuple[tuple[str, float], ...] = ()
    scattered: bool = False

    def __bool__(self) -> bool:
        return bool(self.presses or self.wanders)


def outlying_presses(fitted: Fit, rng: np.random.Generator) -> OutlyingPresses:
    """What is odd among the presses of a fit; nothing for fewer than eight of them."""
    data, noise = fitted.data, fitted.noise
    known_apart = data.is_curves or noise.stated  # else the readings' own noise is in gain and zero
    scattered = known_apart and max(noise.gain / TYPICAL_GAIN, noise.zero_mm / TYPICAL_ZERO_MM) > BEYOND_TYPICAL
    if data.count < MIN_COUNT:
        return OutlyingPresses(scattered=scattered)
    groups, own = np.unique(data.presses.radius_mm, return_inverse=True)[1], own_zero_mm(fitted)
    beside = np.abs(_beside_like(own, groups) / _usual_mm(fitted))
    far = beside > _limit(beside, DOF_SHARE * (own.size - np.unique(groups).size), MAD_TO_STD)
    dof = _tail_dof(beside[~far])
    foreign = bool((beside[far] > _limit(beside, dof, _over_median(dof))).any())
    stands_out = tuple(data.presses.label[k] for k in np.flatnonzero(far))
    zeros: list[tuple[Floats, Sequence[str]]] = [(own, OF_PRESSES)]
    if np.bincount(data.press).min() >= SAMPLES:
        zeros.append((own_force_N(fitted), OF_SENSOR))
    wanders = tuple(_wanders(fitted, zeros, groups, rng).items())
    return OutlyingPresses(stands_out, foreign, wanders, scattered)


def own_zero_mm(fitted: Fit) -> Floats:
    """Zero of each press (M,), mm: the z of the equation above."""
    return np.asarray(_along_slope(fitted, fitted.residual_N) / _stiff(fitted))


def own_force_N(fitted: Fit) -> Floats:
    """The force's zero of each press (M,), freed of what its depth's zero and its gain do."""
    about, press = fitted.about, fitted.data.press
    columns = np.column_stack([np.ones(press.size), about.slope_N_per_mm, about.force_N, fitted.residual_N])
    white = columns / about.base_N[:, None]
    return np.array(
        [
            np.linalg.lstsq(one[:, :3], one[:, 3], rcond=1e-6)[0][0]
            for one in np.split(white, fitted.data.first[1:])
        ]
    )


def _usual_mm(fitted: Fit) -> Floats:
    """How far z (M,) may be expected to scatter by a press's own gain and zero, and by its samples."""
    noise, stiff = fitted.noise, _stiff(fitted)
    of_gain = noise.gain * _along_slope(fitted, fitted.about.force_N) / stiff
    return np.asarray(np.sqrt(noise.zero_mm**2 + of_gain**2 + noise.scale**2 / stiff + MIN_SPREAD_MM**2))


def _along_slope(fitted: Fit, values_N: Floats) -> Floats:
    weight = fitted.about.slope_N_per_mm / fitted.about.base_N**2
    return np.asarray(np.bincount(fitted.data.press, weight * values_N), dtype=float)


def _stiff(fitted: Fit) -> Floats:
    return np.maximum(_along_slope(fitted, fitted.about.slope_N_per_mm), 1e-300)


def _beside_like(own: Floats, groups: Ints) -> Floats:
    """Less the median of the group; of all where a group has fewer than three."""
    rest = own - np.median(own)
    for group in np.unique(groups):
        mine = groups == group
        if mine.sum() >= REPEATS:
            rest[mine] = own[mine] - np.median(own[mine])
    return np.asarray(rest)


def _limit(beside: Floats, dof: float, over_median: float) -> float:
    """How far |z| of the farthest of so many presses may lie, by t of these degrees of freedom."""
    from scipy.stats import t

    spread = max(over_median * float(np.median(beside)), MIN_SPREAD)
    return spread * float(t.isf(LEVEL / 2 / beside.size, max(dof, 2.0)))


def _tail_dof(beside: Floats) -> float:
    """The likeliest degrees of freedom of these |z|, as far as their median says how wide they are."""
    from scipy.stats import t

    def likelihood(dof: float) -> float:
        spread = max(_over_median(dof) * float(np.median(beside)), MIN_SPREAD)
        return float(np.sum(t.logpdf(beside / spread, dof) - np.log(spread)))

    return max(TAILS, key=likelihood)


def _over_median(dof: float) -> float:
    """t's scale over the median of its |z|."""
    from scipy.stats import t

    return 1 / float(t.isf(0.25, dof))


def _wanders(
    fitted: Fit, zeros: Sequence[tuple[Floats, Sequence[str]]], groups: Ints, rng: np.random.Generator
) -> dict[str, float]:
    """Covariates of presses that a zero depends on, each zero with those it may follow; p adjusted by the smallest
    of all in each of the shuffles.
    """
    first = fitted.data.first
    along = {c.name: np.argsort(c.values[first], kind="stable") for c in covariates(fitted.data) if c.of_press}
    looks = [(name, z - z.mean()) for z, names in zeros for name in names if name in along]
    if not looks:
        return {}
    orders = [np.arange(groups.size), *(_shuffled(groups, rng) for _ in range(SHUFFLES))]
    table = np.array([[np.max(np.abs(np.cumsum(z[one][along[name]]))) for name, z in looks] for one in orders])
    p = np.array([(column[:, None] <= column).mean(axis=1) for column in table.T]).T
    smallest = p.min(axis=1)
    found: dict[str, float] = {}
    for (name, _), own in zip(looks, p[0], strict=True):
        adjusted = float(np.mean(smallest <= own))
        if adjusted < LEVEL:
            found[name] = min(adjusted, found.get(name, 1.0))
    return found


def _shuffled(groups: Ints, rng: np.random.Generator) -> Ints:
    """Numbers of the presses (M,) with like ones in another order."""
    mixed = np.arange(groups.size)
    for group in np.unique(groups):
        mine = np.flatnonzero(groups == group)
        mixed[mine] = rng.permutation(mine)
    return mixed
