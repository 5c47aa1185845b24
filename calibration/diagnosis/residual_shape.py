"""The simplest shape of an unexplained residual: over which covariate it steps, waves, rises or bends.

Each shape is a direction of the force, alone or in proportion to the force,

    step 1[u > u0],    wave cos(2 pi u/L), sin(2 pi u/L),    line u,    bend u^2,

whitened, less what the fit absorbs. The best removes most of chi^2, less 2 a number and 2 ln of the forms
searched. It describes where to look; it names no cause.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import log

import numpy as np

from calibration.diagnosis.covariates import seen_covariates
from calibration.effects.own_shape import Shape
from calibration.fit.least_squares import Fit, unexplained
from calibration.inputs.conditions import Covariate
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats

ALIKE = ("w/h", "1/w", "load/unload", "indenter", "azimuth")  # other forms of a depth, names, and directions
STEPS = 60  # places of a step that are tried, at quantiles
PERIODS = 16  # of a wave that are tried, from the range down to a twelfth of it
ABSORBED = 3  # of the residual's size: what is larger hides almost whole in what the fit absorbs
FEW = 3  # distinct values that a wave or a bend exceeds
Form = tuple[str, float, int, list[Floats]]  # kind, place or period, forms searched, columns


def find_shape(fitted: Fit) -> Shape | None:
    """Return the shape that removes most of a fit's residual; None where none removes more than it costs."""
    free = fitted.free & ~fitted.at_bound
    white = fitted.whitener.apply(np.column_stack([fitted.jacobian[:, free], fitted.residual_N]))
    absorbed, best, most, count = white[:, :-1], None, 0.0, 0
    seen = unexplained(absorbed, white[:, -1])
    for covariate in (one for one in seen_covariates(fitted) if one.name not in ALIKE):
        for relative in (False, True):
            scale = np.abs(fitted.about.force_N) if relative else 1.0
            for kind, at, searched, forms in _forms(covariate):
                count += 1
                columns = np.column_stack(forms) * np.reshape(scale, (-1, 1))
                left = unexplained(absorbed, fitted.whitener.apply(columns))
                size = np.asarray(np.linalg.lstsq(left, seen, rcond=None)[0], float)
                cost = 2 * (len(forms) + (searched > 1)) + 2 * log(searched)
                gain = float(np.sum(np.square(left @ size))) - cost
                if gain > most and np.std(columns @ size) < ABSORBED * np.std(fitted.residual_N):
                    ends = float(np.min(covariate.values)), float(np.max(covariate.values))
                    about = (covariate.name, covariate.unit, kind, relative, at, ends)
                    found = float(np.hypot(*size) if size.size > 1 else size[0]), _phase(size)
                    best, most = Shape(*about, *found, searched=0), gain
    return best and replace(best, searched=count)


def _phase(size: Floats) -> float:
    """Return the phase of a wave, rad; 0 of another shape."""
    return float(np.arctan2(-size[1], size[0])) if size.size > 1 else 0.0


def _forms(covariate: Covariate) -> Iterator[Form]:
    values = covariate.values
    distinct, low, reach = np.unique(values), float(values.min()), float(np.ptp(values))
    unit = (values - low) / max(reach, TINY)
    between = (distinct[1:] + distinct[:-1]) / 2
    places = np.unique(np.quantile(between, np.linspace(0, 1, STEPS), method="nearest"))
    for place in places:
        yield "step", float(place), places.size, [(values > place).astype(float)]
    yield "line", low, 1, [unit]
    if distinct.size > FEW:
        yield "bend", low, 1, [unit**2]
        for period in reach * np.geomspace(1, 1 / 12, PERIODS):
            turn = 2 * np.pi * values / period
            yield "wave", float(period), PERIODS, [np.cos(turn), np.sin(turn)]
