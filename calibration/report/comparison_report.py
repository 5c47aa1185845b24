"""The page of a comparison: does the error fall, where, and what does that make of the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.diagnosis.covariates import LEVEL, press_trends
from calibration.report import page, wording
from calibration.report.misfit import AS_READ, BASE
from calibration.report.report import Picture
from calibration.report.verdict import in_words
from calibration.tasks.compare import Compared, Comparison
from tactilevision.records.misfit import ErrorFall

PATTERN = 0.01  # p of a dependence, below which the page says that something is left; as for plain errors
NAMED = 2  # things that the residual depends on which are named
LAW = {"beta": "slope β"}  # parameters of the law, as a person says them
OF_MATERIAL = (
    "youngs_modulus_MPa",
    "poisson_ratio",
)  # stand in the table of the material, with all they allow for


@dataclass(frozen=True, slots=True)
class Pictures:
    """The pictures: how the error falls, presses, strips, the modulus; all presses, which are folded away."""

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
    """The whole page. `try_next`: what for, and the command; `state`: what was taken back, in a sentence."""
    folded = page.folded(
        f"Every press ({len(found.models[0].fitted.data.presses.label)})", *_figures(pictures.every_press)
    )
    return page.page(
        title,
        _head(found, falls, state),
        page.section("How the error falls", *_figures(pictures.fall)),
        page.section("Measured and modelled force", *_figures(pictures.presses), folded),
        page.section("What is left, and on what it depends", *_figures(pictures.strips)),
        page.section("Parameters", _parameters(found)),
        page.section("What it does to the material", *_figures(pictures.moduli), _material(found)),
        page.section(
            "To try next", *(page.paragraph(f"{words}:") + page.command(text) for words, text in try_next)
        ),
    )


def _figures(pictures: Sequence[Picture]) -> list[str]:
    return [page.figure(one.data_uri, one.caption) for one in pictures]


def _head(found: Comparison, falls: Sequence[ErrorFall], state: str) -> str:
    lines = [page.paragraph(text, kind="lead") for text in (fall_sentence(fall) for fall in falls) if text]
    lines += [page.paragraph(state)] if state else []
    lines += [page.paragraph(f"{in_words(key).capitalize()} is left out: {why}.") for key, why in found.left_out]
    explained = all(fall.reached for fall in falls)
    pattern = pattern_sentence(found, explained=explained)
    lines += [page.paragraph(pattern)] if pattern else []
    return page.block("verdict clean" if explained and not pattern else "verdict", *lines)


def pattern_sentence(found: Comparison, *, explained: bool) -> str:
    """What the last model's residual still depends on, in a sentence; empty where on nothing that shows."""
    last = found.models[-1]
    keys = [one.key for one in last.covariates if one.p_adjusted < PATTERN]
    keys += [key for key, p in press_trends(last.fitted).items() if p < LEVEL]
    on = list(dict.fromkeys(wording.covariate(key) for key in keys))[:NAMED]
    begin = "Something is left all the same: it" if explained else "What is left"
    return f"{begin} depends on {' and '.join(on)}." if on else ""


def fall_sentence(fall: ErrorFall) -> str:
    """Whether the error falls, and whether it falls to how well the presses repeat."""
    scale, unit = 1e3, "mN" if fall.unit == "N" else "µm"
    first, last = scale * fall.error[0], scale * fall.error[-1]
    what = "presses left out" if fall.held_out else "the presses fitted"
    beside = " beside the faces" if fall.faces else ""
    of = "the force" if fall.unit == "N" else f"the depth that the picture reads{beside}"
    added = " and ".join(name.removeprefix("+ ") for name in fall.models[1:])
    if not added:
        whose = (
            "The plain law's error of the force"
            if fall.unit == "N"
            else f"As read, the error of the picture's depth{beside}"
        )
        said = f"{whose} on {what} is {first:.1f} {unit}"
    else:
        way = "takes" if last < first else "does not lower"
        to = f"from {first:.1f} to {last:.1f} {unit}"
        said = f"Adding {added} {way} the error of {of} on {what}{' ' if last < first else ': it goes '}{to}"
    return f"{said}{_beside_repeats(fall, last)}.{_of_faces(fall)}"


def _of_faces(fall: ErrorFall) -> str:
    goes = " → ".join(f"{1e3 * one:.1f}" for one in dict.fromkeys(fall.faces[:1] + fall.faces[-1:]))
    return f" The faces themselves are off by {goes} µm, part of it hidden by their walls." if goes else ""


def _beside_repeats(fall: ErrorFall, last: float) -> str:
    unit = "mN" if fall.unit == "N" else "µm"
    if fall.band is None:
        return ""
    low, high = (1e3 * end for end in fall.band)
    near = "as well as the presses repeat" if last <= high else "more than the presses repeat within"
    return f", {near} ({low:.1f} to {high:.1f} {unit})"


def _parameters(found: Comparison) -> str:
    """A row a parameter, a column a model."""
    models = [*found.models, *found.pictured[1:]]
    meanings = {p.name: p.meaning for model in models for p in model.fitted.parameters}
    names = dict.fromkeys(name for model in models for name, _ in model.parameters if name not in OF_MATERIAL)
    rows = [(parameter(name, meanings[name]), *(_value(model, name) for model in models)) for name in names]
    return page.table(("", *(column(model) for model in models)), rows)


def _value(model: Compared, name: str) -> str:
    known = dict(model.parameters)
    return wording.estimate(known[name]) if name in known else ""


def column(model: Compared) -> str:
    """A model's heading: what it adds, and that it is of the picture's depth where it is."""
    added = f"+ {in_words(model.effects[-1])}" if model.effects else ""
    if model.material is None:
        return f"{added or AS_READ} (the picture's depth)"
    return added or BASE


def parameter(name: str, meaning: str) -> str:
    """A parameter as a person says it: an effect's by what it means, with the effect's name before it."""
    if name.startswith("beta["):
        return f"slope β, a = {name[5:-1]} mm"
    effect = name.rpartition(".")[0]
    return f"{in_words(effect)}: {meaning}" if effect else LAW.get(name, meaning)


def _material(found: Comparison) -> str:
    rows = [
        (
            column(model),
            wording.estimate(model.material.youngs_modulus),
            wording.estimate(model.material.poisson_ratio),
            wording.estimate(model.material.c),
        )
        for model in found.models
        if model.material is not None
    ]
    return page.table(("", "Young's modulus E", "Poisson's ratio ν", "stiffness c"), rows)
