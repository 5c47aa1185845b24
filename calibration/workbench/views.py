"""Plain data of the workbench's page but for its charts: the state.

Every number and sentence comes from the functions of the reports.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

import numpy as np

from calibration.effects.private import template
from calibration.fit.repeats import LEVEL
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.observations import press_names
from calibration.model.stages import Effect
from calibration.report import wording
from calibration.report.diagnosis_report import VERDICTS
from calibration.report.headline import UNSEEN, fall_lead, fall_note, modulus_rows, undetermined
from calibration.report.misfit import error_falls, model_names
from calibration.report.report import OF_MATERIAL, parameter
from calibration.report.wording import in_words
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import HistoryRow
from calibration.tasks.compare import Compared, Comparison, rms_of_presses
from calibration.workbench.analysis import OF_FORCE, Evidence, Verdict
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.curve_views import why_off
from calibration.workbench.opened import Opened
from calibration.workbench.recorded import uncertified
from tactilevision.plots.misfit import CERTAIN, model_colours
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.misfit import ErrorFall, Strip


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
        "again": bench.again,
        "certified": opened.observed is not None,
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
        "own_effect": found.own_effect,
        "template": template("my_effect"),
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
                "text": f"held at {value:.4g} {'' if p.unit == '1' else p.unit}".strip()
                if p.fixed
                else wording.estimate(estimate),
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
    """Return E and nu of each model in words, and E of the last one after the diagnosis."""
    names, verdict = model_names([model.effects for model in found.models]), shown.verdict or Verdict()
    known = {name: one.material for name, one in zip(names, found.models, strict=True) if one.material is not None}
    rows = {row.name: row for row in modulus_rows(known, shown.stated if names[-1] in known else None)}
    lacks = [in_words(key) for key in verdict.named] if verdict.word != "AMBIGUOUS" else []
    return [
        {
            "name": name,
            "modulus": rows[name].modulus if name in rows else [],
            "ratio": rows[name].ratio if name in rows else [],
            "open": undetermined([known[name]]) if name in known else [],
            "lacks": f"lacks {' and '.join(lacks)}" if lacks and name == names[-1] else "",
        }
        for name in dict.fromkeys((*names, *rows))
    ]


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
        return f"significant (p < {CERTAIN:g})"
    return f"{'' if p < LEVEL else 'not '}significant (p = {p:.2g})"


def _overlay(shown: Strip) -> dict[str, Any]:
    before, after, predicted = KILO * shown.mean_N
    axis = {"words": shown.words, "unit": "" if shown.levels else shown.unit, "levels": list(shown.levels)}
    return axis | {"values": shown.centre, "before": before, "after": after, "predicted": predicted}


def _presses(opened: Opened, shown: Shown) -> Iterator[dict[str, Any]]:
    """Yield every press in the order of pressing, also excluded and rejected ones, with the reason."""
    if opened.observed is None:
        why = "not certified" if shown.troubled else "being certified"
        yield from uncertified([one.recording for one in opened.measured], why)
        return
    data, names, rms = opened.data, press_names(opened.data), _rms(shown)
    odd = () if shown.verdict is None else shown.verdict.odd
    off = {} if shown.now is None else why_off(shown.now.found.models[-1].fitted)
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
            "why": "" if out else off.get(names[k], ""),
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
