"""Robust statistics: medians, standard deviations from them, and weights that bound the influence of outliers.

The standard deviation follows from the median absolute deviation, whose breakdown point is one half,

    s = 1.4826 median |x - m|        consistent for normal numbers

(Huber, Robust Statistics, 1981, 5.1). `median` and `quantile` are for the many small arrays of a frame, where
numpy's own checks would take most of the time; they assume that there is no NaN. The others propagate NaN, as
np.median does.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from tactilevision.records.measured import Array, Floats

MAD_TO_STD = 1.4826  # standard deviation over median absolute deviation of normal numbers; Huber (1981), 5.1
TUKEY_WIDTH = 4.685  # deviations beyond which the biweight is 0: 95 % efficient on normal numbers; Huber, 7.9


def median(values: Any) -> Any:
    """Return the medians (...,) along the last axis of (..., n), in their unit, as np.median gives them.

    Assumes at least one value along that axis, and no NaN. Of arrays or tensors.
    """
    count = values.shape[-1]
    upper = count // 2
    ordered = ascending(values)  # faster than np.partition
    return ordered[..., upper] if count % 2 else 0.5 * (ordered[..., upper - 1] + ordered[..., upper])


def namespace(values: Any) -> Any:
    """Return numpy for an array, torch for a tensor: formulas that name their functions so serve both."""
    return np if isinstance(values, np.ndarray) else sys.modules["torch"]


def ascending(values: Any) -> Any:
    """Return an array or tensor (..., n) sorted along its last axis."""
    ordered = namespace(values).sort(values, -1)
    return getattr(ordered, "values", ordered)


def filled(values: Any, mask: Any, number: float) -> Any:
    """Return an array or tensor with a `number` where the `mask` is set; on a device nothing is copied to it."""
    return values.masked_fill(mask, number) if hasattr(values, "masked_fill") else np.where(mask, number, values)


def take(values: Any, at: Any) -> Any:
    """Return an array's or tensor's values (..., k) at places `at` (..., k) along the last axis of (..., n)."""
    xp = namespace(values)
    return xp.take_along_axis(values, at, -1) if xp is np else xp.take_along_dim(values, at, -1)


def masked_median(values: Any, mask: Any) -> Any:
    """Return the medians (...,) of `values` (..., n), in their unit, where the `mask` (..., n) is set.

    Infinite where it is set nowhere. Of arrays or tensors.
    """
    ordered, count = ascending(filled(values, ~mask, np.inf)), mask.sum(-1)[..., None]
    low, high = (at.clip(0, values.shape[-1] - 1) for at in ((count - 1) // 2, count // 2))
    return 0.5 * (take(ordered, low) + take(ordered, high))[..., 0]


def quantile(values: Floats, share: float) -> float:
    """Return the quantile of `values` (n,), in their unit, below which a `share` of them lies, as np.quantile.

    Assumes at least one value, and no NaN.
    """
    ordered, at = np.sort(values), share * (values.size - 1)
    low = int(at)
    return float(ordered[low] + (at - low) * (ordered[min(low + 1, values.size - 1)] - ordered[low]))


def mad_std(values: Array, *, centre: float | None = None) -> float:
    """Return the standard deviation of all `values` (..., n), in their unit, about their median or a known
    `centre`.
    """
    off = values if centre == 0.0 else values - (np.median(values) if centre is None else centre)
    return MAD_TO_STD * float(np.median(np.abs(off)))


def second_difference_std(readings: Array) -> float:
    """Estimate the noise of one of equally spaced `readings` (n,), in their unit, from their second differences.

        s = 1.4826 median |x_(i-1) - 2 x_i + x_(i+1)| / sqrt(6)

    A ramp and its few corners have no effect. Assumes noise that is independent from reading to reading.
    """
    return MAD_TO_STD * float(np.median(np.abs(np.diff(readings, 2)))) / float(np.sqrt(6))


def tukey_weight(residual: Floats, std: float) -> Floats:
    """Return Tukey's biweight (n,) of residuals (n,) in the unit of `std`; 0 from TUKEY_WIDTH deviations on."""
    relative = residual / (TUKEY_WIDTH * std)
    return np.where(np.abs(relative) < 1, (1 - relative**2) ** 2, 0.0)
