"""How deep balls come out that a calibration never saw: what its card says of depth.

Under a ball of radius R the gel is the ball, so that the depth of the contact's middle over its rim,

    dent = mean over the middle of sqrt(R^2 - r^2) - mean over the rim of it

is known but for how well its radius a is. Found and true are compared there alone: what lies beside the contact,
and where the untouched gel is, have no part in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.photometric import BallPicture, CalibratedMethod, Calibration
from tactilevision.photometric.ball import Ball
from tactilevision.photometric.method import ColourLaw
from tactilevision.records import Pair, SlopeMap
from tactilevision.surface import integrate

MIDDLE, RIM = 0.12, (0.84, 0.96)  # of the contact radius: blur mixes what lies beyond
MOST = 24  # balls; more tell no more
BANDS = 3


@dataclass(frozen=True, slots=True)
class Band:
    """`count` balls from `low` to `high`: rms error of their dents, the stated one, and the share within it."""

    low: float
    high: float
    count: int
    off_mm: float
    stated_mm: float
    within: float


def held_out_depth(calibration: Calibration, pictures: Sequence[BallPicture], mm_per_px: Pair) -> dict[str, Any]:
    """Entries of a card: the dents' ratio to the true ones (median, scatter over balls), their rms error in mm.

    `held_out_balls` has each dent with its contact radius.
    """
    now, methods, dents, radii_px = calibration.method, dict[int, CalibratedMethod](), [], []
    for picture, ball, law in _apart(calibration, pictures):
        if id(law) not in methods:
            methods[id(law)] = CalibratedMethod(law, now.reference, now.relative_error, now.quiet)
        slopes = methods[id(law)].slopes(picture.rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        dents.append(dent_mm(depth, ball, mm_per_px))
        radii_px.append(ball.contact_radius_px)
    if not dents:
        return {}
    found, true = np.array(dents).T
    ratio = found / true
    return {
        "held_out_depth_ratio": float(np.median(ratio)),
        "held_out_depth_ratio_std": 1.4826 * float(np.median(np.abs(ratio - np.median(ratio)))),
        "held_out_depth_rms_mm": float(np.sqrt(np.mean((found - true) ** 2))),
        "held_out_balls": [
            {"dent_mm": round(t, 5), "found_mm": round(f, 5), "contact_radius_px": round(r, 2)}
            for t, f, r in zip(true.tolist(), found.tolist(), radii_px, strict=True)
        ],
    }


def bands(card: Mapping[str, Any], key: str, relative_std: float) -> list[Band]:
    """The balls held out, in BANDS of as many each by `key` of "held_out_balls": their error and the stated one.

    `relative_std` is the stated deviation of the depth scale (`depth_error.gain_std`).
    """
    balls = sorted(card.get("held_out_balls", ()), key=lambda ball: ball[key])
    found = []
    for part in np.array_split(np.arange(len(balls)), BANDS):
        if len(part):
            true, seen, at = np.array([[balls[i][k] for k in ("dent_mm", "found_mm", key)] for i in part]).T
            off, stated = seen - true, relative_std * true
            found.append(
                Band(
                    float(at.min()),
                    float(at.max()),
                    len(part),
                    float(np.sqrt(np.mean(off**2))),
                    float(np.sqrt(np.mean(stated**2))),
                    float(np.mean(np.abs(off) < stated)),
                )
            )
    return found


def dent_mm(depth: npt.NDArray[np.floating[Any]], ball: Ball, mm_per_px: Pair) -> Pair:
    """Depth of the contact's middle over its rim: as found in `depth` (H, W), and as the ball has it."""
    y, x = np.indices(depth.shape, dtype=np.float64)
    r = np.hypot((x - ball.centre_px[0]) * mm_per_px[0], (y - ball.centre_px[1]) * mm_per_px[1])
    share = r / (ball.contact_radius_px * mm_per_px[0])
    middle = share <= max(MIDDLE, float(share.min()))
    rim = (share > RIM[0]) & (share < RIM[1])
    cap = np.sqrt(np.maximum(ball.radius_mm**2 - r**2, 0.0))
    return float(depth[middle].mean() - depth[rim].mean()), float(cap[middle].mean() - cap[rim].mean())


def _apart(calibration: Calibration, pictures: Sequence[BallPicture]) -> list[tuple[BallPicture, Ball, ColourLaw]]:
    """At most MOST balls that were found, evenly chosen, each with its law."""
    rows = zip(pictures, calibration.balls, calibration.unseen, strict=True)
    kept = [(picture, ball, law) for picture, ball, law in rows if ball is not None and law is not None]
    return kept[:: max(1, -(-len(kept) // MOST))]
