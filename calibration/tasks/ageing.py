"""Drift of one gel's stiffness over dated recordings: whether it has changed, and until when its E holds.

Errors that all recordings share (machined heights, radii, thickness, nu, sticking) cancel in the change of the
stiffness c, so each recording k counts with its own noise s_k alone:

    ln c_k = a + b t_k + e_k,    var e_k = s_k^2 + tau^2,

by weighted least squares. s_k^2, known by some ten presses, is moderated by the mean of all recordings with the
weight of MODERATE degrees of freedom (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3). tau is what recordings
scatter beyond what each one states, as by mounting: by moments, from three recordings on (DerSimonian and Laird,
Control. Clin. Trials 7 (1986) 177).

The line is fitted anew at every recording from FIRST on. A change is reported where b differs from 0 at the level
LEVEL/LOOKS by Student's distribution (Welch's degrees of freedom), LOOKS the number of fits in SERIES recordings.
Of such series of a gel that does not age at most LEVEL report a change, looked at after each (Bonferroni).
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.fit.least_squares import quantile95
from calibration.fit.repeats import LEVEL
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Estimate, Floats, Pair

SERIES = 12  # recordings in which at most LEVEL of steady gels are reported as changed
FIRST = 3  # recordings before which a drift cannot be told from how recordings scatter
LOOKS = SERIES - FIRST + 1  # at a series, one after each recording
MODERATE = 10.0  # degrees of freedom of the mean variance of all recordings for each one's
WEEK = 7  # days in a week


@dataclass(frozen=True, slots=True)
class Line:
    """Drift b a day of ln c, its standard deviation and degrees of freedom, and `scatter` tau of ln c.

    `p` is of no drift; `p_scatter` of recordings that scatter as each one states.
    """

    rate: float
    std: float
    dof: float
    scatter: float
    p: float
    p_scatter: float

    def change(self, days: float) -> tuple[float, Pair]:
        """Return the relative change of c over so many days with its 95 % interval."""
        value, low, high = (float(one[0]) for one in self.band(np.array([days])))
        return value, (low, high)

    def band(self, days: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the relative change after days (k,), and its 95 % ends, by the drift's uncertainty alone."""
        reach = quantile95(self.dof) * self.std
        low, middle, high = (np.expm1(days * (self.rate + end)) for end in (-reach, 0.0, reach))
        return middle, low, high

    @property
    def fastest(self) -> float:
        """Return the fastest drift a day, up or down, within the 95 % interval."""
        return abs(self.rate) + quantile95(self.dof) * self.std


def fit_line(days: Floats, log_c: Floats, std: Floats, dof: Floats) -> Line:
    """Return the line through ln c (n,) over time (n,) in days, of two at least.

    `std` (n,) of ln c, dimensionless, is known with `dof` (n,) degrees of freedom.
    """
    from scipy.stats import chi2, t as student

    count, own = len(days), np.maximum(std, TINY) ** 2
    own = (dof * own + MODERATE * np.average(own, weights=dof)) / (dof + MODERATE)
    dof = dof + MODERATE
    weight, scatter, p_scatter = 1 / own, 0.0, 1.0
    if count >= FIRST:
        design = np.stack([np.ones(count), days - days.mean()], axis=1)
        weighted = design * weight[:, None]
        left = np.diag(weight) - weighted @ np.linalg.solve(design.T @ weighted, weighted.T)
        misfit = float(log_c @ left @ log_c)
        scatter = float(np.sqrt(max(misfit - (count - 2), 0.0) / np.trace(left)))
        p_scatter = float(chi2.sf(misfit, count - 2))
    weight = 1 / (own + scatter**2)
    lever = days - np.average(days, weights=weight)
    slope = weight * lever / (weight * lever**2).sum()
    parts = slope**2 * own
    beyond = float((slope**2).sum() * scatter**2)
    variance = float(parts.sum()) + beyond
    found_dof = variance**2 / float((parts**2 / dof).sum() + beyond**2 / max(count - 2, 1))
    rate, found_std = float(slope @ log_c), float(np.sqrt(variance))
    p = float(2 * student.sf(abs(rate) / found_std, max(found_dof, 1.0)))
    return Line(rate, found_std, found_dof, scatter, p, p_scatter)


@dataclass(frozen=True, slots=True)
class Ageing:
    """The change of a gel's stiffness, which is E's at constant nu.

    `change` is relative, from the first recording to the last, `rate` that of a week; both without a value where
    the recordings cannot tell. `reported`: the date at which a change was first reported; None: none was. `line`
    is the present one. `recalibrate_by`: when the drift since the last recording may exceed the tolerated error.
    """

    change: Estimate
    rate: Estimate
    reported: datetime.date | None
    recalibrate_by: datetime.date | None
    why: str
    line: Line | None = None


def ageing(
    dates: Sequence[datetime.date],
    log_c: Sequence[float],
    std: Sequence[float],
    dof: Sequence[float],
    *,
    tolerance: float,
) -> Ageing:
    """Return how ln c (n,) at these dates, in order, has changed; `std` of ln c with `dof` degrees of freedom.

    `tolerance` is the relative error of E that is tolerated. The date to recalibrate is that at which the fastest
    drift within the 95 % interval reaches it, and no further ahead than the recordings reach back.
    """
    days = np.array([(date - dates[0]).days for date in dates], float)
    series = np.array(log_c, float), np.array(std, float), np.array(dof, float)
    lines = {
        count: fit_line(days[:count], *(one[:count] for one in series))
        for count in range(FIRST, len(days) + 1)
        if days[count - 1] > 0
    }
    if len(days) not in lines:
        had = f"recordings: {len(days)}, dates: {len(set(dates))}"
        why = f"{had}; a drift takes {FIRST} recordings that determine c, of two dates at least"
        nothing = Estimate(None, None, None, "1", why)
        return Ageing(nothing, Estimate(None, None, None, "1/week", why), None, None, why)
    line, span = lines[len(days)], float(days[-1])
    reported = next((dates[count - 1] for count, one in lines.items() if one.p * LOOKS < LEVEL), None)
    change, interval = line.change(span)
    rate, rates = line.change(WEEK)
    until = float(np.log1p(tolerance)) / line.fastest
    weekly = f"E may drift by up to {100 * np.expm1(WEEK * line.fastest):.2g} % a week (95 %)"
    why = f"{weekly}, and {100 * tolerance:g} % is tolerated"
    if until > span:
        until, why = span, f"{weekly}; the recordings span {span / WEEK:.1f} weeks, and say nothing of later ones"
    return Ageing(
        change=Estimate(change, span * line.std * (1 + change), interval, "1"),
        rate=Estimate(rate, WEEK * line.std * (1 + rate), rates, "1/week"),
        reported=reported,
        recalibrate_by=dates[-1] + datetime.timedelta(int(until)),
        why=why,
        line=line,
    )
