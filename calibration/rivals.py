"""What several radii would say of nu if the gel stuck to the face, or if the edges were rounded.

Friction and an edge stiffen or soften each radius by another share, which looks like another nu; where nothing is
said of them, nu and E are to hold for each.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.data import Observations
from calibration.fitting import Fit, fit
from calibration.laws.flat_punch import FlatPunch
from calibration.model import Model
from tactilevision.mechanics.tables.profile import EDGE_OVER_H


def rivals(fitted: Fit) -> tuple[Fit, ...]:
    """The fits of a gel that sticks, of rounded edges, and of both, as far as they may be; none where nu is fixed.

    Raises ConvergenceError.
    """
    law, data = fitted.model.law, fitted.data
    fixed = fitted.parameters[fitted.index("poisson_ratio")].fixed
    if fixed or np.unique(data.presses.radius_mm).size == 1 or not isinstance(law, FlatPunch):
        return ()
    slides = lubricated(data) or "friction" in fitted.model.keys or law.sticking == 1
    known = "edge_fillet" in fitted.model.keys or all(i.edge_radius_mm is not None for i in data.indenters)
    laws = [law] if slides else [law, replace(law, sticking=1.0)]
    edges = [data] if known else [data, with_usual_edges(data)]
    others = [(law, seen) for law in laws for seen in edges][1:]
    return tuple(_again(fitted, law, seen) for law, seen in others)


def stuck(fitted: Fit) -> Fit | None:
    """The same on a gel that sticks to the face; None where it does already, or slides.

    Raises ConvergenceError where that cannot be fitted.
    """
    law = fitted.model.law
    if lubricated(fitted.data) or not isinstance(law, FlatPunch) or law.sticking == 1:
        return None
    return _again(fitted, replace(law, sticking=1.0), fitted.data)


def _again(fitted: Fit, law: FlatPunch, data: Observations) -> Fit:
    model = Model(law, fitted.model.effects)
    return fit(model, data, noise=fitted.noise, starts=fitted.values[None], tolerances=False)


def with_usual_edges(data: Observations) -> Observations:
    """The data with the usual rounding for each indenter that states none."""
    usual = EDGE_OVER_H * data.gel.thickness_mm
    return replace(data, indenters=tuple(
        replace(i, edge_radius_mm=usual) if i.edge_radius_mm is None else i for i in data.indenters))  # fmt: skip


def lubricated(data: Observations) -> bool:
    """Whether all presses were."""
    return bool(np.all(data.presses.lubricated == 1))
