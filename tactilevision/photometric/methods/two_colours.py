"""Slope by two colours where the third is overexposed.

    p, q = f_c(u, X, Y)   with u_c = 0        one polynomial (polynomial.py) for each colour c that may be missing

Two colours leave no residual, and the error along one direction of slope is larger than with three; it is measured
at held-out balls. Where fewer than two colours remain, slopes are filled from their surroundings and are unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactilevision.photometric.cross_validation import FOLDS, BallFit
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial
from tactilevision.photometric.protocols import ColourLaw, Stored
from tactilevision.records.measured import Floats

COLOURS = 3  # red, green, blue: channels of a frame
THINNED = 4  # every fourth sample serves for the error
UNKNOWN = 1.0  # relative error of a slope with fewer than two colours


@dataclass(frozen=True, eq=False)
class TwoColourLaws(Stored):
    """`laws` of two colours each, by the number of the missing one, of `coefficients` (3, 2, 34, 21).

    `errors` (3,): relative errors of their slopes at held-out balls (`patch_error`) in excess of those of three
    colours; 1 without balls.
    """

    coefficients: Floats
    steepest: Floats
    errors: Floats

    @cached_property
    def laws(self) -> tuple[Polynomial, ...]:
        return tuple(map(Polynomial, self.coefficients, self.steepest.tolist()))

    def at(self, change: Floats, place: Floats, *, otherwise: ColourLaw) -> Floats:
        """Return slopes (N, 2) of changes (N, 3), NaN where unknown, by `otherwise` where all are known."""
        slopes = otherwise.at(np.nan_to_num(change), place)
        for colour, law in enumerate(self.laws):
            lost = np.isnan(change[:, colour])
            slopes[lost] = law.at(np.nan_to_num(change[lost]), place[lost])
        return slopes


def fit_two_colours(of: BallFit, *, error: float) -> TwoColourLaws:
    """Fit the laws to samples whose changes may be NaN, by a fitter of polynomials.

    `error`: relative error of slopes by three colours.
    """
    laws, errors = list[Polynomial](), list[float]()
    for colour in range(COLOURS):
        seen = replace(of, contact=of.contact.without(colour), resting=of.resting.without(colour))
        if len(np.unique(seen.contact.press)) < FOLDS:  # another colour is always missing
            laws.append(Polynomial(np.zeros((2, len(PRODUCTS), len(POWERS))), 1.0))
            errors.append(UNKNOWN)
            continue
        assert isinstance(seen.law, Polynomial)
        contact, resting = (s.where(np.arange(len(s.press)) % THINNED == 0) for s in (seen.contact, seen.resting))
        few = replace(seen, contact=contact, resting=resting)
        laws.append(seen.law)
        errors.append(float(np.sqrt(max(few.error**2 - error**2, 0.0))))
    coefficients, steepest = zip(*((law.coefficients, law.steepest) for law in laws), strict=True)
    return TwoColourLaws(np.stack(coefficients), np.array(steepest), np.array(errors))
