"""Measured and modelled force press by press, and what each effect of a model does to it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.inputs.denoised_depth import BRANCHES, branches
from tactilevision.errors import InputError
from tactilevision.records import Floats
from tactilevision.records.misfit import ForceCurves, PressCurve


def force_curves(fits: Mapping[str, Fit]) -> ForceCurves:
    """The presses of fits on the same measurements, by the models' names, the plain law first.

    Raises InputError where the fits have not the same samples.
    """
    models, data = same_samples(fits), next(iter(fits.values())).data
    table = np.array([one.force_N for one in fits.values()])
    words = np.array(BRANCHES)[branches(data)]
    ends = [*data.first[1:], data.size]
    presses = []
    for k in np.argsort(data.presses.order, kind="stable"):
        rows = slice(int(data.first[k]), int(ends[k]))
        indenter = data.indenters[int(data.presses.indenter[k])]
        presses.append(
            PressCurve(
                label=data.presses.label[k],
                indenter=indenter.name,
                radius_mm=float(data.presses.radius_mm[k]),
                time_s=data.time_s[rows] - data.time_s[rows.start],
                depth_mm=data.depth_mm[rows],
                measured_N=data.normal_N[rows],
                modelled_N=table[:, rows],
                phase=tuple(words[rows].tolist()),
            )
        )
    return ForceCurves(models, tuple(presses), data.is_curves)


def force_of_effect(fitted: Fit, key: str) -> Floats:
    """What one effect of a fitted model does to the force (N,), N: with it less without, all else held.

    Raises InputError where the model has no such effect.
    """
    places = fitted.model.slices(fitted.data)
    if key not in fitted.model.keys:
        raise InputError("the model has no such effect", where=fitted.model.name, value=key)
    values = np.delete(fitted.values, places[key])
    return np.asarray(fitted.force_N - fitted.model.without(key).predict(values, fitted.data))


def same_samples(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """The fits' names. Raises InputError for none, or for fits that do not stand on the same samples."""
    every = list(fits.values())
    if not every:
        raise InputError("there is no model to show", where="figure")
    first = every[0].data
    for name, one in fits.items():
        if one.data.size != first.size or one.data.presses.label != first.presses.label:
            raise InputError("these models were fitted to other presses", where="figure", value=name)
    return tuple(fits)
