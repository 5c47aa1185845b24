"""Sensitivity of E to effects, and the minimum detectable size of each effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT
from calibration.diagnosis.score_statistics import Cast, Tail
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.identifiability import identify, mixture_quantile, stuck
from calibration.fit.least_squares import Fit, inverse_information
from calibration.inputs.observations import Observations
from calibration.model.composition import Model
from calibration.model.stages import STICKING, Effect, Parameter
from tactilevision.errors import InputError
from tactilevision.records.constants import ROUNDING, TAILS95, TINY
from tactilevision.records.measured import Bools, Estimate, Floats

# The minimum detectable effect at 80 % power.
#
# Where many presses determine the noise, that is 3.6 std. With few, the limit of each effect's likelihood ratio
# comes from bootstrap samples, and a larger gain of the presses may account for part of the effect.

KNOWN = 3.6  # std detected at 80 % power where presses determine the noise
FOUR_OF_FIVE = 0.84  # std: the 80 % point of a normal distribution
MOST = 1_000_000  # of a statistic


def smallest_visible(
    cast: Cast, effects: Sequence[Effect], keys: Sequence[str], *, level: float, drawn: Floats | None
) -> dict[str, float]:
    """Return the minimum detectable amplitude, in its unit, of each effect of these `keys`, the first of `cast`.

    It is that of the most visible start, if possible of those where no other parameter of the same unit differs
    from its default; inf where the model absorbs the effect. `drawn` (n, k): null statistics, for few presses;
    None for many. `level`: family-wise.
    """
    by_key, found = {e.key: e for e in effects}, {}
    ends, std = np.concatenate([[0], cast.ends]), np.full(cast.sizes.size, KNOWN)
    if drawn is not None and drawn.shape[1]:
        ratio = (np.sqrt(_limits(drawn, level)) + FOUR_OF_FIVE) ** 2
        each = np.repeat(ratio, np.diff(ends[: len(keys) + 1]))
        std = cast.shown(np.pad(each, (0, std.size - each.size)))
    for k, key in enumerate(keys):
        mine, table = slice(ends[k], ends[k + 1]), by_key[key].parameters
        off = np.abs(by_key[key].starts(cast.fitted.data) - np.array([p.default for p in table]))
        others = [q for q in range(1, len(table)) if table[q].unit == table[0].unit]
        alone = (off[:, others] == 0).all(axis=1) & (off[:, 0] > 0)
        may = cast.left[k] & (cast.sizes[mine] > TINY) & (off[:, 0] > 0) & (alone | ~alone.any())
        best = int(np.argmax(np.where(may, cast.sizes[mine], 0.0)))
        found[key] = float(off[best, 0] * std[mine][best] / cast.sizes[mine][best]) if may[best] else float("inf")
    return found


def _limits(drawn: Floats, level: float) -> Floats:
    """Return the value of each statistic (k,) at the family-wise level, from null samples (n, k)."""
    tails = [Tail(column) for column in drawn.T]
    seen = [tail.of_each() for tail, column in zip(tails, drawn.T, strict=True) if column.any()]
    family = Tail(-np.log(np.min(seen, axis=0, initial=1.0)))
    p = float(np.exp(-_crossing(family, level)))
    return np.array([_crossing(tail, p) for tail in tails])


def _crossing(tail: Callable[[float], float], p: float) -> float:
    """Return the statistic at which the falling p equals this one."""
    low, high = 0.0, 1.0
    while tail(high) > p and high < MOST:
        high *= 2
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if tail(middle) > p else (low, middle)
    return high


# Size of effects on rigs and gels, in the unit of the first parameter. A fit may go farther, to its bounds.


def largest(effect: Effect) -> float:
    """Return the end of its stated range, from where it vanishes; without one, that of its bounds."""
    first = effect.parameters[0]
    low, high = first.bounds
    return max(high - first.default, first.default - low) if effect.largest is None else effect.largest


def typical(effect: Effect) -> float:
    """Return the size that it typically has where it is there."""
    return effect.parameters[0].scale if effect.typical is None else effect.typical


# The part of a change of the force that a fit absorbs, linear about it, with the priors of its parameters.
#
# d theta = (J^T V^-1 J + P)^-1 J^T V^-1 d f,    P the parameters' priors


class Absorbed:
    """Linearisation of a fit whose parameters `free` (p,) may move.

    `white` whitens forces (N,) in N, `rows` (N + q, q) are whitened J and priors, `inverse` is (J^T V^-1 J +
    P)^-1.
    """

    def __init__(self, fitted: Fit, free: Bools) -> None:
        self._fitted, self._free = fitted, free
        self.white = fitted.whitener.apply
        self.rows = np.vstack([self.white(fitted.jacobian[:, free]), np.diag(fitted.prior_weight[free])])
        self.inverse = inverse_information(self.rows)

    def row_of(self, parameter: int) -> int:
        """Return the place of a free parameter among the free ones."""
        return int(np.flatnonzero(np.flatnonzero(self._free) == parameter)[0])

    def padded(self, change_N: Floats, pull: Floats | float = 0.0) -> Floats:
        """Return a change (N,), N, whitened, followed by the free ones of the parameters' pulls (p,): (N + q,)."""
        return np.concatenate([self.white(change_N), np.broadcast_to(pull, self._free.shape)[self._free]])

    def of_modulus(self, padded: Floats) -> tuple[float, Floats]:
        """Return the relative change of E for a padded change (N + q,), and what the fit does not absorb of it."""
        moved, modulus = self.inverse @ (self.rows.T @ padded), self._fitted.index("youngs_modulus_MPa")
        return float(moved[self.row_of(modulus)] / self._fitted.values[modulus]), padded - self.rows @ moved


# Bias of E by an effect that these data cannot show: the linear refit of E to the force that the effect would
# bring.

NOTHING = ROUNDING  # of the largest force


@dataclass(frozen=True, slots=True)
class Limits:
    """What these data cannot show.

    `not_testable` has effects that cannot be tested, and why; `possible_bias` the relative error of E that each of
    them would bring; `visible` the minimum detectable size of the others at 80 % power, of the parameter in
    `sizes`; `below_visibility` the relative error of E that each would bring at that size.
    """

    not_testable: Mapping[str, str]
    possible_bias: Mapping[str, float]
    visible: Mapping[str, float]
    sizes: Mapping[str, Parameter]
    below_visibility: Mapping[str, float]


def possible_bias(
    fitted: Fit, effects: Sequence[Effect], *, sizes: Mapping[str, float] = MappingProxyType({})
) -> Mapping[str, float]:
    """Return the relative error of E, with its sign, for each effect at the given size, else at its typical one.

    0 for effects that these depths cannot have. Effects that cannot be computed on these data (a place, a time or
    a temperature was not recorded) are excluded: their bias is unknown.
    """
    found, absorbed = {}, Absorbed(fitted, fitted.free)
    for effect in effects:
        if effect.absent(fitted.data):
            found[effect.key] = 0.0
            continue
        first = effect.parameters[0]
        size = first.default + sizes.get(effect.key, typical(effect))
        own = np.array([np.clip(size, *first.bounds), *(p.default for p in effect.parameters[1:])])
        change = change_of_force(fitted, effect, own=own)
        acts = change is not None and np.abs(change).max() > NOTHING * np.abs(fitted.force_N).max()
        if change is not None and (acts or not effect.missing(fitted.data)):
            found[effect.key], _ = absorbed.of_modulus(absorbed.padded(change))
    return found


def limits(
    fitted: Fit,
    looked: Sequence[Effect],
    *,
    candidates: Sequence[str] = (),
    missing: Mapping[str, str],
    visible: Mapping[str, float],
) -> Limits:
    """Return what these data cannot show of the effects `looked` for, but for `candidates`.

    An effect cannot be detected for want of data (`missing` says why) or because it would show only at a size that
    no rig has.
    """
    effects = [e for e in looked if e.key not in candidates]
    missing = {key: why for key, why in missing.items() if key not in candidates}
    small = {e.key: e for e in effects if e.key not in missing and largest(e) < visible.get(e.key, 0.0)}
    why = {**missing, **{key: _too_small(effect, visible[key]) for key, effect in small.items()}}
    ends = {key: largest(effect) for key, effect in small.items()}
    shown = [e for e in effects if e.key in visible and e.key not in why]
    return Limits(
        not_testable=why,
        possible_bias=possible_bias(fitted, [e for e in effects if e.key in why], sizes=ends),
        visible=visible,
        sizes={e.key: e.parameters[0] for e in looked},
        below_visibility=possible_bias(fitted, shown, sizes=visible),
    )


def _too_small(effect: Effect, size: float) -> str:
    if not np.isfinite(size):
        return "the model absorbs it: these data cannot distinguish it from the model's own parameters"
    unit = "" if effect.parameters[0].unit == "1" else f" {effect.parameters[0].unit}"
    return f"it would show from {size:.2g}{unit} on, and is hardly ever larger than {largest(effect):.2g}{unit}"


def change_of_force(fitted: Fit, effect: Effect, *, own: Floats) -> Floats | None:
    """Return what an effect of these values adds to the fit's force (N,).

    None where it is in the model already, or cannot be computed on these data.
    """
    if effect.key in fitted.model.keys:
        return None
    try:
        with np.errstate(all="ignore"):
            return added_force(fitted, effect, own, effect.supposed(fitted.data))
    except (Exception, SystemExit):  # an effect without its covariate may raise anything
        return None


def added_force(fitted: Fit, effect: Effect, own: Floats, data: Observations) -> Floats:
    """Return what an effect of values `own` (p,) adds to the fit's force (N,), N, on these data.

    Raises InputError for forces that are none.
    """
    model = fitted.model + effect
    place = model.slices_of(fitted.values.size + own.size)[effect.key].start
    values = np.insert(fitted.values, [place] * own.size, own)
    force = np.asarray(model.predict(values, data))
    faults = {
        "returns one force a sample": force.shape != fitted.force_N.shape,
        "returns real forces": np.iscomplexobj(force),
        "returns finite forces": not np.isfinite(force).all(),
    }
    for words in (words for words, wrong in faults.items() if wrong):
        raise InputError(f"an effect {words}", where=effect.key, value=own.tolist())
    return as_it_holds(fitted, model, values, force - fitted.force_N)


def as_it_holds(fitted: Fit, model: Model, values: Floats, change_N: Floats) -> Floats:
    """Return a change (N,), N, of the fit's force by `model` at these values (p,), with thresholds as in the fit.

    Otherwise the few samples that pass a threshold would dominate a change that is small everywhere else.
    """
    for key in (e.key for e in fitted.model.effects if e.asks_readings):
        before = fitted.force_N - force_without(fitted.model, fitted.values, fitted.data, key=key)
        after = fitted.force_N + change_N - force_without(model, values, fitted.data, key=key)
        passed = np.abs(after - before) > np.maximum(np.abs(after), np.abs(before)) / 2
        change_N = np.where(passed, change_N - (after - before), change_N)
    return change_N


def force_without(model: Model, values: Floats, data: Observations, *, key: str) -> Floats:
    """Return the force (N,), N, of the model without one effect, at the same values (p,) of all others."""
    return np.asarray(model.without(key).predict(np.delete(values, model.slices(data)[key]), data))


# Bayesian model averaging of E's interval over effects that may be there without being detected.
#
# An effect of first parameter s outside the model moves E by b s, and has the score z in its own std sigma:
#
#     p(s | data) ~ pi N(s; 0, tau^2) exp(z s/sigma - s^2/(2 sigma^2)),    E(s) = E exp(-b s)
#
# linear about the fit. At most one effect is there at a time, on a gel that slides or on one that sticks, each
# weighted by exp(-chi^2/2); tau is half of the effect's range, or its stated prior. The prior chance that one of
# the effects is there is one half, each as likely as any other; without any of them, what every rig has some of
# (an edge that is not stated) has its typical size as tau. The interval is never narrower than that of the fit.
# Source: Hoeting et al., Statistical Science 14 (1999) 382, eq. 1 to 3, with one parameter a model.

ANY = 0.5  # prior chance that a rig has an unknown effect
NODES = 41  # sizes of an effect, of equal weight


@dataclass(frozen=True, slots=True)
class UndetectedEffect:
    """An effect that may be there: its chance given the data, and the rms of its relative bias of E."""

    key: str
    chance: float
    off: float


@dataclass(frozen=True, slots=True)
class _Part:
    """E with an effect ("" for none) of several sizes.

    `log_weight` (k,), `added` (k,) the shifts of log E, `without` log E without the effect, `std` relative.
    """

    key: str
    log_weight: Floats
    added: Floats
    without: float = 0.0
    std: float = 0.0

    @property
    def shift(self) -> Floats:
        """log E (k,)."""
        return self.without + self.added


def average_models(
    modulus: Estimate, fitted: Fit, *, effects: Sequence[Effect]
) -> tuple[Estimate, tuple[UndetectedEffect, ...]]:
    """Return E with its interval averaged over `effects`, and the effects ranked by the variance that they add.

    E without a value stays unchanged.
    """
    if modulus.value is None or modulus.interval95 is None:
        return modulus, ()
    # a gel that sticks is a law of its own
    others = [e for e in effects if e.condition != STICKING]
    looked = [e for e in others if e.key not in fitted.model.keys and not e.absent(fitted.data)]
    parts = [part for one, found in _laws(fitted, modulus) for part in _parts(one, found, looked, modulus.value)]
    if not parts:
        return modulus, ()
    log_weight, shift = (np.concatenate([getattr(p, name) for p in parts]) for name in ("log_weight", "shift"))
    top = float(log_weight.max())
    weight = np.exp(log_weight - top)
    std = np.concatenate([np.full(p.shift.size, p.std) for p in parts])
    ends = (mixture_quantile(share, weight / weight.sum(), shift, std) for share in TAILS95)
    low, high = (modulus.value * float(np.exp(end)) for end in ends)
    reach = min(low, modulus.interval95[0]), max(high, modulus.interval95[1])
    return replace(modulus, interval95=reach), _ranked(parts, top + float(np.log(weight.sum())))


def _laws(fitted: Fit, modulus: Estimate) -> list[tuple[Fit, Estimate]]:
    """Return the fit, and the same on a gel that sticks where that can be fitted, each with its E."""
    try:
        other = stuck(fitted)
    except CANNOT_FIT:
        other = None
    return [(fitted, modulus)] if other is None else [(fitted, modulus), (other, identify(other).youngs_modulus)]


def _parts(fitted: Fit, found: Estimate, effects: Sequence[Effect], about_MPa: float) -> list[_Part]:
    """Return a part for no effect and for each start of each; nothing where E has no value in this fit."""
    if found.value is None or not found.std:
        return []
    space, chance = _Space(at_denoised_depth(fitted)), ANY / max(len(effects), 1)
    std, own = found.std / found.value, np.log(found.value / about_MPa)
    usual = [effect for effect in effects if effect.to_be_expected(fitted.data)]
    rivals = [one for effect in effects if effect not in usual for one in space.rivals(effect, chance)]
    rest = 1 - chance * len({one.key for one in rivals})
    expected = [one for effect in usual for one in space.rivals(effect, rest / len(usual))]
    parts = [*rivals, *(expected or [_Part("", np.log([rest]), np.zeros(1))])]
    return [replace(p, log_weight=p.log_weight - fitted.chi2 / 2, without=own, std=std) for p in parts]


class _Space:
    """Linearisation of a fit, whitened, with its priors, and the score of a change of the force."""

    def __init__(self, fitted: Fit) -> None:
        held = fitted.at_bound.copy()
        held[fitted.index("youngs_modulus_MPa")] = False
        self._fitted, self._absorbed = fitted, Absorbed(fitted, fitted.free & ~held)
        mean = np.array([0.0 if p.prior is None else p.prior.mean for p in fitted.parameters])
        self._residual = self._absorbed.padded(fitted.residual_N, fitted.prior_weight * (mean - fitted.values))

    def rivals(self, effect: Effect, chance: float) -> list[_Part]:
        """Return a part for each start of the effect that changes the force; they share its chance."""
        changes = [
            (own, change)
            for own in _starts(effect, self._fitted)
            if (change := change_of_force(self._fitted, effect, own=own)) is not None
            and np.abs(change).max() > NOTHING * np.abs(self._fitted.force_N).max()
        ]
        return [self._rival(effect, own, change, chance / len(changes)) for own, change in changes]

    def _rival(self, effect: Effect, own: Floats, change_N: Floats, chance: float) -> _Part:
        per_size, seen = self._absorbed.of_modulus(self._absorbed.padded(change_N))
        size = _sizes(effect, own, self._fitted)
        gain = size * float(seen @ self._residual) - size**2 * float(seen @ seen) / 2
        return _Part(effect.key, np.log(chance / NODES) + gain, -per_size * size)


def _starts(effect: Effect, fitted: Fit) -> Floats:
    try:
        return np.atleast_2d(effect.starts(fitted.data))
    except Exception:  # for want of the covariate that it needs, anything
        return np.empty((0, len(effect.parameters)))


def _sizes(effect: Effect, own: Floats, fitted: Fit) -> Floats:
    """Return nodes (NODES,) of equal weight of the size's prior, in units of this start."""
    from scipy.special import ndtri

    first = effect.parameters_on(fitted.data)[0]
    end = largest(effect) if np.isfinite(largest(effect)) else first.scale
    judged = typical(effect) if effect.to_be_expected(fitted.data) else end / 2
    std = judged if first.prior is None else first.prior.std
    start = abs(own[0] - first.default)
    one_sided = first.default in first.bounds
    share = (np.arange(NODES) + 0.5) / NODES
    return np.asarray(ndtri((1 + share) / 2 if one_sided else share) * (std / start if start > 0 else 1.0))


def _ranked(parts: Sequence[_Part], total: float) -> tuple[UndetectedEffect, ...]:
    """Return the effects by the variance of E that they add; `total` is the log of all weights."""
    found = []
    for key in dict.fromkeys(part.key for part in parts if part.key):
        mine = [part for part in parts if part.key == key]
        weight = np.exp(np.concatenate([part.log_weight for part in mine]) - total)
        chance = float(weight.sum())
        squares = float(weight @ np.concatenate([part.added for part in mine]) ** 2)
        found.append(UndetectedEffect(key, chance, float(np.sqrt(squares / chance)) if chance > 0 else 0.0))
    return tuple(sorted(found, key=lambda one: -one.chance * one.off**2))
