"""What two colours tell of slope where the third is overexposed.

    p, q = f_c(u, X, Y)   with u_c = 0        one polynomial (polynomial.py) for each colour c that may be missing

Two colours and two slopes leave no residual, and one direction of slope is told worse than with three: what such a
law is off by at balls that it never saw is stated beside it. Where fewer than two colours are left the slopes are
filled from around, and not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.colour_change import MissingColours, Planes
from tactilevision.photometric.cross_validation import FOLDS, Fitter, held_out, patch_error
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Picture, Polynomial, PolynomialEvaluator
from tactilevision.photometric.protocols import ColourLaw
from tactilevision.photometric.reference import NOISE_LIMIT
from tactilevision.photometric.windows import Patch, Window, common, inside, outside, window_of
from tactilevision.records.measured import Bools, Floats

COLOURS = 3  # red, green, blue: channels of a frame
THINNED = 4  # samples of which one is held out: a quarter tells the error as well, and takes a quarter of the time
UNKNOWN = 1.0  # relative error of a slope that fewer than two colours tell: all of it


@dataclass(frozen=True, slots=True)
class TwoColourLaws:
    """`laws` of two colours each, by the number of the one that is missing.

    `errors`: what their slopes are off by at balls left out beyond what those of all colours are, in parts of the
    slope (`patch_error`); 1 where no ball tells.
    """

    laws: tuple[Polynomial, ...]
    errors: tuple[float, ...]

    def at(self, change: Floats, place: Floats, *, otherwise: ColourLaw) -> Floats:
        """Slopes (N, 2) of changes (N, 3) at places (N, 2); NaN: not known. `otherwise` reads where all are."""
        slopes = otherwise.at(np.nan_to_num(change), place)
        for colour, law in enumerate(self.laws):
            lost = np.isnan(change[:, colour])
            slopes[lost] = law.at(np.nan_to_num(change[lost]), place[lost])
        return slopes

    def arrays(self) -> dict[str, Floats]:
        """As they are stored: `coefficients` (3, 2, 34, 21), `steepest` and `errors` (3,)."""
        return {
            "coefficients": np.stack([law.coefficients for law in self.laws]),
            "steepest": np.array([law.steepest for law in self.laws]),
            "errors": np.array(self.errors),
        }


def two_colour_laws(coefficients: Floats, *, steepest: Floats, errors: Floats) -> TwoColourLaws:
    """The laws out of `coefficients` (3, 2, 34, 21), `steepest` slopes and relative `errors` (3,) as stored."""
    laws = tuple(Polynomial(one, float(most)) for one, most in zip(coefficients, steepest, strict=True))
    return TwoColourLaws(laws, tuple(map(float, errors)))


def fit_two_colours(
    fit: Fitter, contact: Samples, untouched_samples: Samples, *, ridge: float, error: float
) -> TwoColourLaws:
    """The laws of samples, some of whose changes may be NaN, by a `fit` that makes polynomials.

    `error` is that of slopes by three colours (ball/cross_validation.py).
    """
    laws, errors = list[Polynomial](), list[float]()
    for colour in range(COLOURS):
        seen, resting = contact.without(colour), untouched_samples.without(colour)
        if len(np.unique(seen.press)) < FOLDS:  # another colour is never known
            laws.append(Polynomial(np.zeros((2, len(PRODUCTS), len(POWERS))), 1.0))
            errors.append(UNKNOWN)
            continue
        law = fit(seen, resting, ridge=ridge)
        assert isinstance(law, Polynomial)
        few, rest = (_every(samples, THINNED) for samples in (seen, resting))
        slopes, _ = held_out(fit, few, untouched_samples=rest, ridge=ridge)
        laws.append(law)
        errors.append(float(np.sqrt(max(patch_error(slopes, few) ** 2 - error**2, 0.0))))
    return TwoColourLaws(tuple(laws), tuple(errors))


def _every(samples: Samples, step: int) -> Samples:
    return samples.where(np.arange(len(samples.press)) % step == 0)


class TwoColourReader:
    """Reads the pixels of pictures (H, W) of which a colour is missing; made for the size of one reference."""

    def __init__(self, laws: TwoColourLaws, noise: Planes) -> None:
        """`noise` (3, H, W) is the relative deviation of the changes."""
        self.laws = laws
        self.evaluators: list[PolynomialEvaluator] = [law.evaluator(noise.shape[1:]) for law in laws.laws]
        self.noise: list[Picture] = []
        for colour, evaluate in enumerate(self.evaluators):
            known = noise.copy()
            known[colour] = 0.0
            self.noise.append(evaluate.noise(known))
        self.kept_share: list[Picture] = [
            np.asarray(1.0 / (1.0 + (noise / NOISE_LIMIT) ** 2), np.float32) for noise in self.noise
        ]
        self.clear = [kept > 0.5 for kept in self.kept_share]

    def add_readable(self, valid: Bools, of: MissingColours) -> None:
        """Count as `valid` (H, W), in place, where two colours tell more than noise."""
        for colour in range(COLOURS):
            if self.laws.errors[colour] < UNKNOWN:
                valid[of.window] |= of.missing[colour] & of.partly & self.clear[colour][of.window]

    def read_into(self, slopes: Planes, change: Planes, window: Window, of: MissingColours) -> None:
        """Set `slopes` (2, h, w) of a window where a colour is missing, of changes (3, h, w); 0 where more are."""
        if (both := common(window, of.window)) is None:
            return
        seen, part = inside(both, of.window), (slice(None), *inside(both, window))
        slopes, change = slopes[part], change[part]
        slopes[:, of.blind[seen]] = 0.0
        for colour in range(COLOURS):
            where = of.missing[colour][seen] & of.partly[seen]
            if (box := window_of(where)) is None:
                continue
            whole = outside(box, both)
            known = change[:, *box].copy()
            known[colour] = 0.0
            found = np.empty((2, *known.shape[1:]), np.float32)
            self.evaluators[colour].strip(known, whole, found)
            found *= self.kept_share[colour][whole]
            np.copyto(slopes[:, *box], found, where=where[box])

    def lost_share(self, of: MissingColours) -> Patch:
        """Relative error of slopes where colours are missing."""
        errors = np.zeros(of.count.shape, np.float32)
        for colour in range(COLOURS):
            errors[of.missing[colour]] = self.laws.errors[colour]
        errors[of.count > 1] = UNKNOWN
        return Patch(of.window, errors)
