"""By how much an effect that these data cannot show could still put E off.

The base model is refitted, linearly, to the force that the effect would bring at a typical size; what of it goes
into E is the bias:    d theta = (J^T V^-1 J)^-1 J^T V^-1 d f.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.fitting import Fit, inverse_information
from calibration.noise import Whitener
from calibration.stages import Effect
from tactilevision.records import Floats


def possible_bias(fitted: Fit, effects: Sequence[Effect]) -> Mapping[str, float]:
    """Relative error of E for each effect at its typical size (the scale of its first parameter); signs are kept.

    Effects that cannot be worked out on these data (a place or a temperature that nobody recorded) are left out.
    """
    found = {}
    for effect in effects:
        change = _change(fitted, effect)
        if change is not None:
            found[effect.key] = _into_modulus(fitted, change)
    return found


def _change(fitted: Fit, effect: Effect) -> Floats | None:
    if effect.key in fitted.model.keys:
        return None
    model = fitted.model + effect
    place = model.slices(fitted.data)[effect.key].start
    own = np.array([p.default for p in effect.parameters])
    first = effect.parameters[0]
    own[0] = np.clip(first.default + first.scale, *first.bounds)
    values = np.insert(fitted.values, [place] * own.size, own)
    try:
        with np.errstate(all="ignore"):
            force = np.asarray(model.predict(values, fitted.data))
    except (Exception, SystemExit):  # an effect without its covariate may raise anything
        return None
    real = not np.iscomplexobj(force) and bool(np.isfinite(force).all())
    usable = real and force.shape == fitted.force_N.shape
    return force - fitted.force_N if usable else None


def _into_modulus(fitted: Fit, change_N: Floats) -> float:
    whitener = Whitener(fitted.data, fitted.noise, fitted.about)
    free = fitted.free
    known = np.array([0.0 if p.prior is None else 1 / p.prior.std for p in fitted.parameters])[free]
    jacobian = np.vstack([whitener.apply(fitted.jacobian[:, free]), np.diag(known)])
    target = np.concatenate([whitener.apply(change_N), np.zeros(known.size)])
    moved = inverse_information(jacobian) @ (jacobian.T @ target)
    k = int(np.flatnonzero(np.flatnonzero(free) == fitted.index("youngs_modulus_MPa"))[0])
    return float(moved[k] / fitted.values[fitted.index("youngs_modulus_MPa")])
