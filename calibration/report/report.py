"""Pages of a calibration and of a comparison of models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calibration.diagnosis.covariates import press_trends
from calibration.fit.identifiability import main_radius
from calibration.fit.repeats import LEVEL
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.conditions import true_repeats
from calibration.inputs.deadline import Progress
from calibration.noise.reml import BEYOND_CHANCE
from calibration.report import figures, page, wording
from calibration.report.figures import FigureFolder
from calibration.report.headline import fall_lead, fall_note, modulus_table
from calibration.report.misfit import AS_READ, BASE, error_falls, force_curves, model_names, residual_strips
from calibration.report.wording import in_words
from calibration.result.result import CalibrationResult
from calibration.tasks.compare import Compared, Comparison
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import KILO
from tactilevision.records.misfit import ErrorFall, ForceCurves

# The page of a calibration: the material, its assumptions, excluded presses, and their pictures.

DEPTHS = (
    "As machined: distance of the bevel from the punch's face. Certified: that, less the rise of the gel at the "
    "bevel."
)
SOURCES = {
    "bulge": "the rise of the gel next to the punch",
    "beta": "beta by the published log law",
    "radii": "punches of several radii",
    "prior": "prior knowledge, not these data",
}
EVERY_PRESS = "The option --pictures all draws every press."
ALSO = {"reduced_modulus": "reduced modulus"}
MEANINGS = {
    "c": "force over depth P/w at first touch",
    "beta": "growth of P/w with w/h: c (1 + β w/h)",
    "reduced_modulus": "E/(1 − ν²)",
}
PRESS_COLUMNS = (
    "press",
    "indenter",
    "verdict",
    "certified depth (mm)",
    "as machined (mm)",
    "force (N)",
    "tangential (N)",
)


def summary(result: CalibrationResult) -> list[str]:
    """Return the lines for the terminal."""
    law = {"paper": "the published route (a reproduction: log law for nu, a/h taken as 0.8)"}.get(
        result.law, result.law.replace("_", " ")
    )
    lines = [
        f"Young's modulus  E  = {wording.estimate(result.youngs_modulus)}",
        f"Poisson's ratio  nu = {wording.estimate(result.poisson_ratio)}, from {source_in_words(result)}",
        f"stiffness        c  = {wording.estimate(result.c)}",
        f"slope         beta  = {wording.estimate(result.beta)}",
        (f"R^2 = {result.r_squared:.4f}, " if math.isfinite(result.r_squared) else "")
        + f"{wording.fit_error(result.held_out_N, result.rms_error_N)}, "
        f"{wording.repeatability(true_repeats(result.fitted.data))}, law: {law}",
    ]
    if result.clock_offset.value is not None:
        lines.append(f"F/T clock minus camera clock = {wording.estimate(result.clock_offset)}")
    total = len(result.presses_accepted) + len(result.presses_rejected)
    lines.append(f"{len(result.presses_accepted)} of {total} presses accepted")
    lines += [f"  rejected {press}: {str(reason).replace('_', ' ')}" for press, reason in result.presses_rejected]
    return lines


def source_in_words(result: CalibrationResult) -> str:
    """Return the source of nu in words."""
    return SOURCES.get(result.poisson_ratio_source, result.poisson_ratio_source)


def calibration_page(
    title: str,
    result: CalibrationResult | None,
    *,
    points: Sequence[CertifiedPoint],
    fit: Sequence[str] = (),
    presses: Sequence[str] = (),
    notes: Sequence[str] = (),
    why: str = "all of them were rejected",
) -> str:
    """Return the page of one recording; `result` is None where its presses determine no material, with `why`.

    `fit` and `presses`: figures (HTML); `notes`: warnings without a result.
    """
    if result is None:
        head = page.paragraph("The presses of this recording determine no material: " + why, kind="lead bad")
        details = page.section("Notes", page.listing(notes))
    else:
        head, details = _head(result), _details(result)
    return page.page(
        title,
        head,
        page.section("Force against depth", *fit),
        details,
        page.section("Presses", _press_table(points), page.paragraph(DEPTHS, kind="soft")) if points else "",
        _pictures(presses, of=len(points)),
    )


def _pictures(presses: Sequence[str], *, of: int) -> str:
    """Return the pictures of presses, folded, and how to have those of all."""
    every = "" if len(presses) == of else page.paragraph(EVERY_PRESS, kind="soft")
    title = f"Pictures of {len(presses)} of {of} presses: frame, height map, signal of the bevel, force"
    return page.folded(title, *presses, every) if of else ""


def _head(result: CalibrationResult) -> str:
    """Return the result in one sentence and as a table."""
    names = [name for name in (*wording.MATERIAL, *ALSO) if name not in E_AND_NU]
    found = {name: wording.estimate(getattr(result, name)) for name in names}
    kept = len(result.presses_accepted)
    said = f"From {kept} of {kept + len(result.presses_rejected)} presses; ν from {source_in_words(result)}."
    model = " + ".join((BASE, *map(in_words, (k for k in result.fitted.model.keys if k not in TOLERANCES))))
    titles = wording.MATERIAL | ALSO
    rows = [(titles[name], value, MEANINGS.get(name, "")) for name, value in found.items()]
    rows.append(("clock of the force sensor", wording.estimate(result.clock_offset), "less that of the camera"))
    more = page.table(("", "value and 95 % interval", ""), [*rows, *_error_rows(result)])
    table = modulus_table({model: result})
    return (
        table + page.paragraph(said) + _sufficient(result) + page.folded("More of the material and the fit", more)
    )


def _sufficient(result: CalibrationResult) -> str:
    """Return a sentence on the test of the model."""
    test = result.model_test
    if test is None:
        return ""
    p = wording.p_value(test.p)
    if test.insufficient:
        return page.paragraph(f"The model does not explain these data (p = {p}): see the warnings.", kind="bad")
    return page.paragraph(
        f"No effect or dependence is significant in the residual (p = {p} for all tests together)."
    )


def _error_rows(result: CalibrationResult) -> list[tuple[str, str, str]]:
    """Return the error on held-out presses, and how repeated presses scatter."""
    name, error = "error on held-out presses (rms)", result.held_out_N
    if not math.isfinite(error):
        name, error = "error on fitted presses (rms)", result.rms_error_N
    line = f"R² of the line {result.r_squared:.4f}" if math.isfinite(result.r_squared) else ""
    rows = [(name, f"{KILO * error:.1f} mN", line)]
    return [*rows, ("", wording.repeatability(true_repeats(result.fitted.data)), "of one punch, place and speed")]


def _details(result: CalibrationResult) -> str:
    routes = [
        (SOURCES.get(r.name, r.name), wording.estimate(r.poisson_ratio), "used" if r.used else "not used")
        for r in result.routes
    ]
    versions = ", ".join(f"{name} {number}" for name, number in result.as_json()["versions"].items())
    computed = f"{versions}; punch radius {main_radius(result.fitted):g} mm"
    return (
        page.section("Poisson's ratio by route", page.table(("route to ν", "value and 95 % interval", ""), routes))
        + page.section("Warnings", page.listing(result.warnings))
        + page.section("Assumptions", page.listing(result.assumptions))
        + page.section("Computed with", page.paragraph(computed, kind="soft"))
    )


def _press_table(points: Sequence[CertifiedPoint]) -> str:
    rows = [
        (
            point.press,
            point.indenter,
            "accepted" if point.accepted else _why(point),
            _with_std(point.depth_mm, point.depth_std_mm),
            wording.number(point.depth_uncorrected_mm, point.depth_std_mm),
            _with_std(point.fz_N, point.fz_std_N),
            wording.number(float(np.hypot(point.fx_N, point.fy_N)), point.fz_std_N),
        )
        for point in points
    ]
    return page.table(PRESS_COLUMNS, rows, numbers=(3, 4, 5, 6))


def _why(point: CertifiedPoint) -> str:
    """Return why a press was rejected: a sentence where there is one, else its code."""
    words = point.reason.replace("_", " ")
    said = point.details.findings.partition("; ")[0].removeprefix(f"{point.reason}: ")
    return f"rejected ({words}): {said}" if said else f"rejected: {words}"


def _with_std(value: float, std: float) -> str:
    text = wording.number(value, std)
    return f"{text} ± {wording.number(std, std)}" if np.isfinite(value) and np.isfinite(std) else text


# The page of a comparison of models: how the error falls, the residuals, and the material.

E_AND_NU = ("youngs_modulus", "poisson_ratio")  # of a result
NAMED = 2  # covariates of the residual that are named
LAW = {"beta": "slope β"}  # parameters of the law in words
OF_MATERIAL = ("youngs_modulus_MPa", "poisson_ratio")  # shown in the table of the material


def comparison_page(
    found: Comparison,
    folder: FigureFolder,
    *,
    try_next: Sequence[tuple[str, str]],
    state: str,
    verdict: Sequence[str] = (),
    progress: Progress,
) -> str:
    """Draw the figures and return the page.

    `try_next`: purpose and command; `state`: a sentence on the steps taken back; `verdict`: of a diagnosis of the
    last model, with its caveats.
    """
    models = dict(zip(model_names([model.effects for model in found.models]), found.models, strict=True))
    fits = {name: model.fitted for name, model in models.items()}
    materials = {name: one.material for name, one in models.items() if one.material is not None}
    falls, curves, data = error_falls(found), force_curves(fits), found.models[0].fitted.data
    strips = residual_strips(fits, [one.covariates for one in found.models])
    folded = all_presses(curves, folder, progress)
    forces = figures.keep_presses(curves, data.gel.thickness_mm, folder)
    return page.page(
        f"Comparison of {', '.join(found.stated.recordings)}",
        page.block("verdict", *map(page.paragraph, verdict)) if verdict else "",
        _comparison_head(found, falls, state),
        modulus_table(materials, found.over),
        page.section("How the error falls", *figures.keep_falls(falls, folder)),
        page.section("Measured and modelled force", *forces, folded),
        page.section("Residual, and on what it depends", *figures.keep_strips(strips, folder)),
        page.section("Parameters", _parameters(found)),
        page.section(
            "Effect on the material",
            *figures.keep_moduli(materials, found.over, folder),
            _stiffness_rows(materials),
        ),
        page.section(
            "To try next", *(page.paragraph(f"{words}:") + page.command(text) for words, text in try_next)
        ),
    )


def all_presses(curves: ForceCurves, folder: FigureFolder, progress: Progress) -> str:
    """Return the figures of all presses, folded, or how to have them."""
    drawn = figures.keep_every_press(curves, folder, progress)
    return page.folded("Every press", *drawn) or page.paragraph(EVERY_PRESS if curves.whole else "", kind="soft")


def _comparison_head(found: Comparison, falls: Sequence[ErrorFall], state: str) -> str:
    lines = [
        page.paragraph(f"{fall_lead(fall)}.", kind="lead") + page.paragraph(fall_note(fall)) for fall in falls
    ]
    lines += [page.paragraph(state)] if state else []
    lines += [page.paragraph(f"{in_words(key).capitalize()} is excluded: {why}.") for key, why in found.left_out]
    explained = all(fall.reached for fall in falls)
    pattern = pattern_sentence(found, explained=explained)
    lines += [page.paragraph(pattern)] if pattern else []
    return page.block("verdict", *lines)


def pattern_sentence(found: Comparison, *, explained: bool) -> str:
    """Return a sentence on what the last model's residual depends on; empty where on nothing significant."""
    last = found.models[-1]
    keys = [one.key for one in last.covariates if one.p_adjusted < BEYOND_CHANCE]
    keys += [key for key, p in press_trends(last.fitted).items() if p < LEVEL]
    on = list(dict.fromkeys(wording.covariate(key) for key in keys))[:NAMED]
    begin = "The residual still" if explained else "The residual"
    return f"{begin} depends on {' and '.join(on)}." if on else ""


def _parameters(found: Comparison) -> str:
    """Return a table with a row a parameter and a column a model."""
    models = [*found.models, *found.pictured[1:]]
    meanings = {p.name: p.meaning for model in models for p in model.fitted.parameters}
    names = dict.fromkeys(name for model in models for name, _ in model.parameters if name not in OF_MATERIAL)
    known = [{name: wording.estimate(value) for name, value in model.parameters} for model in models]
    rows = [(parameter(name, meanings[name]), *(one.get(name, "") for one in known)) for name in names]
    return page.table(("", *(column(model) for model in models)), rows)


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


def _stiffness_rows(materials: Mapping[str, CalibrationResult]) -> str:
    rows = [(name, wording.estimate(one.c), wording.estimate(one.beta)) for name, one in materials.items()]
    return page.table(("", "stiffness c", "slope β"), rows)
