"""The way in as a ruler: travel since first contact against the heights at which the bevels touch.

    z_i = alpha w_i + s P_i + b t_i + delta + e_i

z_i is the travel of press i from the zero of force to the touch that was seen (by the stage, else stated speed
times time), w_i the depth that its bevel certifies, P_i the force then; alpha is the speed's scale, 1 for a
stage, s the give of the rig, delta what all touches were seen early or late by, e_i what each was by itself. t_i
is what the tilt that the camera reads of its face, against the usual one, would lower the bevel by; b, between 0
and 1 or so, how far that reading is to be believed. A rig that comes at one pace makes z a measure of depth
whose zero is the gel's surface. delta does not grow with the depth, so heights that differ tell it apart from
alpha: it is held by what the shape of the growing dent leaves open, s by how stiff rigs are. The force is then
read where the ruler puts the depth, alpha w_i + s P_i, in all presses alike.

Generalised least squares. Where touches scatter by more than they should, as under faces that lean by more than
the camera sees, what each is off by is taken to be as much larger as makes chi-square right (Birge, Phys. Rev. 40
(1932) 207), what all share is not. Where it is larger by far, and nothing else says that the rig came at one pace
(or at paces in proportion to the stated ones), there is no ruler. Lengths in mm, forces in N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.records import Bools, Floats
from tactilevision.robust import mad_std

GIVE_MM_PER_N = 0.005  # one sigma: rigs with their force sensors stand at 200 N/mm or so
STAGE_STD = 0.005  # of a motion stage's scale
_LEAST, _HEIGHTS = 3, 2  # presses, and heights among them, where the scale is not known beforehand
_TRUST = 1.0  # one sigma of b
_TURNS = 8  # of widening, until chi-square is what it should be
_SPREAD = 0.25  # of the largest depth that the heights must differ by
_OUT = 4.0  # sigmas beyond which a touch was no touch
_CROOKED = 9.0  # chi-square per degree of freedom beyond which ramps not known to be even are no ruler


@dataclass(frozen=True, slots=True)
class TravelPoint:
    """One touch on the ruler: `depth_mm` certified, `travel_mm` until it was seen, its own std, what all have
    together, the force there; `height` names what shares a machined height, `height_std_mm` of it; `lean_mm` what
    its tilt lowers the bevel by, as read; `zero_std_mm` of the travel's zero, part of what all have together.
    """

    depth_mm: float
    travel_mm: float
    own_std_mm: float
    shared_std_mm: float
    force_N: float
    height: str
    height_std_mm: float
    lean_mm: float = 0.0
    zero_std_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class TravelScale:
    """alpha, s, b and their covariance (3, 3); `used` marks (N,); `late_mm` and its std: the touches' delta.

    `zero_std_mm`: what all depths read on it are off by alike, since its zero is.
    """

    alpha: float
    give_mm_per_N: float
    covariance: Floats
    used: Bools
    late_mm: float
    late_std_mm: float
    zero_std_mm: float

    def travel_mm(self, depth_mm: float, force_N: float) -> float:
        """Where the ruler puts a depth."""
        return self.alpha * depth_mm + self.give_mm_per_N * force_N

    def relative_std(self, stiffness_N_per_mm: float) -> float:
        """Of all its depths alike, where the force grows with this stiffness at first."""
        slope = np.array([1.0, stiffness_N_per_mm, 0.0])
        whole = self.alpha + self.give_mm_per_N * stiffness_N_per_mm
        return float(np.sqrt(slope @ self.covariance @ slope)) / whole


def fit_travel_scale(
    marks: Sequence[TravelPoint], *, scale: float | None = None, even: bool = False
) -> TravelScale | None:
    """The ruler of these touches; None where they are too few, too much alike, or do not lie on one.

    `scale` is alpha where it is known, to STAGE_STD; `even` says that forces follow one law of the travel.
    """
    used = np.ones(len(marks), dtype=bool)
    while True:
        chosen = [mark for mark, use in zip(marks, used, strict=True) if use]
        depths = [mark.depth_mm for mark in chosen]
        if not chosen:
            return None
        few = len(chosen) < _LEAST or len({mark.height for mark in chosen}) < _HEIGHTS
        if scale is None and (few or np.ptp(depths) < _SPREAD * max(depths)):
            return None
        ruler, apart = _solve(chosen, used, scale, np.inf if even else _CROOKED)
        worst = int(np.abs(apart).argmax())
        if abs(apart[worst]) < _OUT:
            return ruler
        used[np.flatnonzero(used)[worst]] = False


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """alpha, s, b, their covariance (3, 3), the touches' (N, N); residuals made white, chi-square per freedom."""

    answer: Floats
    inverse: Floats
    design: Floats
    held: Floats
    covariance: Floats
    weighed: Floats
    apart: Floats
    birge: float


def _solve(
    marks: Sequence[TravelPoint], used: Bools, scale: float | None, limit: float
) -> tuple[TravelScale | None, Floats]:
    """The ruler, and how far each touch lies from what the others say of it, in sigmas of the usual scatter."""
    found = _least_squares(marks, scale, 1.0)
    usual = max(mad_std(found.apart, centre=0.0), 1.0)
    apart = found.apart / usual
    if found.birge > limit and float(np.abs(apart).max()) < _OUT:
        return None, np.zeros(len(marks))
    scatter = 1.0
    for _ in range(_TURNS):
        if found.birge <= 1:
            break
        scatter *= float(np.sqrt(found.birge))
        found = _least_squares(marks, scale, scatter)
    pace = _pace(marks)
    shared = np.array([mark.shared_std_mm for mark in marks])
    late = float(shared @ found.weighed) * float(np.median(shared)) / pace
    late_std = _late_std(found.covariance, found.design, found.held, shared) / pace
    zero = float(np.median([mark.zero_std_mm for mark in marks])) / pace
    alpha, give, _ = (float(value) for value in found.answer)
    return TravelScale(
        alpha, give, found.inverse * max(found.birge, 1.0), used.copy(), late, late_std, zero
    ), apart


def _pace(marks: Sequence[TravelPoint]) -> float:
    """Travel over depth, roughly."""
    return float(np.median([mark.travel_mm / mark.depth_mm for mark in marks]))


def _least_squares(marks: Sequence[TravelPoint], scale: float | None, scatter: float) -> _Solution:
    """With what each touch and each height is off by taken `scatter` times as large as stated."""
    depth, travel, own, shared, force, height_std, lean = np.array(
        [
            (m.depth_mm, m.travel_mm, m.own_std_mm, m.shared_std_mm, m.force_N, m.height_std_mm, m.lean_mm)
            for m in marks
        ]
    ).T
    alike = np.array([[a.height == b.height for a in marks] for b in marks])
    pace = _pace(marks)
    apart = np.diag(own**2) + alike * np.outer(height_std, height_std) * pace**2
    covariance = scatter**2 * apart + np.outer(shared, shared)
    weight = np.linalg.inv(covariance)
    design = np.column_stack([depth, force, lean])
    expected = np.array([scale or 0.0, 0.0, 0.0])
    held = np.array(
        [0.0 if scale is None else (scale * STAGE_STD) ** -2, (pace * GIVE_MM_PER_N) ** -2, (pace * _TRUST) ** -2]
    )
    inverse = np.linalg.inv(design.T @ weight @ design + np.diag(held))
    answer = inverse @ (design.T @ weight @ travel + held * expected)
    residual = travel - design @ answer
    square = float(residual @ weight @ residual) + float(held @ (answer - expected) ** 2)
    # what each touch is off by, given all others: the covariance's inverse knows it (leave-one-out)
    weighed = weight @ residual
    return _Solution(answer, inverse, design, held, covariance, weighed, weighed / np.sqrt(np.diag(weight)),
                     square / max(len(marks) - (scale is None), 1))  # fmt: skip


def _late_std(covariance: Floats, design: Floats, held: Floats, shared: Floats) -> float:
    """Std of delta, by the joint fit of alpha, s, b and delta."""
    rest = np.linalg.inv(covariance - np.outer(shared, shared))
    whole = np.column_stack([design, np.ones(len(shared))])
    normal = whole.T @ rest @ whole + np.diag([*held, float(np.median(shared)) ** -2])
    return float(np.sqrt(np.linalg.inv(normal)[-1, -1]))
