"""Check ball presses: stated radii, outliers, lights, places, and contact in the reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import Observability
from tactilevision.photometric.colour_change import ColourChange, FrameChange
from tactilevision.photometric.cross_validation import FOLDS, SLOPE_SOFTENING, BallFit, beyond_others, gains_of
from tactilevision.photometric.drift import solid
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bytes, Floats, Pair
from tactilevision.robust import mad_std

# Consistency of ball presses: contradictory radii, and one contact in all pictures.
#
# For a ball whose radius is stated k times too large, the measured slopes are k times those stated, by a law of
# the other balls. Slopes cannot contradict a single radius that all balls share. A contact in the reference
# appears in every picture with opposite sign: all balls are then found at one place and of one size.

COVERED = 0.5  # of the width and height of the picture
SAME_PLACE = 0.15  # of the contact radius: places of separate presses differ by more
SAME_SIZE = 0.1  # of the contact radius: sizes of separate presses differ by more
MIN_SHARE = 0.75  # of the balls; the others are detected between the two contacts
MIN_OF_EACH = 3  # balls of one radius
MIN_CONTRADICTION = 0.1  # of the scale: places and sizes change it by half of that
SIGMAS = 3  # deviations by which scales must differ
SPLITS = 8  # of the balls in two halves, each of all radii
MIN_OF_ONE = 0.3  # of ln scale: error of a single ball in a dark corner
OUTLIER_SIGMA = 5  # times the scatter of the others
MAX_ANSWER = 5  # relative change of colour per unit of slope, of lamps at 11 degrees; real sensors have 1.2 to 1.7
MAX_LABEL_MOVE = 0.25  # of the contact radius: manual labels are within .1
MAX_LABEL_RATIO = 1.35  # of contact radii: manual circles are up to 1.3 times as wide as the fitted ones
MIN_LABELS_OFF = 0.25  # of the labels
MAX_SUSPECTS = 5  # balls that `outlier_among` examines, each for the time of four fits
MAX_NAMED = 3  # balls named in warnings
MIN_GAIN = 1e-3  # of the depth scale at a ball, which keeps its logarithm finite
MIN_NAMED_SHARE = 0.1  # of the expected slopes, least (or inverse) value that is reported
MAX_SLOPE_NOISE = 0.03  # slope of a pixel's noise, worst direction: real .001 to .006, a tenth as coloured .047
MAX_EVEN_NOISE = 0.04  # the same, alike in all directions: noisy pure colours .033, a fifth as coloured .042
MAX_NOISE_RATIO = 4  # worst over best direction: real 1.8 to 2.7, a tenth as coloured 4.6
MAX_GAP_DEG = 200  # degrees between the sides of colours: five real sensors leave 131 to 184, two lamps 250


GainsWithout = Callable[[Sequence[int], Mapping[int, float]], Mapping[int, float]]


def ball_warnings(
    best: BallFit,
    balls: Sequence[Ball | None],
    pictures: Sequence[BallPicture],
    *,
    cover: Floats,
    light: Observability,
    contact_px: Pair | None,
    unsure: Mapping[int, float],
) -> list[str]:
    """Return what is wrong with the balls of a fit: labels, scale, places, lights, radii, single outliers.

    `cover` (2,) is the share of width and height that they span, `unsure` as of `odd_balls`. A contact in the
    reference at `contact_px` (x, y in px) explains all but the labels.
    """
    labels = label_warnings([(one.centre_px, one.contact_radius_px) for one in pictures], balls)
    if contact_px is not None:
        x, y = contact_px
        said = (
            f"all ball pictures differ alike from the reference near ({x:.0f}, {y:.0f}) px: a contact in the "
            "reference. Take a picture of the untouched gel for reference/flat; if all balls were pressed there, "
            "press them elsewhere as well"
        )
        return [*labels, said]
    contact = best.contact
    radii_mm = {number: ball.radius_mm for number in map(int, np.unique(contact.press)) if (ball := balls[number])}

    def gains_without(group: Sequence[int], steeper: Mapping[int, float]) -> dict[int, float]:
        return replace(best, contact=contact.steepened(steeper)).gains_without(np.array(group))

    names, search = [one.name for one in pictures], partial(outlier_among, best)
    return [
        *labels,
        *scale_warnings(contact.change, contact.slopes),
        *coverage_warnings(cover),
        *observability_warnings(light),
        *contradicting_radii(radii_mm, gains_without),
        *odd_balls(best.gains, balls, names=names, unsure=unsure, outlier_among=search),
    ]


def shared_contact(balls: Sequence[Ball | None]) -> Pair | None:
    """Return the place (x, y in px) where at least MIN_SHARE of the balls are, alike in size; else None."""
    known = [ball for ball in balls if ball is not None]
    if len(known) < 3:
        return None
    size = np.array([ball.contact_radius_px for ball in known])
    place = np.array([ball.centre_px for ball in known])
    centre = np.median(place, axis=0)
    radius = float(np.median(size))
    same = (np.hypot(*(place - centre).T) < SAME_PLACE * radius) & (np.abs(size - radius) < SAME_SIZE * radius)
    return (float(centre[0]), float(centre[1])) if same.mean() >= MIN_SHARE else None


def contradicting_radii(radii_mm: Mapping[int, float], gains_without: GainsWithout) -> list[str]:
    """Return a warning where stated radii (mm, by the number of the ball) contradict each other.

    `gains_without(group, steeper)`: scale of slope at each ball of the group by a law of the others, where slopes
    of the balls in `steeper` are multiplied by a factor (`cross_validation.gains_without`).
    """
    for radius in sorted({*radii_mm.values()})[1:]:
        group = [number for number in radii_mm if radii_mm[number] == radius]
        if min(len(group), len(radii_mm) - len(group)) < MIN_OF_EACH:
            continue
        scale = _ln([*gains_without(group, {}).values()])
        log_ratio = float(np.median(scale))
        surely = abs(log_ratio) > max(MIN_CONTRADICTION, SIGMAS * mad_std(scale) / np.sqrt(scale.size))
        corrected = dict.fromkeys(group, float(np.exp(log_ratio)))
        if surely and abs(log_ratio) > SIGMAS * _between_halves(radii_mm, gains_without, corrected):
            others = sorted({*radii_mm.values()} - {radius})
            swapped = len(others) == 1 and abs(log_ratio - 2 * np.log(radius / others[0])) < abs(log_ratio) / 4
            wrong = f"The radii {radius:g} and {others[0]:g} look swapped" if swapped else "One radius is wrong"
            return [
                f"the stated ball radii contradict each other: by the other balls, those stated as {radius:g} mm "
                f"have the slopes of {radius / np.exp(log_ratio):.2g} mm. {wrong}, and so are depths: check "
                "ball_radius_mm in reference/ball.csv"
            ]
    return []


def _between_halves(
    radii_mm: Mapping[int, float], gains_without: GainsWithout, steeper: Mapping[int, float]
) -> float:
    """Return the rms of ln scale of one half of the balls by a law of the other, with slopes times `steeper`.

    Both halves have as many balls of each radius, so this is the error of a law of few balls at other places.
    """
    rng, off = np.random.default_rng(0), []
    groups = [[n for n in radii_mm if radii_mm[n] == radius] for radius in sorted({*radii_mm.values()})]
    for _ in range(SPLITS):
        half = [int(n) for group in groups for n in rng.permutation(group)[: max(len(group) // 2, 1)]]
        off.append(np.median(_ln([*gains_without(half, steeper).values()])))
    return float(np.sqrt(np.mean(np.square(off))))


def odd_balls(
    gains: Mapping[int, float],
    balls: Sequence[Ball | None],
    *,
    names: Sequence[str],
    unsure: Mapping[int, float],
    outlier_among: Callable[[Sequence[int]], Mapping[int, float]] = lambda suspects: {},
) -> list[str]:
    """Return warnings of single balls whose scale of slope, by a law without them, is far from that of all others.

    `unsure`: relative deviation of that law's scale at the ball. Where no ball exceeds the limit, `outlier_among`
    returns the outlier of the suspects with its scale.
    """
    scales = _ln([*gains.values()])
    scale = dict(zip(gains, scales.tolist(), strict=True))
    median, limit = float(np.median(scales)), max(MIN_OF_ONE, OUTLIER_SIGMA * mad_std(scales))
    off = {number: abs(scale[number] - median) for number in sorted(scale, key=lambda n: -abs(scale[n] - median))}
    odd = {
        number: float(np.exp(scale[number] - median))
        for number in off
        if off[number] > max(limit, SIGMAS * unsure.get(number, 0.0))
    }
    if not odd:
        odd |= outlier_among([number for number in off if off[number] > MIN_OF_ONE][:MAX_SUSPECTS])
    warnings = []
    for number, share in list(odd.items())[:MAX_NAMED]:
        ball = balls[number]
        assert ball is not None
        bound = min(max(share, MIN_NAMED_SHARE), 1.0 / MIN_NAMED_SHARE)
        beyond = "" if bound == share else "less than " if share < bound else "more than "
        times = f"{beyond}{bound:.2g}"
        warnings.append(
            f"{names[number] or f'ball {number + 1}'}: its slopes are {times} times those of a ball of "
            f"{ball.radius_mm:g} mm by the other balls: another radius, another light, or not its contact. "
            "Correct its ball_radius_mm, or remove it from the balls"
        )
    return warnings


def scale_warnings(change: Floats, slopes: Floats) -> list[str]:
    """Return a warning where the `change` (N, 3) of colours per slope (N, 2) exceeds that of any lamp.

    A lamp at an elevation e changes a matt surface by cot e per unit of slope, 4 at 15 degrees. A scale in mm per
    pixel that is stated too small, or a ball radius too large, gives too small slopes.
    """
    answer = float(np.sqrt(np.mean(change**2) / np.mean(slopes**2)))
    if answer < MAX_ANSWER:
        return []
    return [
        f"colours change {answer:.0f} times as much as the slopes by the stated sizes, under low lamps 1 to 4: "
        "is mm_per_px stated too small, or ball_radius_mm too large?"
    ]


def label_warnings(labels: Sequence[tuple[Pair | None, float | None]], balls: Sequence[Ball | None]) -> list[str]:
    """Return a warning where labelled circles, centre (x, y) and radius in px, differ from the detected ones."""
    pairs = [
        (centre, radius, ball)
        for (centre, radius), ball in zip(labels, balls, strict=True)
        if centre is not None and radius is not None and ball is not None
    ]
    moved = np.array([np.hypot(*np.subtract(centre, ball.centre_px)) for centre, _, ball in pairs])
    wider = np.array([radius / ball.contact_radius_px for _, radius, ball in pairs])
    allowed = MAX_LABEL_MOVE * np.array([ball.contact_radius_px for _, _, ball in pairs])
    off = (moved > allowed) | (np.abs(np.log(wider)) > np.log(MAX_LABEL_RATIO))
    if len(pairs) == 0 or off.mean() < MIN_LABELS_OFF:
        return []
    return [
        f"{off.sum()} of {len(pairs)} labelled circles differ from the detected ones: centres by "
        f"{np.median(moved):.1f} px, contact radii by a factor of {np.median(wider):.2g} (medians). The detected "
        "circles are used; check reference/ball.csv"
    ]


def coverage_warnings(cover: Floats) -> list[str]:
    """Return a warning where balls span little of the picture: `cover` (2,) is their share of width and height."""
    if cover.min() > COVERED:
        return []
    return [
        f"the ball presses cover {100 * cover[0]:.0f} % by {100 * cover[1]:.0f} % of the picture only; "
        "slopes elsewhere are extrapolated"
    ]


def observability_warnings(light: Observability) -> list[str]:
    """Return a warning where a direction of slope is lost in noise, or no colour lights one side."""
    uneven = light.worst > MAX_NOISE_RATIO * light.best
    worst = f"{light.worst:.2g} along {light.worst_deg:.0f} degrees (from x, right, to y, down)"
    if light.worst < (MAX_SLOPE_NOISE if uneven else MAX_EVEN_NOISE):
        if light.gap_deg < MAX_GAP_DEG:
            return []
        return [
            f"no colour lights the gel from a side {light.gap_deg:.0f} degrees wide, about {light.dark_deg:.0f} "
            "degrees (from x, right, to y, down): two lamps? The error of slopes is larger. Light that side in a "
            "third colour"
        ]
    if not uneven and light.worst < SLOPE_SOFTENING:
        return [
            f"these lights show slopes faintly: one of {worst}, of {light.best:.2g} across it, changes the "
            "colours by a pixel's noise. Depth is too shallow. Are the lamps' colours nearly alike? Light each "
            "side in a pure colour"
        ]
    return [
        f"these lights hardly show slopes of one direction: one of {worst} changes the colours by a pixel's "
        f"noise, across it {light.best:.2g} does. Do lamps of one colour face each other, or are all of one "
        "colour? Light each side in a colour of its own"
    ]


# One outlier among few balls, which biases the law that it is judged by. For each suspect
#
#     z = (ln g - ln m) / (s^2 + u^2 + (r d)^2)^(1/2)
#
# g is its scale of slope by a law of all others; m and s the median and the scatter (ln) of the scales of the
# others, each by a law without the suspect and a group of three; u the scatter of these laws at the suspect
# (delete-a-group jackknife, Efron, The Jackknife, the Bootstrap, SIAM 1982), u^2 = (2/3) sum (ln g_k - mean)^2; d
# the distance from the other balls in half pictures, r the error per half picture. Assumes one outlier.

MIN_OTHERS = 9  # balls; with fewer the scatter is unknown
MIN_SCATTER = 0.02  # of the scale: few balls may agree better by chance
MAX_OFF = 1.1  # of ln g: beyond a factor of three the law itself fails
LOST_BEYOND = 1.0  # of the scale per half picture; eight sets have .3 to 1.4
MIN_OUTLIER = 4  # deviations: correct balls reach 3 at most


def outlier_among(of: BallFit, suspects: Sequence[int]) -> dict[int, float]:
    """Return the outlier among `suspects`, numbers of balls, with its scale of slope; {} for none."""
    if len(np.unique(of.contact.press)) <= MIN_OTHERS:
        return {}
    seen = {number: _significance(number, of) for number in suspects}
    off, number = max(((abs(z), number) for number, (_, z) in seen.items()), default=(0.0, -1))
    return {number: float(np.exp(seen[number][0]))} if off > MIN_OUTLIER else {}


def _significance(number: int, of: BallFit) -> tuple[float, float]:
    """Return ln of a ball's scale over the median of the others, and z; zeros where it is beyond MAX_OFF."""
    suspect = of.contact.press == number
    ball, resting = of.contact.where(suspect), of.resting.where(of.resting.press != number)
    others = replace(of, contact=of.contact.where(~suspect), resting=resting)
    laws = others.law, *others.others
    scale, *parts = _ln([gains_of(one.at(ball.change, ball.place), ball)[number] for one in laws]).tolist()
    usual = _ln([*others.gains.values()])
    off = scale - float(np.median(usual))
    if abs(off) > MAX_OFF:
        return 0.0, 0.0
    beyond = LOST_BEYOND * beyond_others(of.contact, np.array([number]))[number]
    spread = (FOLDS - 1) * float(np.var(parts))  # the mean of three squares, times two
    return off, off / float(np.sqrt(max(mad_std(usual), MIN_SCATTER) ** 2 + spread + beyond**2))


def _ln(gains: Sequence[float]) -> Floats:
    """Return the natural logarithms (n,) of gains, at least 1/1000."""
    return np.asarray(np.log(np.maximum(gains, MIN_GAIN)))


# Contact in the reference: all pictures then show it with opposite sign, at one place. There their colours differ
# from the median picture by less than a fifth of the change; those of balls pressed at one place by a third.

MIN_PICTURES = 3  # that can be read
CHANGED_SHARE = 0.7  # of the pictures; in the others a ball may cover the place
# of the change, median over the place: pressed references of six sensors .03 to .12, of a seventh with four
# pictures .15 to .24; balls that are all pressed at one place, of two sensors, .31 and more
MAX_SCATTER = 0.2


def pressed_reference(
    change: ColourChange, pictures: Sequence[Bytes], balls: Sequence[Ball | None]
) -> tuple[Pair | None, float | None]:
    """Return where (x, y in px) the reference shows a contact, and the share of `balls` there; None if none."""
    shared = shared_contact(balls)
    contact_px = shared or contact_in_reference(change, pictures)
    if contact_px is None:
        return None, None
    known = [ball for ball in balls if ball is not None]
    if not known:
        return contact_px, None
    at = [np.hypot(*np.subtract(ball.centre_px, contact_px)) < ball.contact_radius_px for ball in known]
    share = float(np.mean(at))
    if shared is None and share >= MIN_SHARE:
        return None, None  # balls of several sizes, pressed at one place
    return contact_px, round(share, 3)


def contact_in_reference(change: ColourChange, pictures: Sequence[Bytes]) -> Pair | None:
    """Return where (x, y in px) the reference of `change` shows a contact, by ball `pictures` (H, W, 3)."""
    from skimage.measure import label, regionprops

    tracker, seen = change.tracker, list[FrameChange]()
    for rgb in pictures:
        with suppress(InputError):
            seen.append(change.take(rgb))
    if len(seen) < MIN_PICTURES:
        return None
    touched = [~one.drift.untouched for one in seen]
    usable = tracker.usable.reshape(touched[0].shape)
    place = solid((np.mean(touched, axis=0) > CHANGED_SHARE) & usable)
    place &= np.pad(np.ones(np.subtract(place.shape, 2), bool), 1)  # light and gel change at the border first
    for patch in sorted(regionprops(label(place)), key=lambda region: -region.area):
        rows, columns = patch.coords.T
        shrunk = partial(cv2.resize, dsize=tracker.size, interpolation=cv2.INTER_AREA)
        means = [[shrunk(plane) for plane in one.changes] for one in seen]
        if _relative_scatter(np.array(means)[:, :, rows, columns]) <= MAX_SCATTER:
            block = change.reference.shape[1] / tracker.size[0]
            return float(block * (np.median(columns) + 0.5)), float(block * (np.median(rows) + 0.5))
    return None


def _relative_scatter(here: Floats) -> float:
    """Return the relative scatter of changes (K, 3, n) at one place over pictures, the median over the place."""
    middle = np.median(here, axis=0)
    off = np.linalg.norm(np.median(np.abs(here - middle), axis=0), axis=0)
    return float(np.median(off / np.maximum(np.linalg.norm(middle, axis=0), TINY)))
