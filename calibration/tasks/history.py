"""One sensor's modulus over several recordings, and whether it has moved.

Each recording is fitted by itself. Against the first one, errors that all recordings share (machined heights,
radii, thickness, nu, sticking) cancel: the test of a change uses the stiffness c with its own noise alone,
    t = ln(c_k/c_1) / std,
with Student's distribution and Holm's correction over the recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.diagnosis.score_test import LEVEL
from calibration.fit.identifiability import main_radius, stiffness_of
from calibration.fit.least_squares import Fit, fit, quantile95
from calibration.fit.tolerances import DIMENSIONS, HEIGHTS
from calibration.inputs.observations import Measured
from calibration.model.stages import Law
from calibration.tasks.calibrate import calibrate
from tactilevision.records.measured import Estimate, Pair


@dataclass(frozen=True, slots=True)
class HistoryRow:
    """One recording: its date, E, nu and c with intervals, and the change of c since the first recording.

    `change` is relative, c_k/c_1 - 1, with a 95 % interval; `p_adjusted` of no change; `moved` at the 5 % level.
    """

    date: str
    recording: str
    presses: int
    youngs_modulus: Estimate
    poisson_ratio: Estimate
    c: Estimate
    change: float
    change_interval95: Pair
    p_adjusted: float
    moved: bool

    def as_row(self) -> dict[str, Any]:
        """Return a row of history.csv."""
        E, c = self.youngs_modulus, self.c
        low, high = E.interval95 or (None, None)
        c_low, c_high = c.interval95 or (None, None)
        return {
            "date": self.date, "recording": self.recording, "presses": self.presses,
            "youngs_modulus_MPa": E.value, "youngs_modulus_low_MPa": low, "youngs_modulus_high_MPa": high,
            "c_N_per_mm": c.value, "c_low_N_per_mm": c_low, "c_high_N_per_mm": c_high,
            "change": self.change, "change_low": self.change_interval95[0],
            "change_high": self.change_interval95[1], "p_adjusted": self.p_adjusted, "moved": self.moved,
        }  # fmt: skip


def history(recordings: Sequence[Measured], *, law: Law | str = "default") -> tuple[HistoryRow, ...]:
    """Return one row for each recording, in order of date."""
    ordered = sorted(recordings, key=lambda m: str(m.recording.date or ""))
    results = [calibrate(m, law=law) for m in ordered]
    own = [_own_stiffness(result.fitted) for result in results]
    tests = [_change(own[0], other) for other in own]
    adjusted = [1.0, *holm([p for _, _, p in tests[1:]])]
    return tuple(
        HistoryRow(
            date=str(measured.recording.date or ""),
            recording=measured.recording.name,
            presses=len(result.presses_accepted),
            youngs_modulus=result.youngs_modulus,
            poisson_ratio=result.poisson_ratio,
            c=result.c,
            change=change,
            change_interval95=interval,
            p_adjusted=p,
            moved=p < LEVEL,
        )
        for measured, result, (change, interval, _), p in zip(ordered, results, tests, adjusted, strict=True)
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for the family-wise error (Holm, Scand. J. Stat. 6 (1979) 65)."""
    order, left = np.argsort(p_values), np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.maximum.accumulate(np.minimum(left * np.asarray(p_values)[order], 1.0))
    return [float(p) for p in adjusted]


def _own_stiffness(fitted: Fit) -> tuple[Estimate, float]:
    """Return c with its noise alone: shared tolerances and nu fixed as stated."""
    bare = replace(
        fitted.model, effects=tuple(e for e in fitted.model.effects if e.key not in (HEIGHTS, DIMENSIONS))
    )
    again = fit(bare, fitted.data, tolerances=False)
    return stiffness_of(again, main_radius(again)), again.noise.dof


def _change(first: tuple[Estimate, float], other: tuple[Estimate, float]) -> tuple[float, Pair, float]:
    from scipy.stats import t

    (a, dof_a), (b, dof_b) = first, other
    assert a.value is not None
    assert b.value is not None
    parts = np.array([(a.std or 0) / a.value, (b.std or 0) / b.value]) ** 2
    std, shift = float(np.sqrt(parts.sum())), float(np.log(b.value / a.value))
    if first is other or std == 0:
        return 0.0, (0.0, 0.0), 1.0
    dof = float(parts.sum() ** 2 / (parts**2 / [dof_a, dof_b]).sum())  # Welch
    reach = quantile95(dof) * std
    p = float(2 * t.sf(abs(shift) / std, max(dof, 1.0)))
    return float(np.expm1(shift)), (float(np.expm1(shift - reach)), float(np.expm1(shift + reach))), p
