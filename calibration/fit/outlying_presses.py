"""Find presses that do not repeat the others, and drift of the zero over the presses.

Each press has an own offset, its residual e projected on what a depth zero does to it:

    z = sum s e/b^2 / sum s^2/b^2,    s = df/dw, b the samples' noise

The error model takes any scatter of z for granted, however large, so two things are asked beside it. How far is
the farthest z from those of presses like it (of one radius, three at least), each over what its gain, zero and
samples let expect: over their robust spread, 1.4826 times the median of |z|. And does z, or the force's own zero,
jump or drift over the order, the date or the temperature: the largest cumulative sum along it over its own spread.
What either is worth, the bootstrap of the residual says, of which these are two statistics. Which presses they
are: those beyond Student's t, Bonferroni over the presses. A press is `foreign` if it is as far beyond what the
tails of all the others let expect: readings' noise may be heavy-tailed, and the likeliest t is then a low one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import covariates
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Ints
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import MAD_TO_STD

MIN_COUNT = 8  # presses; fewer have no spread to stand out of
REPEATS = 3  # presses of one radius that a press is compared with, itself among them
LEVEL = 0.005  # of any press beyond Student's t, where none is odd
STANDS_OUT = "a press of its own"
WANDERS = "zeros over "  # what they wander with
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


def outlying_presses(fitted: Fit, *, wanders: Sequence[tuple[str, float]] = ()) -> OutlyingPresses:
    """What is odd among the presses of a fit, beside what its zeros wander with; no press of fewer than eight."""
    data, noise = fitted.data, fitted.noise
    known_apart = data.is_curves or noise.stated  # else the readings' own noise is in gain and zero
    scattered = known_apart and max(noise.gain / TYPICAL_GAIN, noise.zero_mm / TYPICAL_ZERO_MM) > BEYOND_TYPICAL
    if data.count < MIN_COUNT:
        return OutlyingPresses(scattered=scattered)
    beside, far, dof = _standing_out(fitted)
    foreign = bool((beside[far] > _limit(beside, dof, _over_median(dof))).any())
    stands_out = tuple(data.presses.label[k] for k in np.flatnonzero(far))
    return OutlyingPresses(stands_out, foreign, tuple(wanders), scattered)


def press_dof(fitted: Fit) -> float:
    """Degrees of freedom of the likeliest Student t of presses' zeros, those that stand out left aside."""
    if fitted.data.count < MIN_COUNT:
        return TAILS[-1]
    beside, far, dof = _standing_out(fitted)
    brings = _likelihood(dof, beside[~far]) - _likelihood(TAILS[-1], beside[~far])
    return dof if brings > np.log(beside.size) else TAILS[-1]  # twice what a number costs: Schwarz (1978)


def _standing_out(fitted: Fit) -> tuple[Floats, Bools, float]:
    """|z| (M,) beside the like, which are far, and the tail of the others."""
    groups = _groups(fitted)
    beside = np.abs(_beside_like(own_zero_mm(fitted)[:, None], groups)[:, 0] / _usual_mm(fitted))
    far = beside > _limit(beside, DOF_SHARE * (beside.size - np.unique(groups).size), MAD_TO_STD)
    return beside, far, _tail_dof(beside[~far])


class PressLooks:
    """The statistics of many residuals of one fit at once; `names` of what is looked at, none for few presses."""

    def __init__(self, fitted: Fit) -> None:
        self._fitted, self._groups = fitted, _groups(fitted)
        data = fitted.data
        enough = data.count >= MIN_COUNT
        along = {c.name: np.argsort(c.values[data.first], kind="stable") for c in covariates(data) if c.of_press}
        on_force = np.bincount(data.press).min() >= SAMPLES
        looks = [(False, name) for name in OF_PRESSES] + [(True, name) for name in OF_SENSOR if on_force]
        self._looks = [(force, along[name], name) for force, name in looks if name in along and enough]
        wandering = [f"{WANDERS}{name}{' of the force' if force else ''}" for force, _, name in self._looks]
        self.names = [STANDS_OUT, *wandering] if enough else []

    def statistics(self, residual_N: Floats) -> Floats:
        """(n, k) of residuals (N, k)."""
        if not self.names:
            return np.zeros((0, residual_N.shape[1]))
        fitted = self._fitted
        zeros = _along_slope(fitted, residual_N) / _stiff(fitted)[:, None]
        beside = np.abs(_beside_like(zeros, self._groups) / _usual_mm(fitted)[:, None])
        rows = [beside.max(axis=0) / np.maximum(MAD_TO_STD * np.median(beside, axis=0), MIN_SPREAD)]
        forces = own_force_N(fitted, residual_N) if any(force for force, _, _ in self._looks) else zeros
        for force, order, _ in self._looks:
            own = forces if force else zeros
            own = own - own.mean(axis=0)
            path = np.abs(np.cumsum(own[order], axis=0)).max(axis=0)
            rows.append(path / np.maximum(own.std(axis=0), 1e-300))
        return np.array(rows)


def _groups(fitted: Fit) -> Ints:
    return np.asarray(np.unique(fitted.data.presses.radius_mm, return_inverse=True)[1])


def own_zero_mm(fitted: Fit) -> Floats:
    """Zero of each press (M,), mm: the z of the equation above."""
    return np.asarray(_along_slope(fitted, fitted.residual_N) / _stiff(fitted))


def own_force_N(fitted: Fit, residual_N: Floats) -> Floats:
    """The force's zero of each press (M, k), freed of what its depth's zero and its gain do."""
    about = fitted.about
    ends = fitted.data.first[1:]
    columns = np.column_stack([np.ones(about.force_N.size), about.slope_N_per_mm, about.force_N])
    parts = zip(
        np.split(columns / about.base_N[:, None], ends),
        np.split(residual_N / about.base_N[:, None], ends),
        strict=True,
    )
    return np.array([np.linalg.lstsq(one, error, rcond=1e-6)[0][0] for one, error in parts])


def _usual_mm(fitted: Fit) -> Floats:
    """How far z (M,) may be expected to scatter by a press's own gain and zero, and by its samples."""
    noise, stiff = fitted.noise, _stiff(fitted)
    of_gain = noise.gain * _along_slope(fitted, fitted.about.force_N) / stiff
    return np.asarray(np.sqrt(noise.zero_mm**2 + of_gain**2 + noise.scale**2 / stiff + MIN_SPREAD_MM**2))


def _along_slope(fitted: Fit, values_N: Floats) -> Floats:
    """Sums over presses (M,) or (M, k) of values (N,) or (N, k)."""
    weight = fitted.about.slope_N_per_mm / fitted.about.base_N**2
    return np.asarray(np.add.reduceat((weight * values_N.T).T, fitted.data.first, axis=0), dtype=float)


def _stiff(fitted: Fit) -> Floats:
    return np.maximum(_along_slope(fitted, fitted.about.slope_N_per_mm), 1e-300)


def _beside_like(own: Floats, groups: Ints) -> Floats:
    """(M, k) less the median of the group; of all where a group has fewer than three."""
    rest = own - np.median(own, axis=0)
    for group in np.unique(groups):
        mine = groups == group
        if mine.sum() >= REPEATS:
            rest[mine] = own[mine] - np.median(own[mine], axis=0)
    return np.asarray(rest)


def _limit(beside: Floats, dof: float, over_median: float) -> float:
    """How far |z| of the farthest of so many presses may lie, by t of these degrees of freedom."""
    from scipy.special import stdtrit

    spread = max(over_median * float(np.median(beside)), MIN_SPREAD)
    return -spread * float(stdtrit(max(dof, 2.0), LEVEL / 2 / beside.size))


def _tail_dof(beside: Floats) -> float:
    """The likeliest degrees of freedom of these |z|, as far as their median says how wide they are."""
    return max(TAILS, key=lambda dof: _likelihood(dof, beside))


def _likelihood(dof: float, beside: Floats) -> float:
    spread = max(_over_median(dof) * float(np.median(beside)), MIN_SPREAD)
    return float(np.sum(log_student(beside / spread, dof) - np.log(spread)))


def _over_median(dof: float) -> float:
    """t's scale over the median of its |z|."""
    from scipy.special import stdtrit

    return -1 / float(stdtrit(dof, 0.25))


def log_student(values: Floats, dof: float) -> Floats:
    """The logarithm of Student's density at values (N,); scipy.stats has it too, and takes a second to import."""
    from scipy.special import gammaln

    size = gammaln((dof + 1) / 2) - gammaln(dof / 2) - np.log(dof * np.pi) / 2
    return np.asarray(size - (dof + 1) / 2 * np.log1p(values**2 / dof))
