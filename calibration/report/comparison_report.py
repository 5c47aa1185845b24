"""Page of a comparison of models: how the error falls, the residuals, and the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.diagnosis.covariates import LEVEL, press_trends
from calibration.report import page, wording
from calibration.report.misfit import AS_READ, BASE
from calibration.report.page import Picture
from calibration.report.verdict import in_words
from calibration.tasks.compare import Compared, Comparison
from tactilevision.records.constants import KILO
from tactilevision.records.misfit import ErrorFall

PATTERN = 0.01  # p below which the residual's dependence is reported
NAMED = 2  # covariates of the residual that are named
LAW = {"beta": "slope β"}  # parameters of the law in words
OF_MATERIAL = ("youngs_modulus_MPa", "poisson_ratio")  # shown in the table of the material


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures of the error of each model, presses, residuals and the modulus; `every_press` is folded."""

    fall: Sequence[Picture]
    presses: Sequence[Picture]
    strips: Sequence[Picture]
    moduli: Sequence[Picture]
    every_press: Sequence[Picture] = ()


def comparison_page(
    title: str,
    found: Comparison,
    falls: Sequence[ErrorFall],
    *,
    pictures: Pictures,
    try_next: Sequence[tuple[str, str]] = (),
    state: str = "",
) -> str:
    """Return the page. `try_next`: purpose and command; `state`: a sentence on what was undone."""
    folded = page.folded(
        f"Every press ({len(found.models[0].fitted.data.presses.label)})", *page.figures(pictures.every_press)
    )
    return page.page(
        title,
        _head(found, falls, state),
        page.section("How the error falls", *page.figures(pictures.fall)),
        page.section("Measured and modelled force", *page.figures(pictures.presses), folded),
        page.section("Residual, and on what it depends", *page.figures(pictures.strips)),
        page.section("Parameters", _parameters(found)),
        page.section("Effect on the material", *page.figures(pictures.moduli), _material(found)),
        page.section(
            "To try next", *(page.paragraph(f"{words}:") + page.command(text) for words, text in try_next)
        ),
    )


def _head(found: Comparison, falls: Sequence[ErrorFall], state: str) -> str:
    lines = [page.paragraph(text, kind="lead") for text in (fall_sentence(fall) for fall in falls) if text]
    lines += [page.paragraph(state)] if state else []
    lines += [page.paragraph(f"{in_words(key).capitalize()} is excluded: {why}.") for key, why in found.left_out]
    explained = all(fall.reached for fall in falls)
    pattern = pattern_sentence(found, explained=explained)
    lines += [page.paragraph(pattern)] if pattern else []
    return page.block("verdict clean" if explained and not pattern else "verdict", *lines)


def pattern_sentence(found: Comparison, *, explained: bool) -> str:
    """Return a sentence on what the last model's residual depends on; empty where on nothing significant."""
    last = found.models[-1]
    keys = [one.key for one in last.covariates if one.p_adjusted < PATTERN]
    keys += [key for key, p in press_trends(last.fitted).items() if p < LEVEL]
    on = list(dict.fromkeys(wording.covariate(key) for key in keys))[:NAMED]
    begin = "The residual still" if explained else "The residual"
    return f"{begin} depends on {' and '.join(on)}." if on else ""


def fall_sentence(fall: ErrorFall) -> str:
    """Return a sentence on the error of each model, compared with the repeatability."""
    unit = "mN" if fall.unit == "N" else "µm"
    first, last = KILO * fall.error[0], KILO * fall.error[-1]
    what = "held-out presses" if fall.held_out else "fitted presses"
    of = (
        "the force" if fall.unit == "N" else f"the reconstructed depth{' next to the faces' if fall.faces else ''}"
    )
    added = " and ".join(name.removeprefix("+ ") for name in fall.models[1:])
    if added:
        change = "lowers" if last < first else "does not lower"
        said = f"Adding {added} {change} the error of {of} on {what}: from {first:.1f} to {last:.1f} {unit}"
    else:
        said = f"Without effects the error of {of} on {what} is {first:.1f} {unit}"
    return f"{said}{_of_repeats(fall, last)}.{_of_faces(fall)}"


def _of_faces(fall: ErrorFall) -> str:
    errors = " → ".join(f"{KILO * one:.1f}" for one in dict.fromkeys(fall.faces[:1] + fall.faces[-1:]))
    return (
        f" The error of the faces themselves is {errors} µm, part of it hidden by their walls." if errors else ""
    )


def _of_repeats(fall: ErrorFall, last: float) -> str:
    unit = "mN" if fall.unit == "N" else "µm"
    if fall.band is None:
        return ""
    low, high = (KILO * end for end in fall.band)
    return f", {'within' if last <= high else 'above'} the presses' repeatability ({low:.1f} to {high:.1f} {unit})"


def _parameters(found: Comparison) -> str:
    """Return a table with a row a parameter and a column a model."""
    models = [*found.models, *found.pictured[1:]]
    meanings = {p.name: p.meaning for model in models for p in model.fitted.parameters}
    names = dict.fromkeys(name for model in models for name, _ in model.parameters if name not in OF_MATERIAL)
    rows = [(parameter(name, meanings[name]), *(_value(model, name) for model in models)) for name in names]
    return page.table(("", *(column(model) for model in models)), rows)


def _value(model: Compared, name: str) -> str:
    known = dict(model.parameters)
    return wording.estimate(known[name]) if name in known else ""


def column(model: Compared) -> str:
    """Return a model's heading: the effect that it adds, and whether it is of the reconstructed depth."""
    added = f"+ {in_words(model.effects[-1])}" if model.effects else ""
    if model.material is None:
        return f"{added or AS_READ} (the reconstructed depth)"
    return added or BASE


def parameter(name: str, meaning: str) -> str:
    """Return a parameter in words: an effect's by its meaning, after the effect's name."""
    if name.startswith("beta["):
        return f"slope β, a = {name[5:-1]} mm"
    effect = name.rpartition(".")[0]
    return f"{in_words(effect)}: {meaning}" if effect else LAW.get(name, meaning)


def _material(found: Comparison) -> str:
    rows = [
        (column(model), *(wording.estimate(one) for one in (gel.youngs_modulus, gel.poisson_ratio, gel.c)))
        for model in found.models
        if (gel := model.material) is not None
    ]
    return page.table(("", "Young's modulus E", "Poisson's ratio ν", "stiffness c"), rows)
