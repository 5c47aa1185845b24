"""Find presses that do not repeat the others, and drift of the zero over the presses.

Each press has an own offset, its residual e projected on what a depth zero does to it:

    z = sum s e/b^2 / sum s^2/b^2,    s = df/dw, b the samples' noise

The error model accepts any scatter of z, however large, so two statistics test it in addition; their p comes from
the bootstrap of the residual. The first is the largest |z| about the median of similar presses (of one radius, at
least three), each over its expected std, over the robust std 1.4826 median |z|. The second is the largest
cumulative sum of z, or of the force's own zero, along the order, the date or the temperature, over its std: a jump
or a drift. Outlying presses are those beyond Student's t, Bonferroni-corrected for the number of presses. A press
is `foreign` if it also lies beyond the tails of all the others: heavy-tailed noise has a likeliest t of few
degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.fit.repeats import LEVEL
from calibration.inputs.conditions import covariates
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Ints
from tactilevision.records.constants import MICRO, NONZERO
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import MAD_TO_STD

MIN_COUNT = 8  # presses that have a spread to compare with
REPEATS = 3  # presses of one radius that a press is compared with, itself included
ALARM = LEVEL / 10  # false alarm rate over all presses
STANDS_OUT = "a press of its own"
WANDERS = "zeros over "  # followed by the covariate
TAILS = (2, 3, 4, 6, 10, 30, 1000)  # degrees of freedom of Student's t
DOF_SHARE = 0.37  # efficiency of the median of absolute deviations (Huber, Robust Statistics, 1.1)
MIN_SPREAD_MM = 1e-3  # mm, least std of zeros
MIN_SPREAD = 0.3  # least robust std over the expected one, which outlying presses have enlarged
BEYOND_TYPICAL = 8  # times the usual gain and zero: two e-folds of the prior (reml.SPREAD)
OF_PRESSES = ("order", "recording date")  # for place, wait and temperature there are effects
OF_SENSOR = (*OF_PRESSES, "T")  # covariates of a force sensor's zero
SAMPLES = 6  # of a press: fewer do not separate a force's zero from its depth's and its gain


@dataclass(frozen=True, slots=True)
class OutlyingPresses:
    """Outlying presses by label; covariates on which the presses' zeros depend, with p corrected for all tests.

    `scattered`: similar presses scatter far more than usual; `foreign`: a press lies beyond the others' tails.
    """

    presses: tuple[str, ...] = ()
    foreign: bool = False
    wanders: tuple[tuple[str, float], ...] = ()
    scattered: bool = False

    def __bool__(self) -> bool:
        return bool(self.presses or self.wanders)


def outlying_presses(fitted: Fit, *, wanders: Sequence[tuple[str, float]] = ()) -> OutlyingPresses:
    """Return the outlying presses of a fit, none of fewer than eight; `wanders` is passed on."""
    data, noise = fitted.data, fitted.noise
    separate = data.is_curves or noise.stated  # else gain and zero include the readings' noise
    beyond = max(noise.gain / TYPICAL_GAIN, noise.zero_mm / TYPICAL_ZERO_MM) > BEYOND_TYPICAL
    scattered = separate and beyond and fitted.data.resultants is None  # maps of contacts differ by more
    if data.count < MIN_COUNT:
        return OutlyingPresses(scattered=scattered)
    size, far, dof = _outlying(fitted)
    foreign = bool((size[far] > _limit(size, dof, _over_median(dof))).any())
    labels = tuple(data.presses.label[k] for k in np.flatnonzero(far))
    return OutlyingPresses(labels, foreign, tuple(wanders), scattered)


def press_dof(fitted: Fit) -> float:
    """Return the degrees of freedom of the likeliest Student t of presses' zeros, without outlying ones."""
    if fitted.data.count < MIN_COUNT:
        return TAILS[-1]
    size, far, dof = _outlying(fitted)
    gain = _likelihood(dof, size[~far]) - _likelihood(TAILS[-1], size[~far])
    return dof if gain > np.log(size.size) else TAILS[-1]  # twice the cost of a parameter: Schwarz (1978)


def _outlying(fitted: Fit) -> tuple[Floats, Bools, float]:
    """Return normalised |z| (M,) about similar presses, which of them are outlying, and the others' tail."""
    groups = _groups(fitted)
    size = np.abs(_about_similar(own_zero_mm(fitted)[:, None], groups)[:, 0] / _usual_mm(fitted))
    far = size > _limit(size, DOF_SHARE * (size.size - np.unique(groups).size), MAD_TO_STD)
    return size, far, max(TAILS, key=lambda dof: _likelihood(dof, size[~far]))


class PressLooks:
    """Statistics of many residuals of one fit at once; `names` of the tests, none for few presses."""

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
        """Return the statistics (n, k) of residuals (N, k)."""
        if not self.names:
            return np.zeros((0, residual_N.shape[1]))
        fitted = self._fitted
        zeros = _along_slope(fitted, residual_N) / _stiff(fitted)[:, None]
        size = np.abs(_about_similar(zeros, self._groups) / _usual_mm(fitted)[:, None])
        rows = [size.max(axis=0) / np.maximum(MAD_TO_STD * np.median(size, axis=0), MIN_SPREAD)]
        forces = own_force_N(fitted, residual_N) if any(force for force, _, _ in self._looks) else zeros
        for force, order, _ in self._looks:
            own = forces if force else zeros
            own = own - own.mean(axis=0)
            path = np.abs(np.cumsum(own[order], axis=0)).max(axis=0)
            rows.append(path / np.maximum(own.std(axis=0), NONZERO))
        return np.array(rows)


def _groups(fitted: Fit) -> Ints:
    return np.asarray(np.unique(fitted.data.presses.radius_mm, return_inverse=True)[1])


def own_zero_mm(fitted: Fit) -> Floats:
    """Return the zero z of each press (M,), mm."""
    return np.asarray(_along_slope(fitted, fitted.residual_N) / _stiff(fitted))


def own_force_N(fitted: Fit, residual_N: Floats) -> Floats:
    """Return the force's zero of each press (M, k), fitted along with its depth's zero and its gain."""
    about = fitted.about
    ends = fitted.data.first[1:]
    columns = np.column_stack([np.ones(about.force_N.size), about.slope_N_per_mm, about.force_N])
    parts = zip(
        np.split(columns / about.base_N[:, None], ends),
        np.split(residual_N / about.base_N[:, None], ends),
        strict=True,
    )
    return np.array([np.linalg.lstsq(one, error, rcond=MICRO)[0][0] for one, error in parts])


def _usual_mm(fitted: Fit) -> Floats:
    """Return the expected std of z (M,), mm, by a press's gain, its zero and its samples."""
    noise, stiff = fitted.noise, _stiff(fitted)
    of_gain = noise.gain * _along_slope(fitted, fitted.about.force_N) / stiff
    return np.asarray(np.sqrt(noise.zero_mm**2 + of_gain**2 + noise.scale**2 / stiff + MIN_SPREAD_MM**2))


def _along_slope(fitted: Fit, values_N: Floats) -> Floats:
    """Return weighted sums over presses (M,) or (M, k) of values (N,) or (N, k)."""
    weight = fitted.about.slope_N_per_mm / fitted.about.base_N**2
    return np.asarray(np.add.reduceat((weight * values_N.T).T, fitted.data.first, axis=0), dtype=float)


def _stiff(fitted: Fit) -> Floats:
    return np.maximum(_along_slope(fitted, fitted.about.slope_N_per_mm), NONZERO)


def _about_similar(own: Floats, groups: Ints) -> Floats:
    """Return (M, k) less the median of the group, or of all where a group has fewer than three."""
    rest = own - np.median(own, axis=0)
    for group in np.unique(groups):
        mine = groups == group
        if mine.sum() >= REPEATS:
            rest[mine] = own[mine] - np.median(own[mine], axis=0)
    return np.asarray(rest)


def _limit(size: Floats, dof: float, over_median: float) -> float:
    """Return the limit of |z| at ALARM for so many presses, by t of these degrees of freedom."""
    from scipy.special import stdtrit

    spread = max(over_median * float(np.median(size)), MIN_SPREAD)
    return -spread * float(stdtrit(max(dof, 2.0), ALARM / 2 / size.size))


def _likelihood(dof: float, size: Floats) -> float:
    """Return ln L of t with these degrees of freedom, scaled by the median of |z| (n,)."""
    spread = max(_over_median(dof) * float(np.median(size)), MIN_SPREAD)
    return float(np.sum(log_student(size / spread, dof) - np.log(spread)))


def _over_median(dof: float) -> float:
    """Return t's scale over the median of its absolute value."""
    from scipy.special import stdtrit

    return -1 / float(stdtrit(dof, 0.25))


def log_student(values: Floats, dof: float) -> Floats:
    """Return the logarithm of Student's density at values (N,); scipy.stats takes a second to import."""
    from scipy.special import gammaln

    size = gammaln((dof + 1) / 2) - gammaln(dof / 2) - np.log(dof * np.pi) / 2
    return np.asarray(size - (dof + 1) / 2 * np.log1p(values**2 / dof))
