"""By how much an effect that these data cannot show could still put E off.

The model is refitted, linearly (`calibration/fit/absorbed.py`), to the force that the effect would bring at a
given size; what of it goes into E is the bias.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from calibration.diagnosis.typical_sizes import absent, largest, typical
from calibration.fit.absorbed import Absorbed
from calibration.fit.least_squares import Fit
from calibration.inputs.observations import Observations
from calibration.model.composition import Model
from calibration.model.stages import Effect, EffectBase
from tactilevision.records import Floats

NOTHING = 1e-9  # of the largest force


@dataclass(frozen=True, slots=True)
class Hidden:
    """Effects that cannot be seen and `why`; the relative error of E that each would bring (`bias`), and that of
    the others at the smallest size that would have shown (`below`).
    """

    why: Mapping[str, str]
    bias: Mapping[str, float]
    below: Mapping[str, float]


def possible_bias(
    fitted: Fit, effects: Sequence[Effect], *, sizes: Mapping[str, float] = MappingProxyType({})
) -> Mapping[str, float]:
    """Relative error of E for each effect at the size of its first parameter that is given, else at its typical
    one; signs are kept.

    0 for what these depths hold nothing of, wherever they come from. Effects that cannot be worked out on these
    data (a place, a time or a temperature that nobody recorded), or whose lack of data leaves them nothing to act
    on, are left out: what they do to E is unknown, not 0.
    """
    found = {}
    for effect in effects:
        if absent(effect, fitted.data):
            found[effect.key] = 0.0
            continue
        first = effect.parameters[0]
        size = first.default + sizes.get(effect.key, typical(effect))
        own = np.array([np.clip(size, *first.bounds), *(p.default for p in effect.parameters[1:])])
        change = change_of_force(fitted, effect, own=own)
        acts = change is not None and np.abs(change).max() > NOTHING * np.abs(fitted.force_N).max()
        if change is not None and (acts or not effect.missing(fitted.data)):
            found[effect.key] = _into_modulus(fitted, change)
    return found


def hidden(
    fitted: Fit, effects: Sequence[Effect], *, missing: Mapping[str, str], visible: Mapping[str, float]
) -> Hidden:
    """What of these effects cannot be seen, for want of data (`missing` says why) or because it would show only at
    a size that no rig has, and what could be there below the size from which it is visible.
    """
    small = {e.key: e for e in effects if e.key not in missing and largest(e) < visible.get(e.key, 0.0)}
    why = {**missing, **{key: _too_small(effect, visible[key]) for key, effect in small.items()}}
    ends = {key: largest(effect) for key, effect in small.items()}
    shown = [e for e in effects if e.key in visible and e.key not in why]
    return Hidden(
        why,
        possible_bias(fitted, [e for e in effects if e.key in why], sizes=ends),
        possible_bias(fitted, shown, sizes=visible),
    )


def _too_small(effect: Effect, size: float) -> str:
    if not np.isfinite(size):
        return "the model takes all of it: these data cannot tell it from what is in it"
    unit = "" if effect.parameters[0].unit == "1" else f" {effect.parameters[0].unit}"
    return f"it would show from {size:.2g}{unit} on, and is hardly ever larger than {largest(effect):.2g}{unit}"


def change_of_force(fitted: Fit, effect: Effect, *, own: Floats) -> Floats | None:
    """What an effect of these values adds to the fit's force (N,).

    None where it is in the model already, or cannot be worked out on these data.
    """
    if effect.key in fitted.model.keys:
        return None
    model = fitted.model + effect
    place = model.slices(fitted.data)[effect.key].start
    values = np.insert(fitted.values, [place] * own.size, own)
    try:
        with np.errstate(all="ignore"):
            data = effect.supposed(fitted.data) if isinstance(effect, EffectBase) else fitted.data
            force = np.asarray(model.predict(values, data))
    except (Exception, SystemExit):  # an effect without its covariate may raise anything
        return None
    real = not np.iscomplexobj(force) and bool(np.isfinite(force).all())
    usable = real and force.shape == fitted.force_N.shape
    return as_it_holds(fitted, model, values, force - fitted.force_N) if usable else None


def as_it_holds(fitted: Fit, model: Model, values: Floats, change_N: Floats) -> Floats:
    """A change (N,), N, of the fit's force by `model` at these values (p,), with the face let go where it is in
    the fit: a few samples that pass a threshold would be most of a change that is small everywhere else.
    """
    for key in (e.key for e in fitted.model.effects if getattr(e, "asks_readings", False)):
        before = fitted.force_N - force_without(fitted.model, fitted.values, fitted.data, key=key)
        after = fitted.force_N + change_N - force_without(model, values, fitted.data, key=key)
        passed = np.abs(after - before) > np.maximum(np.abs(after), np.abs(before)) / 2
        change_N = np.where(passed, change_N - (after - before), change_N)
    return change_N


def force_without(model: Model, values: Floats, data: Observations, *, key: str) -> Floats:
    """Force (N,), N, of the model less one effect, at the same values (p,) of all others."""
    return np.asarray(model.without(key).predict(np.delete(values, model.slices(data)[key]), data))


def _into_modulus(fitted: Fit, change_N: Floats) -> float:
    absorbed, modulus = Absorbed(fitted, fitted.free), fitted.index("youngs_modulus_MPa")
    moved = absorbed.moved(absorbed.padded(change_N))
    return float(moved[absorbed.row_of(modulus)] / fitted.values[modulus])
