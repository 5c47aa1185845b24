"""How much of what no drift explains is gel that slopes beside a contact?

    left_c(b) = sum_n a_n J_c(b) u(b) exp(-d(b) / L_n)

d is a block's distance from the contact, u the direction away from it, J (3, 2) what a slope makes of colours. The
lengths L_n are parts of the contact's radius, that of a circle of its area; they are spread so widely that gels of
all thicknesses lie between them. The three a_n are fitted to the untouched blocks by iteratively reweighted least
squares. A lamp that was moved, daylight or a shift have no such pattern about the contact, and nothing has one
where there is no contact.

Measured on a renderer that shares no code with the library, lamps at 13 to 30 degrees: 16 flat faces of .12 to .46
mm leave 1 to 7.6 times the usual misfit as they are, .7 to 2.3 times without their slopes; lamps turned by 3
degrees or more leave 3.3 to 40 times where a face is pressed.
"""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.distance import distance_px
from tactilevision.photometric.illumination.drift import MEDIAN_LENGTH, Drift, DriftTracker, solid
from tactilevision.records import Bools, Floats
from tactilevision.robust import median

LENGTHS = (0.25, 0.5, 1.0)  # of the contact's radius, over which slopes beside it die out
ROUNDS = 3  # of reweighting; ten move the misfit by at most .06 of it
WIDTH = 3.0  # deviations from which a block counts less


def misfit_beside(drift: Drift, tracker: DriftTracker) -> float:
    """The misfit of a `drift` that `tracker` measured last, without the gel's slopes beside contacts; no unit.

    As it is where there is no contact, and where no ball has told what slopes do.
    """
    usable = tracker.usable
    contact = solid(~drift.untouched & usable.reshape(drift.untouched.shape))
    answers = tracker.slope_effects
    if drift.left is None or answers.shape[1] != 2 or not contact.any():
        return drift.misfit
    patterns = np.einsum("ckb,nkb->ncb", answers, _away(contact))
    beside = usable & ~contact.ravel()
    squares = _without(drift.left, patterns, beside)
    return min(drift.misfit, float(np.sqrt(median(squares[usable]))))


def _away(contact: Bools) -> Floats:
    """Slopes (lengths, 2, blocks) away from a `contact` (h, w), 1 at its rim."""
    distance = distance_px(~contact).astype(np.float64)
    down, across = np.gradient(cv2.GaussianBlur(distance, (0, 0), 1.0))
    direction = np.stack([across, down]) / np.maximum(np.hypot(across, down), 1e-9)
    lengths = np.array(LENGTHS) * np.sqrt(np.count_nonzero(contact) / np.pi)
    fall = np.exp(-distance / lengths[:, None, None])
    return np.asarray((direction * fall[:, None]).reshape(len(lengths), 2, -1))


def _without(left: Floats, patterns: Floats, beside: Bools) -> Floats:
    """Squares (blocks,) of what is `left` (3, blocks) without `patterns` (n, 3, blocks), fitted `beside`."""
    weights = beside.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = patterns * weights
        normal = np.einsum("ncb,mcb->nm", weighted, patterns)
        normal[np.diag_indices_from(normal)] *= 1.0 + 1e-9  # patterns that are alike leave it singular
        shares = np.linalg.solve(normal, np.einsum("ncb,cb->n", weighted, left))
        squares = np.sum((left - np.tensordot(shares, patterns, axes=1) * beside) ** 2, axis=0)
        scale = max(1.0, float(median(squares[beside])) / MEDIAN_LENGTH**2)
        weights = beside / (1.0 + squares / (WIDTH**2 * scale)) ** 2
    return np.asarray(squares)
