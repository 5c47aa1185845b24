"""What repeats say: the pure error, and whether indenters differ by more than their presses do.

Presses of one indenter share its machined height. Where no std of that height is stated, the indenters' means may
still scatter about the law by more than repeats allow; then the mean squares of that scatter, and its few degrees
of freedom, belong into every interval, and not the repeats' own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.fit.tolerances import HEIGHTS
from calibration.inputs.observations import Ints
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class PureError:
    """Sum of squares within groups of equal conditions, of the whitened residual, and its degrees of freedom."""

    squares: float
    dof: int


def pure_error(fitted: Fit, groups: Ints) -> PureError:
    """Of the whitened residual within `groups` (N,)."""
    count = np.bincount(groups)
    mean = np.bincount(groups, fitted.white) / np.maximum(count, 1)
    return PureError(float(np.sum((fitted.white - mean[groups]) ** 2)), int(np.sum(np.maximum(count - 1, 0))))


def allow_for_indenters(fitted: Fit) -> Fit:
    """The fit with its covariance widened where points of one indenter agree better than the indenters do.

    A test at 5 %: F of the indenters' scatter about the law over the repeats' own.
    """
    from scipy.special import fdtrc

    data = fitted.data
    if data.is_curves or HEIGHTS in fitted.model.keys:
        return fitted
    groups = data.presses.indenter[data.press]
    inside = pure_error(fitted, groups)
    used = int(np.count_nonzero(fitted.free)) - sum(p.prior is not None for p in fitted.parameters if not p.fixed)
    between = np.unique(groups).size - used
    if inside.dof < 3 or between < 1:
        return fitted
    own, other = inside.squares / inside.dof, max(fitted.chi2 - inside.squares, 0.0) / between
    if own <= 0 or fdtrc(between, inside.dof, other / own) > 0.05:
        return fitted
    ratio = max(other, 1.0)
    warning = (
        f"the indenters scatter about the law {np.sqrt(other / own):.1f} times as much as their repeats do: "
        "heights off by more than stated, or an effect that the law lacks; the intervals are widened by it"
    )
    return replace(
        fitted,
        covariance=_widened(fitted, ratio),
        noise=replace(fitted.noise, dof=float(between)),
        warnings=(*fitted.warnings, warning),
    )


def _widened(fitted: Fit, ratio: float) -> Floats:
    """The covariance (p, p) with the data's part of it `ratio` times as large; what priors state stays."""
    kept = [p for p in fitted.parameters if not p.fixed]
    place = np.ix_(fitted.free, fitted.free)
    size = np.sqrt(np.diag(fitted.covariance[place]))  # parameters of very different sizes
    known = np.diag([0.0 if p.prior is None else (k / p.prior.std) ** 2 for p, k in zip(kept, size, strict=True)])
    of_data = np.linalg.pinv(fitted.covariance[place] / np.outer(size, size)) - known
    wider = fitted.covariance.copy()
    wider[place] = np.linalg.pinv(of_data / ratio + known) * np.outer(size, size)
    return wider


def repeatability_rms(fitted: Fit) -> float:
    """How far the forces of like presses scatter after what the model says of their differences, std in N.

    Of points with repeats the pure error, sqrt(sum of squares within indenters / (points - indenters)); else the
    noise model's std. An rms error over all points divides by their number instead, so a fit to few can lie
    below this: compare it with the held-out error. Source: Draper and Smith, Applied Regression Analysis, ch. 2.
    """
    data = fitted.data
    if not data.is_curves:
        inside = pure_error(replace(fitted, white=fitted.residual_N), data.presses.indenter[data.press])
        if inside.dof >= 3:
            return float(np.sqrt(inside.squares / inside.dof))
    noise, about = fitted.noise, fitted.about
    parts = (noise.scale * about.base_N) ** 2 + (noise.gain * about.force_N) ** 2
    return float(np.sqrt(np.mean(parts + (noise.zero_mm * about.slope_N_per_mm) ** 2)))
