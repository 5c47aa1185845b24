"""What ball presses say against themselves: radii that contradict each other, one contact in all of the pictures.

A ball whose radius is stated k times too large shows slopes 1/k of those that a law of the others expects: the
scale of slope at a ball that was left out, found over stated, is then k. One radius alone can never be told wrong
by slopes, two can. And a contact that was in the reference is in every picture, the wrong way round: where
it is taken for the ball, all balls lie at one place and are of one size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tactilevision.photometric.ball.detection import Ball
from tactilevision.records import Floats, Pair
from tactilevision.robust import mad_std

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
