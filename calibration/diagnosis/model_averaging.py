"""Bayesian model averaging of E's interval over effects that may be there without being detected.

An effect of first parameter s outside the model moves E by b s, and has the score z in its own std sigma:

    p(s | data) ~ pi N(s; 0, tau^2) exp(z s/sigma - s^2/(2 sigma^2)),    E(s) = E exp(-b s)

linear about the fit. At most one effect is there at a time, on a gel that slides or on one that sticks, each
weighted by exp(-chi^2/2); tau is half of the effect's range, or its stated prior. The prior chance that one of the
effects is there is one half, each as likely as any other; without any of them, what every rig has some of (an edge
that is not stated) has its typical size as tau. The interval is never narrower than that of the fit alone.
Source: Hoeting et al., Statistical Science 14 (1999) 382, eq. 1 to 3, with one parameter a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT
from calibration.diagnosis.sensitivity import (
    NOTHING,
    Absorbed,
    change_of_force,
    largest,
    typical,
)
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.identifiability import identify, stuck
from calibration.fit.least_squares import Fit
from calibration.model.stages import STICKING, Effect
from tactilevision.records.constants import TAILS95
from tactilevision.records.measured import Estimate, Floats

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
    ends = (_quantile(share, weight / weight.sum(), shift, std) for share in TAILS95)
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
        self._fitted, self._modulus = fitted, fitted.index("youngs_modulus_MPa")
        free = fitted.free & (~fitted.at_bound | (np.arange(fitted.free.size) == self._modulus))
        self._absorbed = Absorbed(fitted, free)
        mean = np.array([0.0 if p.prior is None else p.prior.mean for p in fitted.parameters])
        pull = self._absorbed.known * (mean - fitted.values)[free]
        self._residual = np.concatenate([self._absorbed.white(fitted.residual_N), pull])

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
        absorbed, fitted = self._absorbed, self._fitted
        target = absorbed.padded(change_N)
        moved = absorbed.moved(target)
        seen = target - absorbed.rows @ moved
        size = _sizes(effect, own, fitted)
        gain = size * float(seen @ self._residual) - size**2 * float(seen @ seen) / 2
        per_size = float(moved[absorbed.row_of(self._modulus)]) / fitted.values[self._modulus]
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


def _quantile(share: float, weight: Floats, shift: Floats, std: Floats) -> float:
    """Return a quantile of a mixture of normals."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    low, high = float(np.min(shift - 12 * std)), float(np.max(shift + 12 * std))
    return float(brentq(lambda x: float(weight @ ndtr((x - shift) / std)) - share, low, high))


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
