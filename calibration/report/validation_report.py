"""What a validation says: in sentences, as a table for the terminal, and as validation.json."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite, isinf
from typing import Any

import numpy as np

from calibration.fit.depth_trend import LEVEL
from calibration.result.result import versions
from calibration.tasks.validate import Comparison, Rival, Validation
from tactilevision.records import Floats

NOT_PROVEN = "Agreement at equal force, or at equal depth, does not prove Poisson's ratio"


def as_json(found: Validation) -> dict[str, Any]:
    """The content of validation.json; a value that the elements did not reach is null, with its `why`."""
    return {
        **found.material.as_json(),
        "models": [_model(found, one) for one in found.comparisons],
        "rivals": [_rival(rival) for rival in found.rivals],
        "statements": list(statements(found)),
        "assumptions": list(found.assumptions),
        "versions": versions(),
    }


def statements(found: Validation) -> Iterator[str]:
    """What the errors say and what they do not, one sentence each."""
    for one in found.comparisons:
        yield f"{one.law}, {one.name}: {_errors(one.depth_error)} in depth at equal force; {_trend(one)}"
    lost = {
        law: sum(bool(why) for one in found.comparisons if one.law == law for why in one.ended)
        for law in dict.fromkeys(one.law for one in found.comparisons)
    }
    if any(lost.values()):
        where = ", ".join(f"{count} of {law}" for law, count in lost.items() if count)
        yield f"beyond what the elements reach, and left empty: {where}; validation.json says why of each"
    yield _not_proven(found)


def table(found: Validation, law: str) -> list[str]:
    """Depth errors in per cent, one line a sample, one column a friction; '-' where the elements did not get."""
    mine = [one for one in found.comparisons if one.law == law]
    lines = [f"{law}: FE depth at the measured force, error in % of the measured depth"]
    lines.append(f"{'press':>12s} {'w (mm)':>8s} {'P (N)':>8s} " + " ".join(f"{one.name:>12s}" for one in mine))
    samples = found.samples
    for k, press in enumerate(samples.press):
        values = (
            f"{round(100 * one.depth_error[k], 1) + 0.0:+12.1f}" if isfinite(one.depth_error[k]) else f"{'-':>12s}"
            for one in mine
        )
        lines.append(f"{press:>12s} {samples.depth_mm[k]:8.3f} {samples.force_N[k]:8.4f} " + " ".join(values))
    return lines


def _errors(error: Floats) -> str:
    kept = error[np.isfinite(error)]
    if not kept.size:
        return "nothing that can be compared"
    low, high = (f"{100 * end:+.1f}".replace("-0.0", "+0.0") for end in (kept.min(), kept.max()))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _trend(one: Comparison) -> str:
    trend = one.depth_trend
    if trend.p_value is None or trend.over_range is None:
        return f"whether it trends with depth cannot be told ({trend.why})"
    chance = f"p = {trend.p_value:.2g}"
    if not trend.found:
        return f"no trend with depth that shows at {100 * LEVEL:.0f} % ({chance})"
    way = "grows" if trend.over_range > 0 else "falls"
    return (
        f"it {way} with depth, by {100 * abs(trend.over_range):.1f} points over the range ({chance}): "
        "the form of the model is at fault, not scatter"
    )


def _not_proven(found: Validation) -> str:
    if len(found.rivals) < 2:
        return NOT_PROVEN + "."
    low, high = found.rivals[0], found.rivals[-1]
    errors = [rival.rms_depth_error for rival in found.rivals]
    return (
        f"{NOT_PROVEN}: with E at the same initial stiffness every nu from {low.poisson_ratio:g} to "
        f"{high.poisson_ratio:g} comes within {100 * min(errors):.1f} to {100 * max(errors):.1f} % rms of the "
        f"{low.compared} depths that the table reaches (neo-Hooke, mu = 0.3)."
    )


def _model(found: Validation, one: Comparison) -> dict[str, Any]:
    samples = found.samples
    rows = []
    for k, press in enumerate(samples.press):
        row = {
            "press": press,
            "radius_mm": float(samples.radius_mm[k]),
            "depth_mm": float(samples.depth_mm[k]),
            "force_N": float(samples.force_N[k]),
            "fem_depth_mm": _number(one.fem_depth_mm[k]),
            "depth_error": _number(one.depth_error[k]),
            "fem_force_N": _number(one.fem_force_N[k]),
            "force_error": _number(one.force_error[k]),
        }
        rows.append(row | ({"why": one.ended[k]} if one.ended[k] else {}))
    return {
        "law": one.law,
        "friction": "no slip" if isinf(one.friction) else one.friction,
        "source": one.source,
        "points": rows,
        "rms_depth_error": _rms(one.depth_error),
        "rms_force_error": _rms(one.force_error),
        "depth_trend": one.depth_trend.as_json(),
        "force_trend": one.force_trend.as_json(),
    }


def _rival(rival: Rival) -> dict[str, float | int | None]:
    return {
        "poisson_ratio": rival.poisson_ratio,
        "youngs_modulus_MPa": rival.youngs_modulus_MPa,
        "rms_depth_error": _number(rival.rms_depth_error),
        "compared": rival.compared,
    }


def _rms(error: Floats) -> float | None:
    kept = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else None


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
