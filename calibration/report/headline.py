"""Headline of a page: how far the error falls, and one table of E and nu."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from calibration.report import page, wording
from calibration.result.result import CalibrationResult
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Estimate, Pair
from tactilevision.records.misfit import ErrorFall

# The fall of the error, in words.


def fall_lead(fall: ErrorFall) -> str:
    """Return the first and the last error, and what the effects between them remove of what can be removed."""
    unit, errors = "mN" if fall.unit == "N" else "µm", (fall.error[0], fall.error[-1])
    numbers = " → ".join(f"{KILO * one:.1f}" for one in errors[: len(fall.models)]) + f" {unit}"
    names = [name.removeprefix("+ ") for name in fall.models[1:]]
    if not names:
        return numbers
    what, s = " and ".join(names), "" if len(names) > 1 else "s"
    if errors[1] >= errors[0]:
        return f"{numbers}: {what} {'does' if s else 'do'} not lower the error"
    if math.isfinite(fall.removed):
        return f"{numbers}: {what} remove{s} {100 * fall.removed:.0f} % of the error that can be removed"
    return f"{numbers}: {what} lower{s} the error"


def fall_note(fall: ErrorFall) -> str:
    """Return which error it is, and how like presses repeat."""
    unit = "mN" if fall.unit == "N" else "µm"
    what = "held-out presses" if fall.held_out else "fitted presses"
    beside = " next to the faces" if fall.faces else ""
    of = "the force" if fall.unit == "N" else f"the reconstructed depth{beside}"
    said = f"Error of {of} on {what}"
    if fall.band is None:
        said += "; no press is repeated, so it is unknown how much of it can be removed"
    else:
        low, high = (KILO * end for end in fall.band)
        said += f"; repeated presses scatter by {KILO * fall.repeatability:.1f} {unit} ({low:.1f} to {high:.1f})"
    if not fall.faces:
        return f"{said}."
    errors = " → ".join(f"{KILO * one:.1f}" for one in dict.fromkeys((fall.faces[0], fall.faces[-1])))
    return f"{said}. The error of the faces themselves is {errors} µm, part of it hidden by their walls."


def fall_sentence(fall: ErrorFall) -> str:
    """Return both in one paragraph."""
    return f"{fall_lead(fall)}. {fall_note(fall)}"


# E and nu of each model.

COLUMNS = ("", "model", "value", "95 % from data", "95 % with unseen")
UNSEEN = (
    "From data: the scatter of these presses alone. With unseen: also friction and an edge that is not stated; "
    "after the diagnosis also effects too small to be significant, and causes that these data do not exclude."
)
DIAGNOSED = "after the diagnosis"


@dataclass(frozen=True, slots=True)
class ModulusRow:
    """E and nu of one model in words: value, interval from the data, and with what may be unseen, each."""

    name: str
    modulus: tuple[str, str, str]
    ratio: tuple[str, str, str]


def modulus_rows(models: Mapping[str, CalibrationResult], over: Estimate | None = None) -> list[ModulusRow]:
    """Return a row a model, by its name, to the digits that the interval from the data allows.

    `over`: E of the last model as a diagnosis states it, which has a row of its own where it is wider.
    """
    rows = [
        ModulusRow(name, _three(one, "youngs_modulus"), _three(one, "poisson_ratio"))
        for name, one in models.items()
    ]
    last = list(models.values())[-1].youngs_modulus if models else None
    if over is not None and last is not None and over.interval95 != last.interval95:
        rows.append(ModulusRow(DIAGNOSED, ("", "", _span(over.interval95, _fine(last))), ("", "", "")))
    return rows


def _three(result: CalibrationResult, quantity: str) -> tuple[str, str, str]:
    one, alone = getattr(result, quantity), result.from_data(quantity)
    fine, value = _fine(one), "not determined" if one.value is None else wording.number(one.value, one.std)
    return value, _span(alone, fine), _span(one.interval95, fine)


def _fine(one: Estimate) -> float | None:
    """Return the std by which digits are chosen."""
    return one.std or (abs(one.interval95[1] - one.interval95[0]) / 4 if one.interval95 else None)


def _span(ends: Pair | None, std: float | None) -> str:
    return "–" if ends is None else " to ".join(wording.number(end, std) for end in ends)


def modulus_lines(models: Mapping[str, CalibrationResult], over: Estimate | None = None) -> list[str]:
    """Return E of each model in one line, with both intervals or why it is not determined."""
    lines = []
    for row in modulus_rows(models, over):
        value, alone, whole = row.modulus
        result = models.get(row.name)
        if result is None:
            lines.append(f"E {row.name}: 95 % with unseen effects and causes not excluded: {whole} MPa")
        elif result.youngs_modulus.value is None:
            lines.append(f"E of the {row.name}: {wording.estimate(result.youngs_modulus)}")
        else:
            lines.append(f"E of the {row.name}: {value} MPa (95 % from the data: {alone}; with unseen: {whole})")
    return lines


def modulus_table(models: Mapping[str, CalibrationResult], over: Estimate | None = None) -> str:
    """Return the table of E and nu, each by model, with what its two intervals mean."""
    found = modulus_rows(models, over)
    rows = [("E (MPa)", row.name, *row.modulus) for row in found]
    rows += [("ν", row.name, *row.ratio) for row in found if any(row.ratio)]
    whys = "".join(map(page.paragraph, undetermined(models.values())))
    return page.table(COLUMNS, rows, numbers=(2,)) + whys + page.paragraph(UNSEEN, kind="soft")


def undetermined(results: Iterable[CalibrationResult]) -> list[str]:
    """Return why E or nu is not determined, a sentence for each reason."""
    whys = {
        f"{wording.MATERIAL[name]} is not determined by these data: {one.why}."
        for result in results
        for name in ("youngs_modulus", "poisson_ratio")
        if (one := getattr(result, name)).value is None
    }
    return sorted(whys)
