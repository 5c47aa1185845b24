"""What several radii would say of nu if the gel stuck to the face, or if the edges were rounded.

Friction and an edge stiffen or soften each radius by another share, which looks like another nu; where nothing is
said of them, nu and E are to hold for each. What fits worse by chi^2 = D can be there in part: a share t of it
costs t^2 D, so that intervals of 95 % reach a share 1.96/sqrt(D) of the way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.least_squares import Fit, fit
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import EDGE, STICKING
from tactilevision.mechanics.tables.profile import EDGE_OVER_H

_KEPT: deque[tuple[Fit, Fit]] = deque(maxlen=4)


@dataclass(frozen=True, slots=True)
class Rival:
    """Another fit of the same presses (None: it cannot be fitted), and how much of the way to it is open."""

    fitted: Fit | None
    share: float


_RIVALS: deque[tuple[Fit, tuple[Rival, ...]]] = deque(maxlen=4)


def rivals(fitted: Fit) -> tuple[Rival, ...]:
    """A gel that sticks, rounded edges, and both, as far as they may be; none where nu is fixed.

    Kept for the last few fits, since more than one judgement asks for them. Raises ConvergenceError.
    """
    for known, found in _RIVALS:
        if known is fitted:
            return found
    others = tuple(_rivals(fitted))
    _RIVALS.append((fitted, others))
    return others


def _rivals(fitted: Fit) -> Iterator[Rival]:
    law, data = fitted.model.law, fitted.data
    fixed = fitted.parameters[fitted.index("poisson_ratio")].fixed
    if fixed or np.unique(data.presses.radius_mm).size == 1 or not isinstance(law, FlatPunch):
        return
    known = _fits(fitted, EDGE) or all(i.edge_radius_mm is not None for i in data.indenters)
    glued = stuck(fitted)
    laws = [law] if glued is None else [law, replace(law, sticking=1.0)]
    fits = [] if known else [_again(fitted, one, with_usual_edges(data)) for one in laws]
    fits += [] if glued is None else [glued]
    for one in fits:
        yield Rival(one, min(1.96 / max(one.chi2 - fitted.chi2, 1e-9) ** 0.5, 1.0))


def stuck(fitted: Fit) -> Fit | None:
    """The same on a gel that sticks to the face; None where it does already, slides, or has its friction fitted.
    Kept for the last few fits, since more than one judgement asks for it.

    Raises ConvergenceError where that cannot be fitted.
    """
    law = fitted.model.law
    slides = fitted.data.lubricated or _fits(fitted, STICKING)
    if slides or not isinstance(law, FlatPunch) or law.sticking == 1:
        return None
    for known, found in _KEPT:
        if known is fitted:
            return found
    found = _again(fitted, replace(law, sticking=1.0), fitted.data)
    _KEPT.append((fitted, found))
    return found


def _fits(fitted: Fit, condition: str) -> bool:
    return any(getattr(effect, "condition", "") == condition for effect in fitted.model.effects)


def _again(fitted: Fit, law: FlatPunch, data: Observations) -> Fit:
    model = Model(law, fitted.model.effects)
    return fit(model, data, noise=fitted.noise, starts=fitted.values[None], tolerances=False)


def with_usual_edges(data: Observations) -> Observations:
    """The data with the usual rounding for each indenter that states none."""
    usual = EDGE_OVER_H * data.gel.thickness_mm
    return replace(
        data,
        indenters=tuple(
            replace(i, edge_radius_mm=usual) if i.edge_radius_mm is None else i for i in data.indenters
        ),
    )
