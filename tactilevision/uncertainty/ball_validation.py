"""How deep balls come out that a calibration never saw: what its card says of depth.

Under a ball of radius R the gel is the ball, so that the depth of the contact's middle over its rim,

    dent = mean over the middle of sqrt(R^2 - r^2) - mean over the rim of it

is known but for how well its radius a is. Found and true are compared there alone: what lies beside the contact,
and where the untouched gel is, have no part in it. Beside the error stands the deviation that the law which never
saw the ball states of it (photometric/ball/cross_validation.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.integration.poisson import integrate
from tactilevision.photometric import BallPicture, CalibratedMethod, Calibration
from tactilevision.photometric.ball.cross_validation import ONE_SIGMA_SHARE, HeldOutLaw, off_inside
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.card import MethodCard
from tactilevision.records import Floats, Pair, SlopeMap
from tactilevision.robust import mad_std

MIDDLE = 0.12  # of the contact radius: what counts as the contact's middle
RIM = (0.84, 0.96)  # of the contact radius: blur mixes what lies beyond
MAX_BALLS = 24  # balls; more tell no more
MIN_FACTOR = 0.5  # of what is stated: real sets .6 to 1.5; balls of a drawn light without noise may leave nothing
BANDS = 3  # of contacts in the table of errors: few balls fill no more


@dataclass(frozen=True, slots=True)
class Known:
    """A contact of known depth: the depth, as found, the deviation stated of it; the contact's radius in px."""

    true_mm: float
    found_mm: float
    stated_mm: float
    radius_px: float


@dataclass(frozen=True, slots=True)
class Band:
    """`count` contacts from `low` to `high`: mean and rms error of depth, the stated one, the share within it."""

    low: float
    high: float
    count: int
    bias_mm: float
    rms_mm: float
    stated_mm: float
    within: float


def held_out_depth(
    calibration: Calibration, pictures: Sequence[BallPicture], *, mm_per_px: Pair, seen_gain: float
) -> dict[str, Any]:
    """Entries of a card: the dents' ratio to the true ones (median, scatter over balls), their rms error in mm.

    `held_out_balls` has each dent with its contact radius. `seen_gain` is `seen_gain_std`; it and the card's
    `place_gain_std` are to be taken times `depth_coverage_factor`.
    """
    now, methods, balls = calibration.method, dict[int, CalibratedMethod](), list[Known]()
    inside, outside = list[float](), list[float]()
    for picture, ball, held in _held_out_laws(calibration, pictures):
        if id(held.law) not in methods:
            methods[id(held.law)] = replace(now, law=held.law, card=MethodCard())
        slopes = methods[id(held.law)].slopes(picture.rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        found, true = dent_mm(depth, ball, mm_per_px=mm_per_px)
        balls.append(Known(true, found, held.std * true, ball.contact_radius_px))
        inside.append(float(np.hypot(held.inside_std, seen_gain)) * true)
        outside.append(held.outside_std * true)
    if not balls:
        return {}
    errors = np.array([ball.found_mm - ball.true_mm for ball in balls])
    ratio = np.array([ball.found_mm / ball.true_mm for ball in balls])
    balls = _stated_by_others(balls, errors, np.array(inside), np.array(outside))
    return {
        "depth_coverage_factor": conformal_factor(off_inside(errors, np.array(inside), outside)),
        "held_out_depth_ratio": float(np.median(ratio)),
        "held_out_depth_ratio_std": mad_std(ratio),
        "held_out_depth_rms_mm": float(np.sqrt(np.mean(errors**2))),
        **told("held_out_balls", balls),
    }


def _stated_by_others(balls: Sequence[Known], errors: Floats, inside: Floats, outside: Floats) -> list[Known]:
    """The `balls` with the deviation that the other balls' factor gives each; errors and deviations (n,) mm."""
    stated = []
    for number, ball in enumerate(balls):
        off, within, beyond = (np.delete(all_, number) for all_ in (errors, inside, outside))
        k = conformal_factor(off_inside(off, within, beyond.tolist()))
        stated.append(replace(ball, stated_mm=float(np.hypot(k * inside[number], outside[number]))))
    return stated


def conformal_factor(off: Floats) -> float:
    """k, a ratio: a further ball's error over its stated deviation, as those of `off` (n,), is less with 68 %."""
    if len(off) == 0:
        return 1.0
    j = min(len(off), int(np.ceil((len(off) + 1) * ONE_SIGMA_SHARE)))
    return max(MIN_FACTOR, float(np.sort(off)[j - 1]))


def told(name: str, contacts: Sequence[Known]) -> dict[str, Any]:
    """Entries of a card: each contact as `name`, and their errors in bands of depth and of contact size."""
    shown = {by: [asdict(band) for band in bands(contacts, by)] for by in ("true_mm", "radius_px")}
    return {
        name: [_rounded(asdict(contact)) for contact in contacts],
        f"{name}_by": {by: [_rounded(band) for band in found] for by, found in shown.items()},
    }


def bands(contacts: Sequence[Known], by: str) -> list[Band]:
    """The contacts in BANDS of as many each by `by`, "true_mm" or "radius_px"; those alike in it stay together."""
    at = np.sort([getattr(contact, by) for contact in contacts])
    alike = np.unique(at)
    cuts = alike if len(alike) <= BANDS else np.unique([part[0] for part in np.array_split(at, BANDS)])
    number = [int(np.searchsorted(cuts, getattr(contact, by), side="right")) for contact in contacts]
    return [_band([c for c, n in zip(contacts, number, strict=True) if n == one], by) for one in np.unique(number)]


def _band(contacts: Sequence[Known], by: str) -> Band:
    off = np.array([contact.found_mm - contact.true_mm for contact in contacts])
    stated = np.array([contact.stated_mm for contact in contacts])
    at = [getattr(contact, by) for contact in contacts]
    rms, usual = (float(np.sqrt(np.mean(values**2))) for values in (off, stated))
    return Band(
        min(at), max(at), len(contacts), float(off.mean()), rms, usual, float(np.mean(np.abs(off) < stated))
    )


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value if isinstance(value, int) else round(value, 5) for key, value in row.items()}


def seen_gain_std(
    method: CalibratedMethod, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None], mm_per_px: Pair
) -> float:
    """Scatter of the depth scale over the balls that a method was made from: 1.48 times the median from 1.

    Of dents, on which depth rests: in slopes the contact's rim counts most, where a circle that is a little too
    wide shows slopes that no ball has.
    """
    kept = [(picture.rgb, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    ratios = []
    for rgb, ball in kept[:: max(1, -(-len(kept) // MAX_BALLS))]:
        slopes = method.slopes(rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        found, true = dent_mm(depth, ball, mm_per_px=mm_per_px)
        ratios.append(found / true)
    return mad_std(np.array(ratios), centre=1.0)


def dent_mm(depth: npt.NDArray[np.floating[Any]], ball: Ball, *, mm_per_px: Pair) -> Pair:
    """Depth of the contact's middle over its rim: as found in `depth` (H, W), and as the ball has it."""
    y, x = np.indices(depth.shape, dtype=np.float64)
    r = np.hypot((x - ball.centre_px[0]) * mm_per_px[0], (y - ball.centre_px[1]) * mm_per_px[1])
    share = r / (ball.contact_radius_px * mm_per_px[0])
    middle = share <= max(MIDDLE, float(share.min()))
    rim = (share > RIM[0]) & (share < RIM[1])
    cap = np.sqrt(np.maximum(ball.radius_mm**2 - r**2, 0.0))
    return float(depth[middle].mean() - depth[rim].mean()), float(cap[middle].mean() - cap[rim].mean())


def _held_out_laws(
    calibration: Calibration, pictures: Sequence[BallPicture]
) -> list[tuple[BallPicture, Ball, HeldOutLaw]]:
    """At most MAX_BALLS balls that were found, evenly chosen, each with the law that never saw it."""
    rows = zip(pictures, calibration.balls, calibration.held_out_laws, strict=True)
    kept = [(picture, ball, law) for picture, ball, law in rows if ball is not None and law is not None]
    return kept[:: max(1, -(-len(kept) // MAX_BALLS))]
