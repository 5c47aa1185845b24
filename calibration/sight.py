"""The picture's depth against the certified one: is the height map right, and where is it not?

    seen = f(w) + z + s(w) (u_0 + u_1 x),    f = w where nothing is wrong

w the certified depth, z the zero of the height map, s its own std behind a punch's steep walls, which all presses
of a depth share: u_0, u_1 ~ N(0, 1) let it be off by that much, alike or growing over the depths (x from -1 to
1). Press by press the picture has a gain and a zero of its own, as a force sensor has: the same error model,
screen and search as for forces then work on lengths, with the seen depth in the force's place. What can be found:
a wrong gain, a drift, slopes that saturate, a certified depth that forgot how far the gel rises.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calibration.data import Observations
from calibration.effects.bevel_rise import TYPICAL_RISE, BevelRise
from calibration.effects.photometric_drift import PhotometricDrift
from calibration.effects.photometric_gain import PhotometricGain
from calibration.effects.slope_saturation import SlopeSaturation
from calibration.fitting import Fit, fit
from calibration.model import Composable, Model
from calibration.parameters import Parameter, Prior
from calibration.pure_noise import refit_with_pure_noise
from calibration.refit import Candidate
from calibration.stages import Effect, Stage, State
from tactilevision.records import Floats

FEWEST = 4  # samples: fewer leave nothing to hold against each other
ZERO_STD_MM = 0.005  # of a height map's zero, where single depths cannot tell it from a gain


@dataclass(frozen=True, slots=True)
class Sight(Composable):
    """The law: what is seen is what was certified, but for a zero and what the height map says of itself."""

    @property
    def key(self) -> str:
        """The name in a model."""
        return "reconstructed_depth"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """z, then u_0 and u_1 where the height map states a std."""
        prior = None if data.is_curves else Prior(0.0, ZERO_STD_MM, "a height map's zero")
        table = [Parameter("zero_mm", "mm", 0.0, (-0.2, 0.2), "seen where nothing is pressed", 0.005, prior)]
        if _stated(data) is not None:
            table += [Parameter(f"walls_{k}", "1", 0.0, (-8.0, 8.0), "error of the face, in its own std", 1.0,
                                Prior(0.0, 1.0, "the height map's own std")) for k in range(2)]  # fmt: skip
        return tuple(table)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The seen depth in the force's place."""
        seen, stated = state.depth_mm + values[0], _stated(data)
        if stated is not None:
            seen = seen + stated * (values[1] + values[2] * _across(data.depth_mm))
        return replace(state, force_N=seen, stiffness_N_per_mm=np.ones(data.size))


class Seen(Effect, Protocol):
    """An effect that says what a picture makes of it."""

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """What the picture makes of true depths (N,)."""


@dataclass(frozen=True, slots=True)
class Sighted:
    """An effect of the catalogue as the picture shows it."""

    inner: Seen

    @property
    def key(self) -> str:
        """The catalogue's name."""
        return self.inner.key

    @property
    def stage(self) -> Stage:
        """True depth becomes seen depth."""
        return Stage.DEPTH

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The catalogue's; a rise that nobody took off is never below 0."""
        first, *rest = self.inner.parameters
        if self.key == "bevel_rise":
            first = replace(first, bounds=(0.0, 1.5))
        return (first, *rest)

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """The same, with what is known of a rise that was taken off already."""
        if self.key != "bevel_rise" or data.shared.rise == 0:
            return self.parameters
        first = self.inner.parameters[0]
        left = Prior(0.0, data.shared.rise / TYPICAL_RISE, "the rise was taken off; its std")
        return (replace(first, bounds=(-1.5, 1.5), prior=left),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """What the picture makes of the depth."""
        return replace(state, depth_mm=self.seen(state.depth_mm, values, data))

    def seen(self, depth_mm: Floats, values: Floats, data: Observations) -> Floats:
        """The same for the depth alone."""
        return self.inner.seen(depth_mm, values, data)

    def missing(self, data: Observations) -> str:
        """Why these depths cannot show it."""
        if self.key == "photometric_drift":
            if not np.isfinite(data.time_s).all() or np.ptp(data.time_s) <= 0 or data.count < 3:
                return "needs times of several presses"
        elif self.key == "slope_saturation" and _stated(data) is not None:
            return "behind a punch's walls the height map's own std covers it; balls would show it"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        if self.key == "bevel_rise":
            return np.array([[0.1], [1.0]])
        return self.inner.starts(data)


def sighted() -> tuple[Sighted, ...]:
    """The effects that the picture's depth can show."""
    return tuple(
        Sighted(effect) for effect in (BevelRise(), PhotometricGain(), PhotometricDrift(), SlopeSaturation())
    )


def sight_of(data: Observations) -> Observations | None:
    """The samples in contact with both depths, the picture's in the force's place; None where they are too few."""
    if data.reconstructed_mm is None:
        return None
    usable = np.isfinite(data.reconstructed_mm) & (data.depth_mm > 0)
    if np.count_nonzero(usable) < FEWEST:
        return None
    both = data.samples(usable)
    assert both.reconstructed_mm is not None
    nothing = np.full(both.size, np.nan)
    presses = replace(both.presses, speed_mm_s=np.full(both.count, np.nan))  # a picture knows no rate
    return replace(
        both.with_force(both.reconstructed_mm), force_std_N=nothing, depth_std_mm=nothing, presses=presses
    )


def fit_sight(data: Observations) -> Fit | None:
    """The law of `Sight` on these measurements, with the noise of repeats; None where no picture gave a depth."""
    both = sight_of(data)
    return None if both is None else refit_with_pure_noise(fit(Model(Sight()), both))


def depth_ratio(fitted: Fit) -> Floats:
    """Seen over certified depth (N,)."""
    return np.asarray(fitted.data.normal_N / fitted.data.depth_mm)


def risen(candidate: Candidate, data: Observations) -> float:
    """The share of the certified depths (their median) that a fitted bevel_rise takes off."""
    assert isinstance(candidate.effect, Sighted)
    left = candidate.effect.seen(np.ones(data.size), candidate.own_values, data)
    return float(1 - np.median(left))


def _stated(data: Observations) -> Floats | None:
    """The height map's own std of the face (N,), where it is known throughout; smooth over the depth, since all
    presses share it.
    """
    std = data.reconstructed_std_mm
    if std is None or not (np.isfinite(std).all() and (std > 0).all()):
        return None
    degree = 1 if np.ptp(data.depth_mm) > 0.1 * np.max(data.depth_mm) else 0
    line = np.polynomial.Polynomial.fit(data.depth_mm, std / data.depth_mm, degree)
    return np.asarray(data.depth_mm * np.maximum(line(data.depth_mm), 0.5 * np.min(std / data.depth_mm)))


def _across(depth_mm: Floats) -> Floats:
    low, high = float(depth_mm.min()), float(depth_mm.max())
    return np.asarray(2 * (depth_mm - low) / (high - low) - 1 if high > low else np.zeros(depth_mm.size))
