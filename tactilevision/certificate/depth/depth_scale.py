"""The scale in which the camera reads the depth of a face, from the certified events of all presses.

A method made from balls reads all slopes in proportion to 1/R of the radius that was stated for them, and one
radius alone shows no fault in it. The bevel knows nothing of balls: gentle faces, which are read right otherwise,
tell it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.robust import mad_std

GENTLE_MM = 0.4  # mm, up to which walls leave the depth of a face alone
MIN_COUNT = 3  # gentle faces from which a median is taken; tests.certificate.test_depth_scale
MAX_OFF = 0.06  # of 1: on five lights medians over gentle faces lie within .02, single ones within .08
DETECTION_SIGMA = 3.0  # stds of the median; tests.certificate.test_depth_scale


@dataclass(frozen=True, slots=True)
class DepthScale:
    """True over seen depth, a polynomial in the seen depth (lowest power first), held beyond `limits_mm`;
    scatter.
    """

    coefficients: tuple[float, ...]
    limits_mm: Pair
    scatter: float

    def scale(self, seen_mm: Floats | float) -> Floats:
        """True over seen depth at seen depths of any shape, mm."""
        held = np.clip(np.asarray(seen_mm, dtype=np.float64), *self.limits_mm)
        return np.asarray(np.polynomial.polynomial.polyval(held, self.coefficients), dtype=np.float64)


def find_depth_scale(pairs: Sequence[Pair]) -> DepthScale | None:
    """Gauge through (seen, true) depths at the events: constant, linear or square as the depths are spread."""
    usable = np.array([p for p in pairs if p[0] > 0 and p[1] > 0]).reshape(-1, 2)
    if not len(usable):
        return None
    seen, scale = usable[:, 0], usable[:, 1] / usable[:, 0]
    spread = len(np.unique(np.round(usable[:, 1] / (0.1 * usable[:, 1].max()))))
    degree = int(np.clip(min(spread, len(usable) // 2) - 1, 0, 2))
    coefficients = np.polynomial.polynomial.polyfit(seen, scale, degree)
    residual = scale - np.polynomial.polynomial.polyval(seen, coefficients)
    return DepthScale(
        tuple(float(c) for c in coefficients), (float(seen.min()), float(seen.max())), float(residual.std())
    )


def scale_off(pairs: Sequence[Pair]) -> float | None:
    """Seen over certified depth of gentle faces (seen, certified); None where they do not contradict 1."""
    ratios = _ratios(pairs)
    if len(ratios) < MIN_COUNT:
        return None
    off = float(np.median(ratios))
    scatter = mad_std(ratios, centre=off) / np.sqrt(len(ratios))
    return None if abs(off - 1.0) < max(MAX_OFF, DETECTION_SIGMA * scatter) else off


def scale_warning(pairs: Sequence[Pair], radii_mm: Sequence[float]) -> str:
    """A sentence where gentle faces (seen, certified) contradict the picture's scale; "" where they do not.

    `radii_mm` of the balls that made it; none for a method that came ready.
    """
    off = scale_off(pairs)
    return "" if off is None else scale_question(off, len(_ratios(pairs)), radii_mm=radii_mm)


def scale_question(off: float, faces: int, *, radii_mm: Sequence[float], shadows: str | None = None) -> str:
    """What to ask where the picture's scale is `off`, a ratio, at so many gentle `faces`.

    `shadows`: how they were read where it is known what cast shadows do to them; None: they may be the cause.
    """
    stated = ", ".join(f"{radius:g}" for radius in sorted(set(radii_mm)))
    implied = ", ".join(f"{off * radius:.2f}" for radius in sorted(set(radii_mm)))
    doubts = [
        f"is the ball radius stated as {stated} mm really {implied}",
        "has the light changed since the balls",
    ]
    doubts += ["do lamps cast shadows beside the faces"] if shadows is None else []
    why = f"{', '.join(doubts[:-1])}, or {doubts[-1]}?" if stated else "balls of this sensor would mend it."
    return (
        f"Depth as the picture reads it{shadows or ''} is {100 * (off - 1):+.0f} % off what the bevel certifies "
        f"of {faces} gentle faces: {why}"
    )


def _ratios(pairs: Sequence[Pair]) -> Floats:
    """Seen over true depth of the gentle faces in pairs of them."""
    return np.array([seen / true for seen, true in pairs if 0 < true <= GENTLE_MM and seen > 0])
