"""Plain data of the page's charts: forces press by press, residuals, depths that pictures read, and sliders."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from calibration.diagnosis.vision_depth_check import corrected_depth, recorded_of_depth
from calibration.fit.least_squares import Fit
from calibration.inputs.observations import press_names
from calibration.report.misfit import BASE, force_curves, residual_strips
from calibration.report.wording import in_words
from calibration.tasks.compare import Compared
from calibration.workbench.bench import Shown
from tactilevision.errors import InputError
from tactilevision.plots.misfit import evidence, model_colours, radius_colours
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.measured import Floats
from tactilevision.records.misfit import ForceCurves, ResidualStrips, Strip

EVERY = 99  # residual strips at most: all covariates
DIGITS = 5  # significant digits of numbers for a screen


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


# Why a press stays off the last model: low or high as a whole, a shifted zero, or neither.

OFF = 1.3  # rms of a press over that of all, beyond which it is explained
MOST = 0.7  # share of a press's mean square that a gain or a zero has to explain
USUAL = 2.0  # std of gains or zeros that count as their scatter
COURSE = "neither a gain nor a zero: look at the course of its residual"


def why_off(fitted: Fit) -> dict[str, str]:
    """Return a phrase for each press that is off by more than most, by its name."""
    data, noise, names, found = fitted.data, fitted.noise, press_names(fitted.data), {}
    for number, rows in enumerate(data.spans):
        left = fitted.residual_N[rows]
        if np.mean(left**2) <= (OFF * fitted.rms_error_N) ** 2:
            continue
        gain, by_gain = _along(fitted.force_N[rows], left)
        zero, by_zero = _along(fitted.about.slope_N_per_mm[rows], left)
        if max(by_gain, by_zero) < MOST:
            found[names[number]] = COURSE
        elif by_gain >= by_zero:
            size, usual = f"{100 * abs(gain):.1f} %", noise.gain
            beside = _beside(abs(gain), usual, "gains", f"{100 * usual:.1f} %")
            found[names[number]] = f"{size} {'low' if gain < 0 else 'high'} as a whole: {beside}"
        else:
            beside = _beside(abs(zero), noise.zero_mm, "zeros", f"{KILO * noise.zero_mm:.0f} µm")
            found[names[number]] = f"its zero is off by {KILO * abs(zero):.0f} µm: {beside}"
    return found


def _along(direction: Floats, left: Floats) -> tuple[float, float]:
    """Return the size of a direction (n,) in the residual (n,), and the share of its squares that it explains."""
    size = float(direction @ left / max(float(direction @ direction), TINY))
    return size, 1 - float(np.sum((left - size * direction) ** 2)) / max(float(left @ left), TINY)


def _beside(size: float, usual: float, what: str, words: str) -> str:
    return f"{'within' if size <= USUAL * usual else 'beyond'} the scatter of {what} ({words})"
