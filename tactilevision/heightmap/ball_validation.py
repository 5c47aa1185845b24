"""Validate a calibration on balls: depth error of held-out balls, fitness for use, stated radii."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.poisson import integrate
from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.photometric.ball_pictures import BallPicture, pressed_balls
from tactilevision.photometric.ball_samples import INSIDE, from_axis
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.cross_validation import ONE_SIGMA_SHARE, HeldOutLaw, off_inside
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.network import find_model
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.storage import load_network
from tactilevision.records.constants import TINY
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bytes, Floats, Pair
from tactilevision.records.rig import Sensor
from tactilevision.robust import mad_std

# Depth error of held-out balls, for the method's card.
#
# Under a ball of radius R the gel follows the ball, so that the depth of the contact's centre relative to its rim,
#
#     dent = mean over the centre of sqrt(R^2 - r^2) - mean over the rim of it
#
# is known up to the error of the contact radius a. Measured and true depth are compared there alone, independent
# of the gel outside the contact and of its zero. The error is compared with the deviation that the law without
# this ball states (photometric/cross_validation.py).

MIDDLE = 0.12  # of the contact radius: extent of the contact's centre
RIM = (0.84, 0.96)  # of the contact radius: blur mixes light from beyond
MAX_BALLS = 24  # balls; more do not improve the estimate
MIN_FACTOR = 0.5  # of the stated deviation: real sets .6 to 1.5; noiseless rendered balls may have no error
BANDS = 3  # of contacts in the table of errors: few balls fill no more


@dataclass(frozen=True, slots=True)
class Known:
    """A contact of known depth: true and measured depth, its stated deviation; the contact's radius in px."""

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
    """Return entries of a card: the ratio of measured to true dents (median, scatter over balls), their rms error
    in mm.

    `held_out_balls` has each dent with its contact radius. `seen_gain` is `seen_gain_std`; multiply it and the
    card's `place_gain_std` by `depth_coverage_factor`.
    """
    now, methods, balls = calibration.method, dict[int, CalibratedMethod](), list[Known]()
    inside, outside = list[float](), list[float]()
    for picture, ball, held in chosen_balls(calibration, pictures):
        if held is None:
            continue
        if id(held.law) not in methods:
            methods[id(held.law)] = replace(now, law=held.law, card=MethodCard())
        found, true = _read_dent_mm(methods[id(held.law)], picture.rgb, ball, mm_per_px)
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
    """Return `balls` with the deviation by the factor of the other balls; errors and deviations (n,) mm."""
    stated = []
    for number, ball in enumerate(balls):
        off, within, beyond = (np.delete(all_, number) for all_ in (errors, inside, outside))
        k = conformal_factor(off_inside(off, within, beyond.tolist()))
        stated.append(replace(ball, stated_mm=float(np.hypot(k * inside[number], outside[number]))))
    return stated


def conformal_factor(off: Floats) -> float:
    """Return k, which bounds a further ball's error over its deviation at 68 %, from those of `off` (n,)."""
    if len(off) == 0:
        return 1.0
    j = min(len(off), int(np.ceil((len(off) + 1) * ONE_SIGMA_SHARE)))
    return max(MIN_FACTOR, float(np.sort(off)[j - 1]))


def told(name: str, contacts: Sequence[Known]) -> dict[str, Any]:
    """Return entries of a card: each contact as `name`, and their errors in bands of depth and of contact size."""
    shown = {by: [asdict(band) for band in bands(contacts, by)] for by in ("true_mm", "radius_px")}
    return {
        name: [_rounded(asdict(contact)) for contact in contacts],
        f"{name}_by": {by: [_rounded(band) for band in found] for by, found in shown.items()},
    }


def bands(contacts: Sequence[Known], by: str) -> list[Band]:
    """Return the contacts in BANDS of equal count by `by`, "true_mm" or "radius_px"; equal values share a band."""
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
    """Return the scatter of the depth scale over a method's own balls: 1.48 times the median deviation from 1.

    Of dents, which determine depth: in slopes the contact's rim dominates, where a slightly too wide circle
    includes slopes that no ball has.
    """
    shown = pressed_balls(pictures, balls, most=MAX_BALLS)
    dents = np.array([_read_dent_mm(method, rgb, ball, mm_per_px) for rgb, ball in shown]).reshape(-1, 2)
    return mad_std(dents[:, 0] / dents[:, 1], centre=1.0)


def _read_dent_mm(method: CalibratedMethod, rgb: Bytes, ball: Ball, mm_per_px: Pair) -> Pair:
    """Return the dent that a method reads in a rectified picture (H, W, 3), and that of the ball, mm."""
    slopes = method.read(rgb).slopes
    return dent_mm(integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px), ball, mm_per_px=mm_per_px)


def dent_mm(depth: Array, ball: Ball, *, mm_per_px: Pair) -> Pair:
    """Return the depth of the contact's centre relative to its rim: in `depth` (H, W), and of the ball, mm."""
    r = from_axis(depth.shape, ball, mm_per_px)[2]
    share = r / (ball.contact_radius_px * mm_per_px[0])
    middle = share <= max(MIDDLE, float(share.min()))
    rim = (share > RIM[0]) & (share < RIM[1])
    low, high = (np.sqrt(np.maximum(ball.radius_mm**2 - r[part] ** 2, 0.0)).mean() for part in (rim, middle))
    return float(depth[middle].mean() - depth[rim].mean()), float(high - low)


def chosen_balls(
    calibration: Calibration, pictures: Sequence[BallPicture]
) -> list[tuple[BallPicture, Ball, HeldOutLaw | None]]:
    """Return at most MAX_BALLS detected balls, evenly chosen, each with the law fitted without it or None."""
    rows = zip(pictures, calibration.balls, calibration.held_out_laws, strict=True)
    kept = [(picture, ball, law) for picture, ball, law in rows if ball is not None]
    return kept[:: max(1, -(-len(kept) // MAX_BALLS))]


# Does a calibration hold for held-out balls? One that fails its own balls is unfit for use.
#
# Each ball is held out of the fit in turn. The median angle between read and true slopes, and the median ratio of
# read to true depth, are in the method's card. On five real sets they are 2 to 5 degrees and .92 to 1.00. Circles
# where no ball is give 78 degrees and no depth, nearly white light 24 degrees, white light 60.

# degrees: real sensors 2 to 6, ready networks 6 to 10 on simulated lights, failures 19 to 55
MAX_DIRECTION_DEG = 17
MAX_SHARE_AT_CONTACT = 0.25  # of the balls at a contact in the reference, from which the law is learnt inverted
MIN_RATIO = 0.6  # of the depth: real sensors .91 to .98; failures .4
MAX_RATIO = 1.6  # of the depth: as large an error the other way


def unfit(card: MethodCard) -> str:
    """Return how a method fails its own balls, by its `card`; empty where it does not."""
    faults, share = [], card.balls_at_that_contact or 0.0
    if share >= MAX_SHARE_AT_CONTACT:
        faults.append(f"{100 * share:.0f} % of the balls found are a contact in the reference")
    direction, ratio = card.held_out_direction_error_deg, card.other.get("held_out_depth_ratio")
    if direction is not None and direction > MAX_DIRECTION_DEG:
        faults.append(
            f"slopes of balls left out point {direction:.1f} degrees off (at most {MAX_DIRECTION_DEG:.0f} are fit)"
        )
    if isinstance(ratio, float | int) and not MIN_RATIO < ratio < MAX_RATIO:
        faults.append(
            f"depth of balls left out is {ratio:.2g} of the true one ({MIN_RATIO:g} to {MAX_RATIO:g} are fit)"
        )
    return ", ".join(faults)


def scale_is_assumed(card: MethodCard) -> bool:
    """Return whether no ball determined the slope scale: a network of simulated lights, or unknown contacts."""
    return card.fitted_by == "contacts" or "scenes" in card.other


def unfit_warnings(card: MethodCard) -> tuple[str, ...]:
    """Return a warning of a calibration that fails its own balls."""
    fault = unfit(card)
    if not fault:
        return ()
    return (
        f"the light's calibration fails its own balls: {fault}. Check that nothing touches the gel in "
        "reference/flat, centres and radii in reference/ball.csv, mm_per_px, and that the light has three colours",
    )


def check_fit(card: MethodCard, *, remedy: str, where: str = "reference/ball") -> None:
    """Raise InputError for a calibration that fails its own balls; `remedy` says how to continue regardless.

    `where` is what holds the calibration.
    """
    fault = unfit(card)
    if fault:
        raise InputError(
            "the light's calibration fails its own balls",
            where=where,
            value=fault,
            remedy=f"Check flat/, ball.csv, mm_per_px and the lamps; {remedy} continues anyway.",
        )


# Are the stated ball radii right? Equal balls do not show a common error, a usual light of their sensor does.
#
# Slopes of balls stated k times too large are 1/k of those in the picture. A ready network, independent of the
# balls, reads them at .68 to 1.32 times the stated ones on eight real sensors, so at 1.4 to 2.6 times where a
# diameter is stated for the radius, and at .34 to .66 times for half the radius. Under another light it reads
# less, too, .56 times on the simulated sample, but then directions differ as well: the cosine between slopes read
# and stated is .89 there, .94 to .95 on seven of the eight. Of 1097 simulated lights where it is above .92 none
# reads less than .6.
#
# A single ball whose radius is stated k times too large differs from the others by ln k: the network reads real
# balls of one sensor within .07 to .15 of each other (GelSlim, Mini), .24 to .36 on DIGITs. Unlike a law fitted to
# few balls, it is independent of the odd one.

MAX_PICTURES = 24  # maximum number read, evenly spaced; more balls find a single odd one by their own law
MIN_ALIKE = 0.7  # cosine between slopes read and stated, the median over balls
MAX_GAIN = 1.5  # 2.5 deviations of eight real sensors' scales, which scatter by 16 %
MIN_GAIN = 0.6  # the least of real sensors is .68
MIN_GREY = 40  # mean of the pictures: at 45 it reads .9 of what it does at 110, at 16 .68, and points alike
MIN_ALIKE_LIGHT = 0.92  # cosine from which the light is a usual one: too little counts, and a single ball
MIN_OTHERS = 5  # other balls required to judge a single one
MIN_ALIKE_ONE = 0.88  # cosine of a ball that is judged: a wrong radius leaves directions as they are
MIN_SCATTER = 0.1  # of ln of the scale: few balls may agree better by chance
ODD_SIGMA = 3.5  # deviations of the others; 1.5 times the radius is .41 off, sound balls of ten .23 at most


@dataclass(frozen=True, slots=True)
class UsualReading:
    """One ball by a usual light: slopes read over stated (`gain`), the cosine between both, the mean `grey`."""

    gain: float
    alike: float
    grey: float


def doubt_of_radii(sensor: Sensor, pictures: Sequence[BallPicture], calibration: Calibration) -> tuple[str, ...]:
    """Return warnings, of all balls or a single one, by the ready network for the kind of `sensor`, if any.

    Rectified `pictures`, of which the `calibration` was made; a ball already named there is not named again.
    """
    path = find_model(sensor.kind.removesuffix("_markers"))
    if path is None:
        return ()
    with suppress(InputError):  # only a doubt: errors are ignored
        network = load_network(path, calibration.method.reference)
        shots = [picture.rgb for picture in pictures]
        read = read_balls(network, shots, balls=calibration.balls, mm_per_px=sensor.mm_per_px)
        few = len(read) == sum(ball is not None for ball in calibration.balls)
        odd = odd_by_usual_light(read, names=[one.name for one in pictures], kind=sensor.kind) if few else ()
        known = {said.partition(":")[0] for said in calibration.warnings}
        told = (said for said in odd if said.partition(":")[0] not in known)
        return (*usual_scale_warnings(list(read.values()), kind=sensor.kind), *told)
    return ()


def read_balls(
    network: PhotometricMethod, pictures: Sequence[Bytes], *, balls: Sequence[Ball | None], mm_per_px: Pair
) -> dict[int, UsualReading]:
    """Return the `network`'s reading of each of `balls`, None if not found, in pictures (H, W, 3), grey."""
    known = [number for number, ball in enumerate(balls) if ball is not None]
    some = np.unique(np.linspace(0, len(known) - 1, min(MAX_PICTURES, len(known))).astype(int))
    read = {}
    for number in (known[k] for k in some):
        ball = balls[number]
        assert ball is not None
        read[number] = _reading(network, pictures[number], ball, mm_per_px=mm_per_px)
    return read


def usual_scale_warnings(read: Sequence[UsualReading], *, kind: str) -> tuple[str, ...]:
    """Return a warning where balls slope far more or less than stated, by the light of a usual `kind` of sensor.

    None where the network's directions differ from the balls': then it is no such sensor, or a mirrored picture.
    """
    if not read:
        return ()
    gain, alike, grey = np.median([(one.gain, one.alike, one.grey) for one in read], axis=0)
    if gain > MAX_GAIN and alike > MIN_ALIKE:
        cause = "a diameter stated for ball_radius_mm, or is it another kind of sensor"
    elif gain < MIN_GAIN and alike > MIN_ALIKE_LIGHT and grey > MIN_GREY:
        cause = "ball_radius_mm stated too small, mm_per_px too large, or the camera's curve an unusual one"
    else:
        return ()
    return (
        f"by the light of a usual {kind} the balls' slopes are {gain:.2g} times the stated ones: is {cause}? "
        "Depth is in proportion to the radius",
    )


def odd_by_usual_light(read: Mapping[int, UsualReading], *, names: Sequence[str], kind: str) -> tuple[str, ...]:
    """Return a warning of the one ball whose slope scale differs most from the others' by a usual light, if
    significant.

    None where the network's directions differ from the balls': the light is not a usual one.
    """
    if not read or np.median([one.alike for one in read.values()]) < MIN_ALIKE_LIGHT:
        return ()
    gains = {number: np.log(one.gain) for number, one in read.items() if one.alike > MIN_ALIKE_ONE}
    if len(gains) <= MIN_OTHERS:
        return ()
    others = {number: np.array([gains[k] for k in gains if k != number]) for number in gains}
    off = {number: float(gains[number] - np.median(others[number])) for number in gains}
    odd = max(off, key=lambda number: abs(off[number]))
    if abs(off[odd]) < ODD_SIGMA * max(MIN_SCATTER, mad_std(others[odd])):
        return ()
    return (
        f"{names[odd] or f'ball {odd + 1}'}: by the light of a usual {kind} its slopes are "
        f"{np.exp(off[odd]):.2g} times what the other balls make of its ball_radius_mm: another radius, or not "
        "its contact. Correct its ball_radius_mm, or take it out of the balls",
    )


def _reading(network: PhotometricMethod, rgb: Bytes, ball: Ball, *, mm_per_px: Pair) -> UsualReading:
    """Return the reading under one ball in a rectified picture (H, W, 3)."""
    read = network.slopes(rgb)
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    x, y, r = from_axis(read.dz_dx.shape, ball, mm_per_px)
    under = r < INSIDE * contact_mm if read.valid is None else (r < INSIDE * contact_mm) & read.valid
    stated = np.stack(ball_slopes(x[under], y[under], contact_mm=contact_mm, radius_mm=ball.radius_mm))
    found = np.stack([read.dz_dx[under], read.dz_dy[under]])
    both, own, true = (float(np.sum(one)) + TINY for one in (found * stated, found**2, stated**2))
    return UsualReading(max(both / true, 1e-3), both / float(np.sqrt(own * true)), float(rgb.mean()))
