"""One odd ball among few: the law that it helped to make leans to it, so that it hides.

Each suspect is left out of all that judges it:

    z = (ln g - ln m) / (s^2 + u^2 + (r d)^2)^(1/2)

g is its scale of slope by a law of all others; m and s the median and the scatter (ln) of the others' own scales,
each by a law that lacks its group of three as well; u what these laws scatter about the suspect, a jackknife that
deletes a group at a time: u^2 = (2/3) sum (ln g_k - mean)^2 (Efron, The Jackknife, the Bootstrap, SIAM 1982); d
how far it lies beyond the others in half pictures, r what their law loses there. None else has a unit.
Assumes one odd ball.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactilevision.photometric.ball.cross_validation import (
    FOLDS,
    Fitter,
    beyond_others,
    gains_of,
    held_out,
)
from tactilevision.photometric.ball.samples import Samples
from tactilevision.robust import mad_std

MIN_OTHERS = 9  # balls: the scatter of fewer is not known
MIN_SCATTER = 0.02  # of the scale: few balls may agree better by chance
MAX_OFF = 1.1  # of ln g: no one states a radius three times; a law that is as far off fails itself
LOST_BEYOND = 1.0  # of the scale for each half picture; eight sets have .3 to 1.4: real_frames.md
STANDS_OUT = 4.0  # deviations: sound balls come to 3 at most; real_frames.md, one ball of ten


def second_look(
    suspects: Sequence[int], fit: Fitter, *, contact: Samples, untouched_samples: Samples, ridge: float
) -> dict[int, float]:
    """The scale of slope, found over expected, a ratio, of the one of `suspects` that stands out; {} for none.

    `suspects` are numbers of balls in `contact`; `fit` and `ridge` make the law.
    """
    if len(np.unique(contact.press)) <= MIN_OTHERS:
        return {}
    seen = {number: _judged(number, fit, contact, untouched_samples, ridge) for number in suspects}
    off, number = max(((abs(z), number) for number, (_, z) in seen.items()), default=(0.0, -1))
    return {number: float(np.exp(seen[number][0]))} if off > STANDS_OUT else {}


def _judged(
    number: int, fit: Fitter, contact: Samples, untouched_samples: Samples, ridge: float
) -> tuple[float, float]:
    """How far (ln) the scale at a ball is off what the others have, and z; zeros where it is beyond MAX_OFF."""
    suspect = contact.press == number
    ball, others = contact.where(suspect), contact.where(~suspect)
    resting = untouched_samples.where(untouched_samples.press != number)
    slopes, laws = held_out(fit, others, untouched_samples=resting, ridge=ridge)
    law = fit(others, resting, ridge=ridge)
    scale, *parts = (_ln(gains_of(one.at(ball.change, ball.place), ball)[number]) for one in (law, *laws))
    usual = np.array([_ln(gain) for gain in gains_of(slopes, others).values()])
    off = scale - float(np.median(usual))
    if abs(off) > MAX_OFF:
        return 0.0, 0.0
    beyond = LOST_BEYOND * beyond_others(contact, np.array([number]))[number]
    spread = (FOLDS - 1) * float(np.var(parts))  # the mean of three squares, times two
    return off, off / float(np.sqrt(max(mad_std(usual), MIN_SCATTER) ** 2 + spread + beyond**2))


def _ln(gain: float) -> float:
    return float(np.log(max(gain, 1e-3)))
