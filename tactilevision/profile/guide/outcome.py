"""What a fit says of each press by a law that never saw it: direction, depth, and a section through the ball."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactilevision.integration.poisson import integrate
from tactilevision.photometric import BallPicture, Calibration
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.ball.samples import ball_samples
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.card import MethodCard
from tactilevision.quality.fitness import unfit_warnings
from tactilevision.records import Floats, Pair, SlopeMap
from tactilevision.uncertainty.ball_validation import RIM, dent_mm

SAMPLES = 500  # pixels of each ball, as for the scatter of the depth scale
REACH = 2.2  # contact radii that a section shows to either side


@dataclass(frozen=True, slots=True, eq=False)
class PressOutcome:
    """One press as a law reads it that never saw it.

    `direction_deg` median error of direction; `depth_ratio` read over true; `ball` as the fit has its circle;
    `depth_mm` (H, W).
    """

    ball: Ball
    direction_deg: float
    depth_ratio: float
    depth_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A calibration, and each press by its name; presses that the fit left out are missing."""

    calibration: Calibration
    presses: dict[str, PressOutcome]
    mm_per_px: Pair

    def to_json(self) -> dict[str, Any]:
        """What the page shows of it."""
        found = list(self.presses.values())
        ratio = float(np.median([one.depth_ratio for one in found])) if found else math.nan
        method = self.calibration.method
        card = replace(method.card, other={**method.card.other, "held_out_depth_ratio": ratio})
        return {
            "method": method.name,
            "balls": len(found),
            "direction_deg": round(self.calibration.direction_error_deg, 2),
            "depth_ratio": _number(ratio),
            "unfit": list(unfit_warnings(card)),
            "warnings": list(self.calibration.warnings),
            "presses": {name: _told(one) for name, one in self.presses.items()},
        }

    def section(self, name: str) -> dict[str, Any]:
        """Depth along x through a ball's middle, and the ball's own, in mm; zero at the contact's rim."""
        one = self.presses[name]
        (x, y), radius = one.ball.centre_px, one.ball.contact_radius_px
        height, width = one.depth_mm.shape
        row = int(np.clip(round(y), 0, height - 1))
        columns = np.arange(max(0, math.ceil(x - REACH * radius)), min(width, int(x + REACH * radius) + 1))
        along_mm = (columns - x) * self.mm_per_px[0]
        read = one.depth_mm[row, columns]
        share = np.abs(along_mm) / (radius * self.mm_per_px[0])
        rim = (share > RIM[0]) & (share < RIM[1])
        cap = np.sqrt(np.maximum(one.ball.radius_mm**2 - along_mm**2, 0.0))
        zero = (read[rim].mean(), cap[rim].mean()) if rim.any() else (read.max(), cap.max())
        return {
            "x_mm": np.round(along_mm, 4).tolist(),
            "read_mm": [_number(v) for v in read - zero[0]],
            "ball_mm": [_number(v) for v in np.where(share <= 1.0, cap - zero[1], np.nan)],
        }


def judge(calibration: Calibration, pictures: list[BallPicture], mm_per_px: Pair) -> Outcome:
    """Each press that a calibration used, by the law that never saw it."""
    method, found, rng = calibration.method, dict[str, PressOutcome](), np.random.default_rng(0)
    rows = zip(pictures, calibration.balls, calibration.held_out_laws, strict=True)
    for number, (picture, ball, told) in enumerate(rows):
        if ball is None or told is None:
            continue
        other = replace(method, law=told.law, card=MethodCard())
        change, _, valid = other.change.measure_known(picture.rgb)
        seen = ball_samples(
            change, ball, mm_per_px=mm_per_px, number=number, most=SAMPLES, valid=valid, rng=rng
        ).complete()
        off = direction_error_deg(told.law.at(seen.change, seen.place), seen.slopes)
        slopes = other.slopes(picture.rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        read, true = dent_mm(depth, ball, mm_per_px=mm_per_px)
        median = float(np.median(off)) if len(off) else math.nan
        found[picture.name] = PressOutcome(ball, median, read / true, np.asarray(depth, np.float64))
    return Outcome(calibration, found, mm_per_px)


def _told(one: PressOutcome) -> dict[str, Any]:
    (x, y), radius = one.ball.centre_px, one.ball.contact_radius_px
    return {
        "circle": [round(x, 2), round(y, 2), round(radius, 2)],
        "residual": round(one.ball.residual, 3),
        "direction_deg": _number(one.direction_deg),
        "depth_ratio": _number(one.depth_ratio),
    }


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None
