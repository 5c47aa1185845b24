"""Check the consistency of ball presses: stated radii, outliers, and contact in the reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.cross_validation import FOLDS, Fitter, beyond_others, gains_of, held_out
from tactilevision.photometric.drift import solid
from tactilevision.records.measured import Bytes, Floats, Pair
from tactilevision.robust import mad_std

# What ball presses say against themselves: radii that contradict each other, one contact in all of the pictures.
#
# A ball whose radius is stated k times too large shows slopes 1/k of those that a law of the others expects: the
# scale of slope at a ball that was left out, found over stated, is then k. One radius alone can never be told
# wrong by slopes, two can. And a contact that was in the reference is in every picture, the wrong way round: where
# it is taken for the ball, all balls lie at one place and are of one size.

COVERED = 0.5  # of either side: balls in less of it leave most of the light to be guessed
SAME_PLACE = 0.15  # of the contact's radius: places of presses by hand or stage differ by more
SAME_SIZE = 0.1  # of the contact's radius: sizes of presses by hand or stage differ by more
MIN_SHARE = 0.75  # of the balls; the others are seen between the two contacts
MIN_OF_EACH = 3  # balls of one radius; one odd ball moves the median of fewer
MIN_CONTRADICTION = 0.1  # of the scale: places and sizes differ by half of it
SIGMAS = 3.0  # deviations by which scales must differ: chance alone does so once in 370 times
SPLITS = 8  # of the balls in two halves, each of all radii: how well a law of few balls reads the others
MIN_OF_ONE = 0.3  # a single ball in a dark corner may be off as much
OUTLIER_SIGMA = 5.0  # times the scatter of the others
MAX_ANSWER = (
    5.0  # relative change of colour for a unit of slope: lamps at 11 degrees; real sensors have 1.2 to 1.7
)
MAX_LABEL_MOVE = 0.25  # of the contact radius: clicks of a hand lie within .1
MAX_LABEL_RATIO = 1.35  # of contact radii: circles by eye are up to 1.3 times as wide as what is fitted
MIN_LABELS_OFF = 0.25  # of the labels: a single slip moves nothing
MAX_SUSPECTS = 5  # balls that are looked at once more, each for the time of four fits
MAX_NAMED = 3  # odd balls that are named in warnings, the oddest first
MIN_NAMED_SHARE = 0.1  # share of the expected slopes; below it, or above its inverse, a figure says no more


GainsWithout = Callable[[Sequence[int], Mapping[int, float]], Mapping[int, float]]


def shared_contact(balls: Sequence[Ball | None]) -> Pair | None:
    """Where (x, y in px) MIN_SHARE of the balls found lie, if they are one and the same contact; else None."""
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
    """A warning where stated radii (mm, by the number of the ball) contradict each other.

    `gains_without` some balls: the scale of slope at each of them by a law of the others
    (`cross_validation.gains_without`), where those that it names second are steeper by a factor than stated.
    """
    for radius in sorted({*radii_mm.values()})[1:]:
        group = [number for number in radii_mm if radii_mm[number] == radius]
        if min(len(group), len(radii_mm) - len(group)) < MIN_OF_EACH:
            continue
        scale = np.log(np.maximum(list(gains_without(group, {}).values()), 1e-3))
        log_ratio = float(np.median(scale))
        surely = abs(log_ratio) > max(MIN_CONTRADICTION, SIGMAS * mad_std(scale) / np.sqrt(scale.size))
        mended = dict.fromkeys(group, float(np.exp(log_ratio)))  # as if it were so
        if surely and abs(log_ratio) > SIGMAS * _between_halves(radii_mm, gains_without, mended):
            others = sorted({*radii_mm.values()} - {radius})
            swapped = len(others) == 1 and abs(log_ratio - 2 * np.log(radius / others[0])) < abs(log_ratio) / 4
            wrong = f"The radii {radius:g} and {others[0]:g} look swapped" if swapped else "One radius is wrong"
            return [
                f"the stated ball radii contradict each other: by the others, balls stated as {radius:g} mm have "
                f"slopes as of {radius / np.exp(log_ratio):.2g} mm. {wrong}, and depth with it: see "
                "ball_radius_mm in reference/ball.csv"
            ]
    return []


def _between_halves(
    radii_mm: Mapping[int, float], gains_without: GainsWithout, steeper: Mapping[int, float]
) -> float:
    """Deviation of ln of the scale of one half of the balls by a law of the other, their slopes `steeper` as told.

    Each half has as many balls of each radius: that a law of few balls reads other places wrongly is left.
    """
    rng, off = np.random.default_rng(0), []
    groups = [[n for n in radii_mm if radii_mm[n] == radius] for radius in sorted({*radii_mm.values()})]
    for _ in range(SPLITS):
        half = [int(n) for group in groups for n in rng.permutation(group)[: max(len(group) // 2, 1)]]
        off.append(np.median(np.log(np.maximum(list(gains_without(half, steeper).values()), 1e-3))))
    return float(np.sqrt(np.mean(np.square(off))))


def odd_balls(
    gains: Mapping[int, float],
    balls: Sequence[Ball | None],
    *,
    names: Sequence[str],
    unsure: Mapping[int, float],
    second_look: Callable[[Sequence[int]], Mapping[int, float]] = lambda suspects: {},
) -> list[str]:
    """Warnings of single balls whose scale of slope is far from that of all others, each left out of its law.

    `unsure` says how far that law's scale may be off at the ball: in a corner without another one it is no wonder.
    Where none is named, `second_look` says of the suspects which one is, by its scale (`second_look.py`).
    """
    scale = {number: float(np.log(max(gain, 1e-3))) for number, gain in gains.items()}
    scales = np.array(list(scale.values()))
    median, limit = float(np.median(scales)), max(MIN_OF_ONE, OUTLIER_SIGMA * mad_std(scales))
    off = {number: abs(scale[number] - median) for number in sorted(scale, key=lambda n: -abs(scale[n] - median))}
    odd = {
        number: float(np.exp(scale[number] - median))
        for number in off
        if off[number] > max(limit, SIGMAS * unsure.get(number, 0.0))
    }
    if not odd:
        odd |= second_look([number for number in off if off[number] > MIN_OF_ONE][:MAX_SUSPECTS])
    warnings = []
    for number, share in list(odd.items())[:MAX_NAMED]:
        ball = balls[number]
        assert ball is not None
        bound = min(max(share, MIN_NAMED_SHARE), 1.0 / MIN_NAMED_SHARE)
        beyond = "" if bound == share else "less than " if share < bound else "more than "
        times = f"{beyond}{bound:.2g}"
        warnings.append(
            f"{names[number] or f'ball {number + 1}'}: its slopes are {times} times what the other balls make of "
            f"one of {ball.radius_mm:g} mm: another radius, light unlike any other ball's, or not its contact. "
            "Correct its ball_radius_mm, or take it out of the balls"
        )
    return warnings


def reference_warnings(contact_px: Pair | None) -> list[str]:
    """A contact in the reference is named alone: with it most balls are odd."""
    if contact_px is None:
        return []
    x, y = contact_px
    return [
        f"the ball pictures differ from the reference near ({x:.0f}, {y:.0f}) px, and alike: a contact in the "
        "reference. Take a picture of the untouched gel for reference/flat; if all balls were pressed there, "
        "press them elsewhere as well"
    ]


def scale_warnings(change: Floats, slopes: Floats) -> list[str]:
    """A warning where colours `change` (N, 3) more for `slopes` (N, 2) than lamps make them.

    A lamp at an elevation e changes a matt surface by cot e for a unit of slope, 4 at 15 degrees. A scale in mm
    per pixel that is stated too small, or a ball too large, makes slopes smaller than they are.
    """
    answer = float(np.sqrt(np.mean(change**2) / np.mean(slopes**2)))
    if answer < MAX_ANSWER:
        return []
    return [
        f"colours change {answer:.0f} times as much as the gel is said to slope, and low lamps make 1 to 4: "
        "is mm_per_px stated too small, or ball_radius_mm too large?"
    ]


def label_warnings(labels: Sequence[tuple[Pair | None, float | None]], balls: Sequence[Ball | None]) -> list[str]:
    """A warning where labelled circles, centre (x, y) and contact radius in px, are not what the pictures show."""
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
        f"{off.sum()} of {len(pairs)} labelled circles are not what their pictures show: centres lie "
        f"{np.median(moved):.1f} px beside, contact radii are {np.median(wider):.2g} times those (medians). The "
        "pictures' own circles are used; see reference/ball.csv"
    ]


def coverage_warnings(cover: Floats) -> list[str]:
    """A warning where balls span little of the picture: `cover` (2,) is their share of its width and height.

    Balls all in one corner say nothing about the light elsewhere.
    """
    if cover.min() > COVERED:
        return []
    return [
        f"the ball presses cover {100 * cover[0]:.0f} % by {100 * cover[1]:.0f} % of the picture only; "
        "slopes elsewhere are extrapolated"
    ]


# One odd ball among few: the law that it helped to make leans to it, so that it hides.
#
# Each suspect is left out of all that judges it:
#
#     z = (ln g - ln m) / (s^2 + u^2 + (r d)^2)^(1/2)
#
# g is its scale of slope by a law of all others; m and s the median and the scatter (ln) of the others' own
# scales, each by a law that lacks its group of three as well; u what these laws scatter about the suspect, a
# jackknife that deletes a group at a time: u^2 = (2/3) sum (ln g_k - mean)^2 (Efron, The Jackknife, the Bootstrap,
# SIAM 1982); d how far it lies beyond the others in half pictures, r what their law loses there. None else has a
# unit. Assumes one odd ball.

MIN_OTHERS = 9  # balls: the scatter of fewer is not known
MIN_SCATTER = 0.02  # of the scale: few balls may agree better by chance
MAX_OFF = 1.1  # of ln g: no one states a radius three times; a law that is as far off fails itself
LOST_BEYOND = 1.0  # of the scale for each half picture; eight sets have .3 to 1.4: real_frames.md
STANDS_OUT = 4.0  # deviations: sound balls come to 3 at most; real_frames.md, one ball of ten


def second_look(
    suspects: Sequence[int], fit: Fitter, *, contact: Samples, untouched_samples: Samples, ridge: float
) -> dict[int, float]:
    """The scale of slope, found over expected, a ratio, of the one of `suspects` that stands out; {} for none.

    `suspects` are numbers of balls in `contact`; `fit` and `ridge` make the law.
    """
    if len(np.unique(contact.press)) <= MIN_OTHERS:
        return {}
    seen = {number: _judged(number, fit, contact, untouched_samples, ridge) for number in suspects}
    off, number = max(((abs(z), number) for number, (_, z) in seen.items()), default=(0.0, -1))
    return {number: float(np.exp(seen[number][0]))} if off > STANDS_OUT else {}


def _judged(
    number: int, fit: Fitter, contact: Samples, untouched_samples: Samples, ridge: float
) -> tuple[float, float]:
    """How far (ln) the scale at a ball is off what the others have, and z; zeros where it is beyond MAX_OFF."""
    suspect = contact.press == number
    ball, others = contact.where(suspect), contact.where(~suspect)
    resting = untouched_samples.where(untouched_samples.press != number)
    slopes, laws = held_out(fit, others, untouched_samples=resting, ridge=ridge)
    law = fit(others, resting, ridge=ridge)
    scale, *parts = (_ln(gains_of(one.at(ball.change, ball.place), ball)[number]) for one in (law, *laws))
    usual = np.array([_ln(gain) for gain in gains_of(slopes, others).values()])
    off = scale - float(np.median(usual))
    if abs(off) > MAX_OFF:
        return 0.0, 0.0
    beyond = LOST_BEYOND * beyond_others(contact, np.array([number]))[number]
    spread = (FOLDS - 1) * float(np.var(parts))  # the mean of three squares, times two
    return off, off / float(np.sqrt(max(mad_std(usual), MIN_SCATTER) ** 2 + spread + beyond**2))


def _ln(gain: float) -> float:
    return float(np.log(max(gain, 1e-3)))


# Was the gel touched when its reference was taken? Ball pictures then show that contact, the wrong way round.
#
# It stands at one place in all pictures, and alike: the colours of a picture there differ from the middle one by
# less than a fifth of the change. Real balls that are all pressed at one place, ever deeper, differ by a third;
# where they do not, their sizes do.

MIN_PICTURES = 3  # that can be read
CHANGED_SHARE = 0.7  # of the pictures; in the others a ball may press the place itself
# of the change, median over the place: pressed references of six sensors .03 to .12, of a seventh with four
# pictures .15 to .24; balls that are all pressed at one place, of two sensors, .31 and more
MAX_SCATTER = 0.2


def pressed_reference(
    change: ColourChange, pictures: Sequence[Bytes], balls: Sequence[Ball | None]
) -> tuple[Pair | None, float | None]:
    """Where (x, y in px) the reference shows a contact, and the share of `balls` found there; None if none."""
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
        return None, None  # balls of all sizes, pressed at one place
    return contact_px, round(share, 3)


def contact_in_reference(change: ColourChange, pictures: Sequence[Bytes]) -> Pair | None:
    """Where (x, y in px) the reference of `change` shows a contact, by ball pictures (H, W, 3); None if none."""
    tracker = change.tracker
    changes, touched = [], []
    for rgb in pictures:
        with suppress(InputError):
            seen, drift, _ = change.measure(rgb)
            changes.append([cv2.resize(one, tracker.size, interpolation=cv2.INTER_AREA) for one in seen])
            touched.append(~drift.untouched)
    if len(changes) < MIN_PICTURES:
        return None
    usable = tracker.usable.reshape(touched[0].shape)
    place = solid((np.mean(touched, axis=0) > CHANGED_SHARE) & usable)
    place &= np.pad(np.ones(np.subtract(place.shape, 2), bool), 1)  # light and gel change at the border first
    patches = cv2.connectedComponents(place.astype(np.uint8))[1]
    for _, number in sorted((-np.count_nonzero(patches == n), n) for n in range(1, patches.max() + 1)):
        patch = patches == number
        if _scatter(np.array(changes)[:, :, patch]) <= MAX_SCATTER:
            rows, columns = np.nonzero(patch)
            block = change.reference.shape[1] / tracker.size[0]
            return float(block * (np.median(columns) + 0.5)), float(block * (np.median(rows) + 0.5))
    return None


def _scatter(here: Floats) -> float:
    """How far pictures' changes (K, 3, n) at one place differ, over the middle one; the median over the place."""
    middle = np.median(here, axis=0)
    off = np.linalg.norm(np.median(np.abs(here - middle), axis=0), axis=0)
    return float(np.median(off / np.maximum(np.linalg.norm(middle, axis=0), 1e-9)))
