"""Circles of real balls against what needs no light's law: people clicked those of set E, a stage set those of I.

    python -m benchmarks.labelled_circles [CLONES]

Three things need no calibration. Slopes of a round dent are odd about its middle, and so are small changes of
colour: the middle is where they are oddest. A deeper press changes more of the picture. And under a hard ball the
gel has the ball's shape: two presses at one place show the same colours as far out as the smaller contact reaches.
A stage pressed the balls of I along a diagonal; how far, in mm, stands in the pictures' names.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import spearmanr

from benchmarks.peers import calibrated, clicked
from benchmarks.public_frames import i_digit
from benchmarks.real_frames import REAL, circles, real_balls
from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.photometric.ball_pictures import locate
from tactilevision.photometric.calibrate import direction_error_deg
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Bytes, Floats, Pair

CORE_PX = 16  # px from the middle within which changes are compared
SEARCH_PX = 28  # px from the clicked centre that a middle may lie
CHANGED = 0.1  # relative change of colour that counts as changed
BLUR_PX = 1.0  # px
AT_PX = (4, 8, 12, 16, 20, 28, 36)  # px from the middle
SAME_PLACE = (0, 7)  # a gentle and the deepest press, which lie a pixel apart
CLIPPED = 250.0  # grey level from which a colour may be overexposed


def main(clones: str = "", *, most: int | None = None) -> None:
    if REAL.is_dir():
        clicked_circles(most)
    else:
        print("the real frames are not at hand")
    if clones:
        staged_circles(Path(clones))


def staged_circles(clones: Path) -> None:
    """How far balls of set I lie off a straight line, and how far apart for each mm of the stage's travel."""
    reference, pictures, mm_per_px = i_digit(clones)
    colours = ColourChange(reference)
    alone: list[Ball | None] = []
    for picture in pictures:
        u, _, valid = colours.measure(picture.rgb)
        alone.append(locate(u, valid, picture=picture, mm_per_px=mm_per_px))
    places = [re.findall(r"[XY]([\d.]+)", one.name)[:2] for one in pictures]
    travel = np.array([np.hypot(float(x), float(y)) for x, y in places])
    print(f"set I: {1 / mm_per_px[0]:.1f} px in a mm are assumed")
    for name, balls in (("alone", alone), ("by the light of the others", circles(colours, pictures, mm_per_px))):
        print(f"found {name}: {stage_line(travel, balls)}")


def stage_line(travel_mm: Floats, balls: Sequence[Ball | None]) -> str:
    used = [number for number, ball in enumerate(balls) if ball is not None]
    centres = np.array([ball.centre_px for ball in balls if ball is not None])
    terms = np.stack([np.ones(len(used)), travel_mm[used]], axis=1)
    line = np.linalg.lstsq(terms, centres, rcond=None)[0]
    off = np.sqrt(np.mean(np.sum((centres - terms @ line) ** 2, axis=1)))
    return f"{len(used)} balls, {np.hypot(*line[1]):.1f} px in a mm, {off:.2f} px off a line (rms)"


def clicked_circles(most: int | None = None) -> None:
    """Judge the circles of the first `most` pictures of set E."""
    reference, pictures, mm_per_px = real_balls("E")
    pictures = pictures[:most]
    changes = [change(reference, one.rgb) for one in pictures]
    found = [ball for ball in calibrated(reference, pictures, mm_per_px).balls if ball is not None]
    labelled = [ball for ball in clicked(pictures)[1] if ball is not None]
    middles = [middle(u, ball.centre_px) for u, ball in zip(changes, labelled, strict=True)]
    size = [float(np.sqrt(np.sum(np.abs(u).max(axis=2) > CHANGED) / np.pi)) for u in changes]
    for name, balls in (("found", found), ("clicked", labelled)):
        off = [np.hypot(*np.subtract(b.centre_px, at)) for b, at in zip(balls, middles, strict=True)]
        radii = [ball.contact_radius_px for ball in balls]
        print(
            f"{name}: {np.median(off):.1f} px from the middle ({np.max(off):.1f} at most), "
            f"radii {min(radii):.0f} to {max(radii):.0f} px, "
            f"order with the changed area {spearmanr(radii, size).statistic:.2f}"
        )
    turned = np.concatenate([ideal_turn(ball, other) for ball, other in zip(found, labelled, strict=True)])
    print(f"round dents about the found middles, judged by the clicked ones: {np.median(turned):.1f} degrees off")
    first, last = (radial(changes[number], middles[number]) for number in SAME_PLACE)
    grown = [float(np.nanmedian(b[a > CHANGED] / a[a > CHANGED])) for a, b in zip(first, last, strict=True)]
    growth = dict(zip(AT_PX, np.round(grown, 2).tolist(), strict=True))
    print(f"colours of the deep press over those of the gentle one, by px from the middle: {growth}")


def change(reference: Reference, rgb: Bytes) -> Floats:
    """Relative change (H, W, 3) of a picture, NaN where a colour is overexposed, without the whole picture's."""
    free, now = (cv2.GaussianBlur(one.astype(np.float64), (0, 0), BLUR_PX) for one in (reference.rgb, rgb))
    u = np.asarray(now / np.maximum(free, 5.0) - 1.0, np.float64)
    u -= np.median(u.reshape(-1, 3), axis=0)
    u[now > CLIPPED] = np.nan
    return u


def middle(u: Floats, near: Pair) -> Pair:
    """Where (x, y in px) the changes (H, W, 3) are oddest, within SEARCH_PX of `near`."""
    y, x = (grid.ravel() for grid in np.mgrid[-CORE_PX : CORE_PX + 1 : 2, -CORE_PX : CORE_PX + 1 : 2])
    y, x = y[np.hypot(x, y) < CORE_PX], x[np.hypot(x, y) < CORE_PX]
    best, at = np.inf, near
    for cy in range(int(near[1]) - SEARCH_PX, int(near[1]) + SEARCH_PX + 1):
        for cx in range(int(near[0]) - SEARCH_PX, int(near[0]) + SEARCH_PX + 1):
            one, other = u[cy + y, cx + x], u[cy - y, cx - x]
            even = float(np.nansum((one + other) ** 2) / np.nansum(one**2 + other**2))
            if even < best:
                best, at = even, (float(cx), float(cy))
    return at


def ideal_turn(ball: Ball, judge: Ball) -> Floats:
    """Angles (N,) in degrees between slopes of `ball` and of `judge`, under the latter."""
    reach = int(0.93 * judge.contact_radius_px)
    y, x = (grid.ravel().astype(float) for grid in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    y, x = y[np.hypot(x, y) < reach], x[np.hypot(x, y) < reach]
    moved = np.subtract(judge.centre_px, ball.centre_px)
    slopes = [
        np.stack(ball_slopes(a, b, contact_mm=one.contact_radius_px, radius_mm=1e3), axis=1)
        for one, a, b in ((ball, x + moved[0], y + moved[1]), (judge, x, y))
    ]
    return direction_error_deg(slopes[0], slopes[1])


def radial(u: Floats, at: Pair) -> list[Floats]:
    """Size of the brightening (directions * 3,) at each of AT_PX from the middle; NaN where overexposed."""
    turn = np.arange(72) * 2.0 * np.pi / 72
    return [
        np.concatenate(
            [
                u[np.rint(at[1] + r * np.sin(turn)).astype(int), np.rint(at[0] + r * np.cos(turn)).astype(int), c]
                for c in range(3)
            ]
        )
        for r in AT_PX
    ]


def quick() -> None:
    main(most=8)


if __name__ == "__main__":
    main(*sys.argv[1:])
