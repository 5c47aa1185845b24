"""The curves and residual strips of what stands, as plain data for the page: two models at most, on one scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.excluded_presses import press_names
from calibration.report.error_fall import BASE
from calibration.report.force_curves import force_curves
from calibration.report.residual_strips import residual_strips
from calibration.report.verdict import in_words
from calibration.tasks.compare import Compared
from calibration.workbench.bench import Shown
from tactilevision.errors import InputError
from tactilevision.plots.misfit import evidence, model_colours, radius_colours
from tactilevision.records.misfit import ForceCurves, ResidualStrips, Strip

EVERY = 99  # strips at most: all that was recorded
MN = 1e3  # of a N
DIGITS = 5  # significant ones that a screen needs


def curve_view(shown: Shown) -> dict[str, Any]:
    """Measured and modelled forces press by press, and what is left against everything recorded."""
    models = shown_models(shown)
    if not models:
        return {"models": [], "presses": [], "strips": []}
    fits = {name: one.fitted for name, one in models.items()}
    try:
        curves, strips = (
            force_curves(fits),
            residual_strips(fits, [m.covariates for m in models.values()], most=EVERY),
        )
    except InputError:  # two states on other presses: the last one alone
        last = list(models)[-1]
        return curve_view_of({last: models[last]})
    return _view(curves, strips, next(iter(fits.values())))


def curve_view_of(models: Mapping[str, Compared]) -> dict[str, Any]:
    """The same of these models."""
    fits = {name: one.fitted for name, one in models.items()}
    strips = residual_strips(fits, [one.covariates for one in models.values()], most=EVERY)
    return _view(force_curves(fits), strips, next(iter(fits.values())))


def shown_models(shown: Shown) -> dict[str, Compared]:
    """The two models on the screen: two states side by side, else the plain law and what stands."""
    if shown.sides is not None:
        return {n: f.found.models[-1] for n, f in zip(shown.sides.names, shown.sides.fitted, strict=True)}
    if shown.now is None:
        return {}
    models = shown.now.found.models
    named = " + ".join(in_words(key) for key in models[-1].effects)
    return {BASE: models[0]} | ({f"+ {named}": models[-1]} if named else {})


def tried_view(shown: Shown, name: str, value: float) -> dict[str, Any]:
    """The force of what stands with one parameter at another value, all else held.

    Raises InputError for a parameter that is not there, or a value outside its range.
    """
    if shown.now is None:
        raise InputError("there is no model yet", where="workbench")
    fitted = shown.now.found.models[-1].fitted
    place = fitted.index(name)
    low, high = fitted.parameters[place].bounds
    if not low <= value <= high:
        raise InputError("the parameter has no such value", where=name, value=value, remedy=f"{low:g} to {high:g}")
    values = fitted.values.copy()
    values[place] = value
    force = fitted.model.predict(values, fitted.data)
    tried = replace(fitted, values=values, force_N=force, residual_N=fitted.data.normal_N - force)
    curves = force_curves({"tried": tried})
    return {
        "rms": MN * tried.rms_error_N,
        "presses": [
            {"modelled": _few(one.modelled_N[0]), "residual": _few(MN * one.residual_N[0])}
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
        "reach": MN * strips.reach_N,
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
                "residual": [_few(MN * row) for row in one.residual_N],
                "phase": list(one.phase),
                "rms": [MN * float(value) for value in one.rms_N],
            }
            for name, one in zip(ordered, curves.presses, strict=True)
        ],
        "strips": [_strip(one) for one in strips.strips],
        "residual": [_few(MN * row) for row in strips.residual_N],
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
        "mean": [_few(MN * row) for row in one.mean_N],
        "reach95": [_few(MN * row) for row in one.reach95_N],
        "evidence": [evidence(*p) for p in zip(one.p_adjusted, one.p_trend, strict=True)],
    }


def _few(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    """The numbers of an array (n,) in their unit, to as many digits as a screen shows."""
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]
