"""How deep balls come out that a calibration never saw: what its card says of depth.

Under a ball of radius R the gel is the ball, so that the depth of the contact's middle over its rim,

    dent = mean over the middle of sqrt(R^2 - r^2) - mean over the rim of it

is known but for how well its radius a is. Found and true are compared there alone: what lies beside the contact,
and where the untouched gel is, have no part in it.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def held_out_depth(calibration: Calibration, pictures: Sequence[BallPicture], mm_per_px: Pair) -> dict[str, float]:
    """Entries of a card: the dents' ratio to the true ones (median, scatter over balls), their rms error in mm."""
    now, methods, dents = calibration.method, dict[int, CalibratedMethod](), []
    for picture, ball, law in _apart(calibration, pictures):
        if id(law) not in methods:
            methods[id(law)] = CalibratedMethod(law, now.reference, now.relative_error, now.quiet)
        slopes = methods[id(law)].slopes(picture.rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        dents.append(dent_mm(depth, ball, mm_per_px))
    if not dents:
        return {}
    found, true = np.array(dents).T
    ratio = found / true
    return {
        "held_out_depth_ratio": float(np.median(ratio)),
        "held_out_depth_ratio_std": 1.4826 * float(np.median(np.abs(ratio - np.median(ratio)))),
        "held_out_depth_rms_mm": float(np.sqrt(np.mean((found - true) ** 2))),
    }


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
