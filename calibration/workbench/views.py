"""Plain data of the workbench's page: the state, curves and residuals.

Every number and sentence comes from the functions of the reports.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np

from calibration.diagnosis.vision_depth_check import corrected_depth, recorded_of_depth
from calibration.fit.least_squares import Fit
from calibration.fit.repeats import LEVEL
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.observations import press_names
from calibration.model.stages import Effect
from calibration.report import wording
from calibration.report.diagnosis_report import VERDICTS
from calibration.report.headline import UNSEEN, fall_lead, fall_note, modulus_rows, undetermined
from calibration.report.misfit import (
    BASE,
    error_falls,
    force_curves,
    model_names,
    residual_strips,
)
from calibration.report.report import OF_MATERIAL, parameter
from calibration.report.wording import in_words
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import HistoryRow
from calibration.tasks.compare import Compared, Comparison, rms_of_presses
from calibration.workbench.analysis import OF_FORCE, Evidence, Verdict
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.opened import Opened
from tactilevision.errors import InputError
from tactilevision.plots.misfit import CERTAIN, evidence, model_colours, radius_colours
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.measured import Floats
from tactilevision.records.misfit import ErrorFall, ForceCurves, ResidualStrips, Strip

EVERY = 99  # residual strips at most: all covariates
DIGITS = 5  # significant digits of numbers for a screen


def state_view(bench: Bench) -> dict[str, Any]:
    """Return everything but the curves, which are fetched when `model` changes."""
    shown, opened = bench.shown, bench.opened
    kept, found = shown.history, None if shown.now is None else shown.now.found
    return {
        "version": shown.version,
        "title": opened.title,
        "busy": shown.busy,
        "busy_s": round(time.monotonic() - shown.since_s, 1) if shown.busy else 0.0,
        "stoppable": bench.stoppable,
        "notice": shown.notice,
        "saved": shown.saved,
        "warnings": [*opened.warnings, *[shown.changed] * bool(shown.changed)],
        "model": _model_number(shown),
        "modulus": [] if found is None else _modulus(found, shown),
        "unseen": UNSEEN,
        "looked": shown.now is not None and shown.now.rng is not None,
        "undo": bool(shown.track.past),
        "redo": bool(shown.track.future),
        "verdict": _verdict(shown),
        "falls": [] if found is None else [_fall(fall) for fall in error_falls(found)],
        "components": [] if found is None else _components(found, opened),
        "stiffness": [] if found is None else _stiffness(found),
        "cards": [_card(one, shown, opened) for one in shown.evidence or shown.earlier],
        "earlier": not shown.evidence and bool(shown.earlier),
        "presses": list(_presses(opened, shown)),
        "labels": [
            {"name": one.name, "effects": [in_words(s.key) for s in one.steps], "left_out": list(one.left_out)}
            for one in kept.labels
        ],
        "weeks": [_week(row) for row in shown.weeks],
        "sides": _sides(shown) if shown.sides else None,
    }


def _model_number(shown: Shown) -> str:
    """Return a text that changes with the curves."""
    if shown.now is None:
        return ""
    keys = "+".join(step.key for step in shown.history.steps)
    names = "|".join(f"{name}-{one.rng is not None}" for name, one in shown.sides)
    return f"{keys}-{','.join(shown.history.left_out)}-{names}-{shown.now.rng is not None}"


def _verdict(shown: Shown) -> dict[str, Any]:
    there = [step.key for step in shown.history.steps]
    found, asking = shown.verdict or Verdict(named=shown.named), shown.asking
    ambiguous = found.word == "AMBIGUOUS"
    to_try = found.candidates if ambiguous else found.nearest.split("+") if found.nearest else ()

    def not_yet(keys: Sequence[str]) -> list[dict[str, str]]:
        return [{"key": key, "title": in_words(key)} for key in keys if key not in there]

    return {
        "word": found.word,
        "meanings": VERDICTS,
        "sentence": found.sentence,
        "remarks": list(found.remarks),
        "warnings": list(found.warnings),
        "with": [in_words(key) for key in there],
        "asking": "" if asking is None else asking.what,
        "tried": [] if asking is None or not asking.of else [asking.tried, asking.of, asking.passes],
        "left_s": None if asking is None else asking.left_s,
        "troubled": shown.troubled,
        "named": [] if ambiguous else not_yet(found.named),
        "nearest": not_yet(to_try),
        "next": [
            {
                "action": action,
                "minutes": f"{minutes:.0f}",
                "gain": f"{sigma:.1f}" if sigma > 0 else "",
                "why": why,
            }
            for action, minutes, sigma, why in found.measure_next
        ],
    }


def _fall(fall: ErrorFall) -> dict[str, Any]:
    return {
        "of": "force" if fall.unit == "N" else "reconstructed depth",
        "unit": "mN" if fall.unit == "N" else "µm",
        "models": list(fall.models),
        "colours": list(model_colours(len(fall.models))),
        "error": [KILO * one for one in fall.error],
        "repeatability": None if fall.band is None else KILO * fall.repeatability,
        "band": None if fall.band is None else [KILO * end for end in fall.band],
        "lead": fall_lead(fall),
        "note": fall_note(fall),
    }


def _components(found: Comparison, opened: Opened) -> list[dict[str, Any]]:
    """Return the law, then each effect in the order added, with fitted parameters."""
    last = found.models[-1]
    law = {"key": "", "title": "contact law: flat punch", "parameters": _parameters(last, ""), "own": False}
    added = [
        {
            "key": key,
            "title": in_words(key),
            "about": _about(opened.effect(key)),
            "parameters": _parameters(model, key),
            "own": opened.kind(key) == "your own",
        }
        for model in (last, *found.pictured[-1:])
        for key in model.effects
    ]
    return [law, *added]


def _about(effect: Effect) -> str:
    return effect.title or str(getattr(effect, "words", ""))


def _parameters(model: Compared, key: str) -> list[dict[str, Any]]:
    """Return those of one effect, or for no key those of the law and the stated tolerances."""
    fitted, rows = model.fitted, []
    for p, value in zip(fitted.parameters, fitted.values.tolist(), strict=True):
        of, _, name = p.name.rpartition(".")
        if (of if of in model.effects else "") != key or p.name in OF_MATERIAL:
            continue
        estimate = fitted.estimate(p.name)
        low, high = estimate.interval95 or (value, value)
        reach = max(3 * (high - low) / 2, abs(value), TINY)  # of the slider: three intervals, or twice the value
        rows.append(
            {
                "name": p.name,
                "words": (p.meaning or name) if key else parameter(p.name, p.meaning),
                "text": "held" if p.fixed else wording.estimate(estimate),
                "value": value,
                "fixed": p.fixed,
                "low": max(p.bounds[0], value - reach),
                "high": min(p.bounds[1], value + reach),
                "unit": p.unit,
                "aside": p.name.partition(".")[0] in TOLERANCES,
            }
        )
    return rows


def _modulus(found: Comparison, shown: Shown) -> list[dict[str, Any]]:
    """Return E and nu of each model in words; of the last one with what the diagnosis allows for."""
    names, rows = model_names([model.effects for model in found.models]), []
    verdict = shown.verdict or Verdict()
    for name, model in zip(names, found.models, strict=True):
        material, last = model.material, model is found.models[-1]
        if material is not None and last and verdict.modulus is not None:
            material = replace(material, youngs_modulus=verdict.modulus)
        row = None if material is None else modulus_rows({name: material})[0]
        lacks = [in_words(key) for key in verdict.named] if last and verdict.word != "AMBIGUOUS" else []
        rows.append(
            {
                "name": name,
                "modulus": [] if row is None else row.modulus,
                "ratio": [] if row is None else row.ratio,
                "open": [] if material is None else undetermined([material]),
                "lacks": f"lacks {' and '.join(lacks)}" if lacks else "",
            }
        )
    return rows


def _stiffness(found: Comparison) -> list[dict[str, str]]:
    """Return a row a quantity: by the base model, and now."""
    first, last = (found.models[k].material for k in (0, -1))
    names = [(name, title) for name, title in wording.MATERIAL.items() if name in ("c", "beta")]
    return [{"name": title, "before": _of_gel(first, n), "now": _of_gel(last, n)} for n, title in names]


def _of_gel(material: CalibrationResult | None, name: str) -> str:
    return "not determined yet" if material is None else wording.estimate(getattr(material, name))


def _card(one: Evidence, shown: Shown, opened: Opened) -> dict[str, Any]:
    effect, verdict, key = one.effect, shown.verdict, one.effect.key
    named = verdict is not None and key in verdict.named
    candidate = verdict is not None and key in verdict.candidates and not named
    unconfirmed = one.significant and verdict is not None and not (named or candidate)
    added = (
        []
        if one.added is None
        else (one.added.models if one.of == OF_FORCE else one.added.pictured)[-1].parameters
    )
    meanings = {f"{key}.{p.name}": p.meaning or p.name for p in effect.parameters}
    return {
        "key": key,
        "title": in_words(key),
        "about": _about(effect) or _about(opened.effect(key)),
        "kind": opened.kind(key),
        "of": one.of,
        "evidence": _evidence(one.p_adjusted) + ", but the diagnosis does not name it" * unconfirmed,
        "fall": None
        if one.fall is None
        else _fall(one.fall) | {"share": one.share if isfinite(one.share) else 0.0},
        "significant": one.significant,
        "named": named,
        "candidate": candidate,
        "suggested": key in shown.suggested,
        "why": one.why,
        "values": [f"{meanings[name]} {wording.estimate(value)}" for name, value in added if name in meanings],
        "overlay": None if one.shown is None else _overlay(one.shown),
        "seen_in": [wording.covariate(name) for name in effect.seen_in],
        "confused_with": [in_words(other) for other in effect.confused_with],
        "separated_by": list(effect.separated_by),
        "source": effect.source,
    }


def _evidence(p: float) -> str:
    """Return the significance of an effect in words."""
    if not np.isfinite(p):
        return "not tested"
    if p < CERTAIN:
        return "significant beyond doubt"
    return f"{'' if p < LEVEL else 'not '}significant (p = {p:.2g})"


def _overlay(shown: Strip) -> dict[str, Any]:
    before, after, predicted = KILO * shown.mean_N
    axis = {"words": shown.words, "unit": "" if shown.levels else shown.unit, "levels": list(shown.levels)}
    return axis | {"values": shown.centre, "before": before, "after": after, "predicted": predicted}


def _presses(opened: Opened, shown: Shown) -> Iterator[dict[str, Any]]:
    """Yield every press in the order of pressing, also excluded and rejected ones, with the reason."""
    data, names, rms = opened.data, press_names(opened.data), _rms(shown)
    odd = () if shown.verdict is None else shown.verdict.odd
    for k in np.argsort(data.presses.order, kind="stable"):
        out = names[k] in shown.history.left_out
        indenter = data.indenters[int(data.presses.indenter[k])]
        yield {
            "name": names[k],
            "label": data.presses.label[k],
            "recording": int(data.presses.recording[k]),
            "indenter": f"{indenter.name}, a = {indenter.radius_mm:g} mm",
            "state": "excluded" if out else "fitted",
            "odd": data.presses.label[k] in odd,
            "rms": [] if out else rms.get(names[k], []),
        }
    for number, measured in enumerate(opened.measured):
        for point in (one for one in measured.points if not one.accepted):
            why = point.details.findings or (point.reason or "rejected").replace("_", " ")
            of = {"name": point.press, "label": point.press, "recording": number, "indenter": point.indenter}
            yield {**of, "state": f"rejected: {why}", "odd": False, "rms": []}


def _rms(shown: Shown) -> dict[str, list[float]]:
    """Return the rms error of each press by the base model and now, mN."""
    if shown.now is None:
        return {}
    first, last = (shown.now.found.models[k].fitted for k in (0, -1))
    both = KILO * np.column_stack([rms_of_presses(first), rms_of_presses(last)])
    return dict(zip(press_names(last.data), both.tolist(), strict=True))


def _week(row: HistoryRow) -> dict[str, Any]:
    """Return the material of one recording alone."""
    low, high = (100 * end for end in row.change_interval95)
    return {
        "date": row.date or row.recording,
        "recording": row.recording,
        "modulus": row.youngs_modulus.as_json(),
        "ratio": row.poisson_ratio.as_json(),
        "words": [wording.estimate(row.youngs_modulus), wording.estimate(row.poisson_ratio)],
        "change": f"{100 * row.change:+.1f} % (95 %: {low:+.1f} to {high:+.1f} %)" if low < high else "the first",
        "moved": row.moved,
    }


def _sides(shown: Shown) -> dict[str, Any]:
    """Return effects, errors and material of two states, a row a quantity."""
    both = [one.found for _, one in shown.sides]
    lasts = [one.models[-1] for one in both]
    effects = [
        [*one.models[-1].effects, *(key for last in one.pictured[-1:] for key in last.effects)] for one in both
    ]
    rows = [
        ["effects", *(", ".join(map(in_words, keys)) or "none" for keys in effects)],
        ["presses fitted", *(str(one.fitted.data.count) for one in lasts)],
    ]
    falls = [{fall.unit: _fall(fall) for fall in error_falls(one)} for one in both]
    for unit in dict.fromkeys(unit for one in falls for unit in one):
        last = [f"{one[unit]['error'][-1]:.1f} {one[unit]['unit']}" if unit in one else "–" for one in falls]
        rows.append([f"error of the {'force' if unit == 'N' else 'depth'}", *last])
    for title, name in (("E", "youngs_modulus"), ("ν", "poisson_ratio"), ("c", "c"), ("β", "beta")):
        rows.append([title, *(_of_gel(one.material, name) for one in lasts)])
    return {"names": [name for name, _ in shown.sides], "rows": rows}


def curve_view(shown: Shown) -> dict[str, Any]:
    """Return measured and modelled forces press by press, and residuals over every covariate."""
    models = _shown_models(shown)
    if not models:
        return {"models": [], "presses": [], "strips": [], "depth": None}
    fits = {name: one.fitted for name, one in models.items()}
    try:
        curves = force_curves(fits)
    except InputError:  # two states of different presses: the last one alone
        last = list(models)[-1]
        models, fits = {last: models[last]}, {last: fits[last]}
        curves = force_curves(fits)
    strips = residual_strips(fits, [one.covariates for one in models.values()], most=EVERY)
    return _view(curves, strips, next(iter(fits.values()))) | {"depth": _depth_view(shown)}


def _depth_view(shown: Shown) -> dict[str, Any] | None:
    """Return the depth that pictures read against the certified one, before and after; None without both."""
    pictured = () if shown.now is None else shown.now.found.pictured
    if not pictured:
        return None
    base, last = pictured[0].fitted, pictured[-1].fitted
    sets = [_depths("as read", base, base.data.normal_N)]
    if len(pictured) > 1:
        named = " + ".join(in_words(key) for key in pictured[-1].effects)
        sets.append(_depths(f"corrected for {named}", last, corrected_depth(last)))
    return {"sets": sets, "faces": base.data.slopes is not None}


def _depths(name: str, fitted: Fit, read_mm: Floats) -> dict[str, Any]:
    data, names = fitted.data, press_names(fitted.data)
    return {
        "name": name,
        "certified": _few(data.depth_mm),
        "read": _few(read_mm),
        "face": [True] * data.size if data.slopes is None else np.isnan(data.slopes.slope).tolist(),
        "press": [names[k] for k in data.press],
        "against": [
            {"words": words, "values": _few(np.asarray(values, float))}
            for words, values in recorded_of_depth(data)
        ],
    }


def _shown_models(shown: Shown) -> dict[str, Compared]:
    """Return the two models to show: two states side by side, else the base model and the current one."""
    if shown.sides:
        return {name: fitted.found.models[-1] for name, fitted in shown.sides}
    if shown.now is None:
        return {}
    models = shown.now.found.models
    named = " + ".join(in_words(key) for key in models[-1].effects)
    return {BASE: models[0]} | ({f"+ {named}": models[-1]} if named else {})


def tried_view(shown: Shown, name: str, value: float) -> dict[str, Any]:
    """Return the force of the current model with one parameter at another value.

    Raises InputError for an unknown parameter, or a value outside its range.
    """
    if shown.now is None:
        raise InputError("there is no model yet", where="workbench")
    found = shown.now.found
    seen = next((one.fitted for one in found.pictured[-1:] if name.partition(".")[0] in one.effects), None)
    fitted = found.models[-1].fitted if seen is None else seen
    place = fitted.index(name)
    low, high = fitted.parameters[place].bounds
    if not low <= value <= high:
        raise InputError(
            "the value lies outside the parameter's range", where=name, value=value, remedy=f"{low:g} to {high:g}"
        )
    values = fitted.values.copy()
    values[place] = value
    if seen is not None:
        read = corrected_depth(replace(seen, values=values))
        off = read - seen.data.depth_mm
        return {"rms": KILO * float(np.sqrt(np.mean(off**2))), "unit": "µm", "depth": _few(read)}
    force = fitted.model.predict(values, fitted.data)
    tried = replace(fitted, values=values, force_N=force, residual_N=fitted.data.normal_N - force)
    curves = force_curves({"tried": tried})
    return {
        "rms": KILO * tried.rms_error_N,
        "unit": "mN",
        "presses": [
            {"modelled": _few(one.modelled_N[0]), "residual": _few(KILO * one.residual_N[0])}
            for one in curves.presses
        ],
    }


def _view(curves: ForceCurves, strips: ResidualStrips, fitted: Fit) -> dict[str, Any]:
    names = press_names(fitted.data)
    ordered = [names[k] for k in np.argsort(fitted.data.presses.order, kind="stable")]
    colours = radius_colours(curves.radii_mm)
    return {
        "models": list(curves.models),
        "colours": list(model_colours(len(curves.models))),
        "whole": curves.whole,
        "reach": KILO * strips.reach_N,
        "presses": [
            {
                "name": name,
                "indenter": one.indenter,
                "radius": one.radius_mm,
                "colour": colours[one.radius_mm],
                "time": _few(one.time_s),
                "depth": _few(one.depth_mm),
                "measured": _few(one.measured_N),
                "modelled": [_few(row) for row in one.modelled_N],
                "residual": [_few(KILO * row) for row in one.residual_N],
                "phase": list(one.phase),
                "rms": [KILO * float(value) for value in one.rms_N],
            }
            for name, one in zip(ordered, curves.presses, strict=True)
        ],
        "strips": [_strip(one) for one in strips.strips],
        "residual": [_few(KILO * row) for row in strips.residual_N],
        "press": [names[k] for k in fitted.data.press],
    }


def _strip(one: Strip) -> dict[str, Any]:
    return {
        "name": one.name,
        "words": one.words,
        "unit": "" if one.levels else one.unit,
        "levels": list(one.levels),
        "values": _few(one.values),
        "centre": _few(one.centre),
        "mean": [_few(KILO * row) for row in one.mean_N],
        "reach95": [_few(KILO * row) for row in one.reach95_N],
        "evidence": [evidence(*p) for p in zip(one.p_adjusted, one.p_trend, strict=True)],
    }


def _few(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    """Return the numbers of an array (n,), rounded for a screen."""
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]


def certificate_view(shown: Shown, recording: int, label: str) -> dict[str, Any]:
    """Return the certified depth of a press, and the factor of its read depths by the effects in the model."""
    if shown.now is None:
        return {}
    for one in shown.now.found.pictured[-1:]:
        presses = one.fitted.data.presses
        mine = [k for k, name in enumerate(presses.label) if name == label and presses.recording[k] == recording]
        rows = np.isin(one.fitted.data.press, mine)
        if rows.any():
            factor = float(np.median((corrected_depth(one.fitted) / one.fitted.data.normal_N)[rows]))
            return {"certified_mm": float(one.fitted.data.depth_mm[rows].max()), "factor": factor}
    return {}
