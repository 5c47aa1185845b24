"""Step functions of all that is recorded, as directions of the force; what an effect may be off by in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.sensitivity import force_without
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import Covariate, bins, covariates
from calibration.model.stages import Stage
from tactilevision.records import Floats

DEPTH_BINS = 16  # steps of the depth: what varies over a sixteenth of it is seen
FORM = (
    0.1  # std, of what a gel's effect adds: how far its form is off in each step of each covariate (others_curves)
)
HOW_A_PRESS_GOES = ("w", "w/h", "1/w", "P", "t", "load/unload", "log rate", "a")  # may change any effect of a gel
OTHER_BINS = 6  # steps of every other covariate
SAME = 1e-6  # of the largest column: what is less is made of the others


def covariate_steps(steady: Fit) -> dict[str, Floats]:
    """Step functions (N, k) of everything recorded, and of effects' sizes that have to be one, by name."""
    seen = seen_covariates(steady)
    return {c.name: _steps(steady, c) for c in seen} | _of_one_size(steady, seen)


def seen_covariates(steady: Fit) -> tuple[Covariate, ...]:
    """The covariates of a steadied fit, force as fitted: bins of what was read would sort residuals by their own
    noise.
    """
    return covariates(steady.data.with_force(steady.force_N))


def form_errors(steady: Fit) -> Floats:
    """What the form of the gel's effects in the fit may be off by (N, m), N, one std a column: a random share of
    what each adds, in each step of how a press goes and of what the effect says it is seen in. What it has nothing
    to do with, such as another effect's temperature, its form does not follow. Errors of depth and of force are
    definitions: no form can be off.
    Source: Kennedy, O'Hagan, J. R. Stat. Soc. B 63 (2001) 425 (a discrepancy as a random function).
    """
    model, seen = steady.model, seen_covariates(steady)
    found = [np.zeros((steady.data.size, 0))]
    for effect in (e for e in model.effects if e.stage not in (Stage.DEPTH, Stage.INSTRUMENT)):
        without = force_without(model, steady.values, steady.data, key=effect.key)
        own = {*HOW_A_PRESS_GOES, *getattr(effect, "seen_in", ())}
        added = FORM * (steady.force_N - without)[:, None]
        found += [added * _hot(c, OTHER_BINS) for c in seen if c.name in own]
    return _independent(np.hstack(found))


def _independent(columns: Floats) -> Floats:
    """As many columns as are independent (N, r), of the same covariance: bins of alike covariates repeat."""
    _, sizes, axes = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(columns @ axes[sizes > SAME * sizes.max(initial=0.0)].T)


def _steps(fitted: Fit, covariate: Covariate) -> Floats:
    """Step functions (N, k) of a covariate: of the stiffness for a press's, of the depth for a sample's."""
    carried = fitted.about.force_N if covariate.of_press else fitted.about.slope_N_per_mm
    hot = _hot(covariate, DEPTH_BINS if covariate.name == "w" else OTHER_BINS)
    return np.asarray(hot * (np.abs(carried) + fitted.about.base_N * fitted.noise.scale)[:, None])


def _hot(covariate: Covariate, most: int) -> Floats:
    """Which bin each sample is in (N, k), 1 or 0."""
    number = bins(covariate, most)
    return np.asarray(np.eye(int(number.max()) + 1)[number])


def _of_one_size(fitted: Fit, seen: Sequence[Covariate]) -> dict[str, Floats]:
    """Step functions (N, k) of the sizes of effects in the fit that have to have one throughout."""
    found = {}
    for effect in fitted.model.effects:
        name = f"{effect.key}.{effect.parameters[0].name}" if effect.parameters else ""
        for covariate in (c for c in seen if c.name in getattr(effect, "same_over", ())):
            change = fitted.jacobian[:, fitted.index(name)]
            found[f"{effect.key} by {covariate.name}"] = _hot(covariate, OTHER_BINS) * change[:, None]
    return found
