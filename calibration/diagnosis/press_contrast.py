"""Presses whose stiffness differs from the others' over a covariate: which they are, where, and by how much.

    g = sum (f r/b^2) / sum (f^2/b^2)

is the relative stiffness of a press, from its residual r, the model's force f and the samples' noise b. The
presses are divided at the value of the covariate with the largest sum of squares between both groups, at least two
in each; both differ by three standard deviations or more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibration.diagnosis.refit import TOLD_APART
from calibration.diagnosis.score_test import Scored
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import covariates
from tactilevision.records.constants import NONZERO
from tactilevision.records.measured import Floats

LEAST = 2  # presses in a group


@dataclass(frozen=True, slots=True)
class PressContrast:
    """Presses on one side of a covariate's value `at`: `relative` their stiffness over the others', less 1."""

    covariate: str
    unit: str
    at: float
    above: bool
    presses: tuple[str, ...]
    relative: float
    std: float

    def as_json(self) -> dict[str, Any]:
        """Return its entry `press_contrast` in diagnosis.json."""
        return asdict(self) | {"presses": list(self.presses)}


def press_gains(fitted: Fit) -> Floats:
    """Return the relative stiffness of each press about the model, less 1, (M,)."""
    press, about = fitted.data.press, fitted.about
    weight = about.force_N / about.base_N**2
    return np.asarray(
        np.bincount(press, weight * fitted.residual_N)
        / np.maximum(np.bincount(press, weight * about.force_N), NONZERO)
    )


def press_contrast(fitted: Fit, scored: Sequence[Scored], *, level: float) -> PressContrast | None:
    """Return the contrast over the most significant press covariate of `scored`; None where none is at `level`."""
    of_press = {c.name: c for c in covariates(fitted.data) if c.of_press}
    names = [one.key for one in scored if one.p_adjusted <= level and one.key in of_press]
    if not names or fitted.data.count < 2 * LEAST:
        return None
    along, gain = of_press[names[0]], press_gains(fitted)
    values = along.values[fitted.data.first]
    order = np.argsort(values, kind="stable")
    ends = np.flatnonzero(np.diff(values[order]) > 0) + 1
    ends = ends[(ends >= LEAST) & (ends <= values.size - LEAST)]
    if not ends.size:
        return None
    below, total = np.cumsum(gain[order])[ends - 1], float(gain.sum())
    between = (below / ends - (total - below) / (values.size - ends)) ** 2 * ends * (values.size - ends)
    end = int(ends[np.argmax(between)])
    low, high = order[:end], order[end:]
    few, others = (high, low) if high.size <= low.size else (low, high)
    within = np.concatenate([gain[few] - gain[few].mean(), gain[others] - gain[others].mean()])
    std = float(np.sqrt(np.sum(within**2) / (gain.size - 2) * (1 / few.size + 1 / others.size)))
    relative = float((1 + gain[few].mean()) / (1 + gain[others].mean()) - 1)
    if abs(relative) < TOLD_APART * std:  # a smooth dependence, or one within the presses
        return None
    at = float(values[low].max() + values[high].min()) / 2
    unit = along.unit.removeprefix("log10").strip()
    return PressContrast(
        along.name.removeprefix("log ") if unit != along.unit else along.name,
        unit,
        float(10**at) if unit != along.unit else at,
        few is high,
        tuple(fitted.data.presses.label[k] for k in sorted(few)),
        relative,
        std,
    )
