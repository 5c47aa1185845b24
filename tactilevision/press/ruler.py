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

Generalised least squares; the covariance grows by chi-square per degree of freedom where touches scatter by more
than they should (Birge, Phys. Rev. 40 (1932) 207), and where that is by far there is no ruler. Assumes one pace
on the way in, or paces in proportion to the stated ones. Lengths in mm, forces in N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.records import Bools, Floats

GIVE_MM_PER_N = 0.005  # one sigma: rigs with their force sensors stand at 200 N/mm or so
STAGE_STD = 0.005  # of a motion stage's scale
_LEAST, _HEIGHTS = 3, 2  # presses, and heights among them, where the scale is not known beforehand
_TRUST = 1.0  # one sigma of b
_SPREAD = 0.25  # of the largest depth that the heights must differ by
_OUT = 4.0  # sigmas beyond which a touch was no touch
_CROOKED = 9.0  # chi-square per degree of freedom beyond which the ramps are no ruler


@dataclass(frozen=True, slots=True)
class Mark:
    """One touch on the ruler: `depth_mm` certified, `travel_mm` until it was seen, its own std, what all have
    together, the force there; `height` names what shares a machined height, `height_std_mm` of it; `lean_mm` what
    its tilt lowers the bevel by, as read.
    """

    depth_mm: float
    travel_mm: float
    own_std_mm: float
    shared_std_mm: float
    force_N: float
    height: str
    height_std_mm: float
    lean_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Ruler:
    """alpha, s, b and their covariance (3, 3); `used` marks (N,); `late_mm` and its std: the touches' delta."""

    alpha: float
    give_mm_per_N: float
    covariance: Floats
    used: Bools
    late_mm: float
    late_std_mm: float

    def travel_mm(self, depth_mm: float, force_N: float) -> float:
        """Where the ruler puts a depth."""
        return self.alpha * depth_mm + self.give_mm_per_N * force_N

    def relative_std(self, stiffness_N_per_mm: float) -> float:
        """Of all its depths alike, where the force grows with this stiffness at first."""
        slope = np.array([1.0, stiffness_N_per_mm, 0.0])
        whole = self.alpha + self.give_mm_per_N * stiffness_N_per_mm
        return float(np.sqrt(slope @ self.covariance @ slope)) / whole


def fit_ruler(marks: Sequence[Mark], *, scale: float | None = None) -> Ruler | None:
    """The ruler of these touches; None where they are too few, too much alike, or do not lie on one.

    `scale` is alpha where it is known, to STAGE_STD.
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
        ruler, apart = _solve(chosen, used, scale)
        worst = int(np.abs(apart).argmax())
        if abs(apart[worst]) < _OUT:
            return ruler
        used[np.flatnonzero(used)[worst]] = False


def _solve(marks: Sequence[Mark], used: Bools, scale: float | None) -> tuple[Ruler | None, Floats]:
    """The ruler, and how far each touch lies from what the others say of it, in sigmas of the usual scatter."""
    depth, travel, own, shared, force, height_std, lean = np.array(
        [(m.depth_mm, m.travel_mm, m.own_std_mm, m.shared_std_mm, m.force_N, m.height_std_mm, m.lean_mm)
         for m in marks]
    ).T  # fmt: skip
    alike = np.array([[a.height == b.height for a in marks] for b in marks])
    pace = float(np.median(travel / depth))
    covariance = np.diag(own**2) + np.outer(shared, shared) + alike * np.outer(height_std, height_std) * pace**2
    weight = np.linalg.inv(covariance)
    design = np.column_stack([depth, force, lean])
    expected = np.array([scale or 0.0, 0.0, 0.0])
    held = np.array([0.0 if scale is None else (scale * STAGE_STD) ** -2,
                     (pace * GIVE_MM_PER_N) ** -2, (pace * _TRUST) ** -2])  # fmt: skip
    inverse = np.linalg.inv(design.T @ weight @ design + np.diag(held))
    answer = inverse @ (design.T @ weight @ travel + held * expected)
    residual = travel - design @ answer
    square = float(residual @ weight @ residual) + float(held @ (answer - expected) ** 2)
    birge = square / max(len(marks) - (scale is None), 1)
    # what each touch is off by, given all others: the covariance's inverse knows it (leave-one-out)
    weighed = weight @ residual
    apart = weighed / np.sqrt(np.diag(weight))
    usual = max(1.4826 * float(np.median(np.abs(apart))), 1.0)
    if birge > _CROOKED and float(np.abs(apart / usual).max()) < _OUT:
        return None, np.zeros(len(marks))
    late = float(shared @ weighed) * float(np.median(shared)) / pace
    late_std = _late_std(covariance, design, held, shared) / pace
    ruler = Ruler(float(answer[0]), float(answer[1]), inverse * max(birge, 1.0), used.copy(), late, late_std)
    return ruler, apart / usual


def _late_std(covariance: Floats, design: Floats, held: Floats, shared: Floats) -> float:
    """Std of delta, by the joint fit of alpha, s, b and delta."""
    rest = np.linalg.inv(covariance - np.outer(shared, shared))
    whole = np.column_stack([design, np.ones(len(shared))])
    normal = whole.T @ rest @ whole + np.diag([*held, float(np.median(shared)) ** -2])
    return float(np.sqrt(np.linalg.inv(normal)[-1, -1]))
