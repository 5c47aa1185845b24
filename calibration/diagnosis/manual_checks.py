"""What a person can do about an effect without many presses: a direct look at it, and how sharp that look is.

A check settles one effect by itself: an amplitude `a` that it measures to `std` is told from none by a/std. For
effects that these data cannot show, the check that takes most off E's possible bias in a minute comes first. What
no effect explains is followed by way of what it depends on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.diagnosis.experiment_design import NextMeasurement
from calibration.diagnosis.refit import Candidate

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Check:
    """An action, its minutes, and the std with which it shows the effect's first parameter; NaN where it takes
    presses that the data themselves must be asked about.
    """

    action: str
    minutes: float
    std: float = NAN


CHECKS: Mapping[str, Check] = {
    "force_gain": Check("put a dead weight on the force sensor", 5.0, 0.003),
    "force_bias": Check("read the force sensor with the punch in air, before and after each press", 3.0, 0.004),
    "force_crosstalk": Check("turn the force sensor by 90 degrees and press again", 10.0, 0.005),
    "clock_offset": Check("tap the sensor ten times: which moves first, picture or force?", 3.0, 0.005),
    "backing_compliance": Check("press on the bare backing", 10.0, 0.001),
    "bevel_rise": Check("use an indenter whose bevel stands at another distance", 15.0, 0.3),
    "photometric_gain": Check(
        "press a gauge or a ball of known depth beside the camera's own reading", 10.0, 0.01
    ),
    "photometric_drift": Check("press the same gauge first and last, and on each day", 10.0, 0.01),
    "slope_saturation": Check("press balls of two sizes: are the steep ones read too flat?", 10.0, 0.1),
    "thickness": Check("measure the gel's thickness at its rim", 5.0, 0.02),
    "thickness_wedge": Check("measure the gel's thickness at four places of its rim", 8.0, 0.003),
    "tilt": Check("turn the punch by 180 degrees and press again", 5.0, 0.003),
    "edge_fillet": Check("look at the punch's edge through a magnifier", 5.0, 0.05),
    "friction": Check("wet the punch with soapy water and press again", 10.0, 0.15),
    "temperature": Check("write down the gel's temperature at each press", 1.0),
    "viscoelasticity": Check("hold a press for 25 s", 3.0),
    "adhesion": Check("unload slowly until the punch lets go", 4.0),
    "lateral_boundary": Check("press at +-6 mm in x and y", 10.0),
    "recovery": Check("vary the waits from 3 s to 10 min", 25.0),
    "ageing": Check("repeat the presses in a month", 10.0),
}
MIN_BIAS = 0.002  # of E: less is not worth a look
_OTHER_PUNCH = Check("press the same depths with a punch of another radius: does it follow depth or force?", 10.0)
FOLLOW: Mapping[str, Check] = {
    **dict.fromkeys(("w", "w/h", "1/w", "P"), _OTHER_PUNCH),
    "t": Check("leave a dead weight on the force sensor for a minute: does its reading creep?", 3.0),
    "load/unload": Check("go down and up in steps, and wait at each: do the two ways meet?", 5.0),
    "scatter while loading": Check("wet the punch with soapy water: does the force still jump?", 5.0),
    "log rate": Check("repeat one press at five speeds", 8.0),
    "wait": Check("vary the waits from 3 s to 10 min", 25.0),
    "T": Check("press once with the gel five degrees warmer", 30.0),
    **dict.fromkeys(("x", "y", "azimuth"), Check("turn the gel by 90 degrees: does it turn with the gel?", 10.0)),
    **dict.fromkeys(("Fx", "Fy"), CHECKS["force_crosstalk"]),
    **dict.fromkeys(("a", "indenter"), Check("measure each indenter's face and edge", 10.0)),
    **dict.fromkeys(("order", "recording date"), Check("repeat the first press: is it still the same?", 3.0)),
}


def of_candidates(group: Sequence[Candidate]) -> list[NextMeasurement]:
    """Checks of the candidates of a set, each with how far it would tell the amplitude found from none."""
    found = []
    for one in group:
        check = CHECKS.get(one.effect.key)
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
    worth = {CHECKS[key]: abs(share) for key, share in bias.items() if key in CHECKS and abs(share) > MIN_BIAS}
    ranked = sorted(worth, key=lambda check: -worth[check] / check.minutes)
    return [NextMeasurement(check.action, check.minutes, NAN) for check in ranked]
