"""What a person can do about an effect without many presses: a direct look at it, and how sharp that look is.

A check settles one effect by itself: an amplitude `a` that it measures to `std` is told from none by a/std. For
effects that these data cannot show, the check that takes most off E's possible bias in a minute comes first. What
no effect explains is followed by way of what it depends on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from calibration.diagnosis.experiment_design import NextMeasurement
from calibration.diagnosis.refit import Candidate
from calibration.effects import EFFECTS
from calibration.model.stages import Effect, ManualCheck

NAN = float("nan")
MIN_BIAS = 0.002  # of E: less is not worth a look
_OTHER_PUNCH = ManualCheck(
    "press the same depths with a punch of another radius: does it follow depth or force?", 10.0
)
FOLLOW: Mapping[str, ManualCheck] = {
    **dict.fromkeys(("w", "w/h", "1/w", "P"), _OTHER_PUNCH),
    "t": ManualCheck("leave a dead weight on the force sensor for a minute: does its reading creep?", 3.0),
    "load/unload": ManualCheck("go down and up in steps, and wait at each: do the two ways meet?", 5.0),
    "scatter while loading": ManualCheck("wet the punch with soapy water: does the force still jump?", 5.0),
    "log rate": ManualCheck("repeat one press at five speeds", 8.0),
    "wait": ManualCheck("vary the waits from 3 s to 10 min", 25.0),
    "T": ManualCheck("press once with the gel five degrees warmer", 30.0),
    **dict.fromkeys(
        ("x", "y", "azimuth"), ManualCheck("turn the gel by 90 degrees: does it turn with the gel?", 10.0)
    ),
    **dict.fromkeys(("Fx", "Fy"), ManualCheck("turn the force sensor by 90 degrees and press again", 10.0)),
    **dict.fromkeys(("a", "indenter"), ManualCheck("measure each indenter's face and edge", 10.0)),
    **dict.fromkeys(
        ("order", "recording date"), ManualCheck("repeat the first press: is it still the same?", 3.0)
    ),
}


def check_of(effect: Effect) -> ManualCheck | None:
    """What a person can do about it, as the effect states it."""
    return getattr(effect, "check", None)


def of_candidates(group: Sequence[Candidate]) -> list[NextMeasurement]:
    """Checks of the candidates of a set, each with how far it would tell the amplitude found from none."""
    found = []
    for one in group:
        check = check_of(one.effect)
        if check is not None and np.isfinite(check.std):
            size = abs(float(one.own_values[0]) - one.effect.parameters[0].default)
            found.append(NextMeasurement(check.action, check.minutes, size / check.std))
    return found


def of_left(covariates: Iterable[str]) -> list[NextMeasurement]:
    """What to do about something that depends on these covariates, the most telling first."""
    checks = dict.fromkeys(FOLLOW[name] for name in covariates if name in FOLLOW)
    return [NextMeasurement(check.action, check.minutes, NAN) for check in checks]


def of_hidden(bias: Mapping[str, float]) -> list[NextMeasurement]:
    """Checks of effects that these data cannot show, what takes most off E's possible bias in a minute first."""
    checks = {key: check_of(EFFECTS[key]) for key in bias if key in EFFECTS}
    worth = {check: abs(bias[key]) for key, check in checks.items() if check and abs(bias[key]) > MIN_BIAS}
    ranked = sorted(worth, key=lambda check: -worth[check] / check.minutes)
    return [NextMeasurement(check.action, check.minutes, NAN) for check in ranked]
