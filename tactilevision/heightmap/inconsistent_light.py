"""Flag places whose colours the shading law does not explain.

Where balls determined the light's law (photometric/cross_validation.py), colours are compared with it. In cells,

    t^2 = sum over colours of <u - u_law(p, q)>^2 / ((2 n)^2 + (k <|u|>)^2)

u is the change of colour, p and q the slopes that are read from it; n is the local error on untouched gel, k the
relative error of held-out balls; < > is a mean over REACH_MM. A place is inconsistent where t exceeds LEAST and
the values in the calibration's own ball pictures, under and around the ball. Without balls, slopes s are compared
with the gradient of their surface z, since slopes of no surface come from a false light:

    |<s - grad z>| > CURL + CURL_SHARE <|s|>

Whatever its colours, gel outside a contact of depth d rises by no more than

    RISE_SHARE d + RISE_MM

since layer theory (nu .4999) gives a rise of .16 d around a ball (contact 1.7 gels in radius) and of .30 d around
a punch of 1.5 gels, which RISE_MM covers to 2 mm of depth. For a contact beyond the border d is unknown.
Within a ring the gel may rise by more than d, so enclosed places are excluded.

Three colours and two slopes leave one residual. A false slope with the colour of a true one is not detected: a
lamp shaded where the others are dark makes a hollow that no colour contradicts. Without balls, false slopes that
form a surface are not detected. Nothing is detected where a colour is overexposed, nor next to steep slopes, whose
depth has terms of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import cv2
import numpy as np

from tactilevision.heightmap.poisson import integrate_small
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture, pressed_balls
from tactilevision.photometric.ball_samples import OUTSIDE, radii_from
from tactilevision.photometric.colour_change import ChangeMaps, FrameChange
from tactilevision.photometric.cross_validation import LightLaw
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.shading_law import SLOPE_POWERS, answers_at
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Bytes, Pair, Picture
from tactilevision.robust import median

CELL_MM = 0.4  # mm, approximate side of a cell: finer ones take longer and show no more
REACH_MM = 0.76  # mm, deviation of the mean over neighbours: suppresses noise of single cells
# deviations from which a place is inconsistent, at least; 3 flags one clean real press of 82, but half the hollows
LEAST = 2.5
BORDER = 2  # excluded cells along the picture's border: gel and light change there first
NEARBY = 2.0  # contact radii: range in which a ball's own picture determines the usual value
REACHED = 99  # percentile of cells near a ball that gives the usual value
PICTURES = 75  # percentile of ball pictures below the limit: some contain false hollows themselves
CURL = 0.04  # slope by which those of real networks may differ from a surface's
CURL_SHARE = 0.1  # of the slopes themselves, the same
STEEP_SHARE = 0.6  # of the steepest slope calibrated: next to steeper ones, blur mixes colours of many slopes
RAMP = 0.4  # of the limit, from which on a slope counts in part as unexplained
GREY = 0.3  # grey levels: error of local means by rounding and compression
MIN_AREA_MM2 = 3  # mm^2 of inconsistent places that make a map doubtful: a dark corner of the picture has two
RISE_SHARE = 0.25  # of the depth; tests/photometric/test_inconsistent_light.py
RISE_MM = 0.1  # mm in addition: 235 pictures of samples and a path tracer have .05 in addition to .3 of the depth
MIN_DEPTH_MM = 0.05  # mm of depth that inconsistent places contribute: less makes no map doubtful


@dataclass(frozen=True, slots=True)
class Inconsistency:
    """In cells (h, w): which are `inconsistent`; depth in mm that unexplained slopes contribute.

    `area_mm2` of the inconsistent ones together.
    """

    inconsistent: Bools
    depth_mm: Picture
    area_mm2: float

    @property
    def doubtful(self) -> bool:
        """Return whether the map is doubtful."""
        return self.area_mm2 > MIN_AREA_MM2 and bool(np.abs(self.depth_mm).max() > MIN_DEPTH_MM)


class LightCheck:
    """Compares frames of one method with the light's law; quantities of the method alone are computed once."""

    def __init__(self, method: CalibratedMethod, mm_per_px: Pair) -> None:
        tile = method.change.tracker.px
        self.method, self.px = method, tile * max(1, round(CELL_MM / (tile * max(mm_per_px))))
        height, width = (n // self.px for n in method.reference.shape)
        self.size, self.whole = (width, height), (slice(0, height), slice(0, width))
        self.cell_mm = self.px * mm_per_px[0], self.px * mm_per_px[1]
        across, down = (2 * round(REACH_MM / mm) + 1 for mm in self.cell_mm)
        self.near = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, down))
        full = method.change.maps
        x, y = (
            np.asarray(at[: n * self.px].reshape(n, self.px).mean(axis=1))
            for at, n in ((full.x, width), (full.y, height))
        )
        self.maps = ChangeMaps(self._cells(full.mean), x, y, dark=full.dark)
        self.evaluate = method.law.averaged(
            np.median(method.change.noise, axis=(1, 2)).astype(np.float64)
        ).evaluator((height, width))
        self.kept_share = self._cells(method.kept_share[None])[0]
        self.bias = self._cells(method.bias) - self._cells(np.stack(method.noise_bias)) * self.kept_share
        self.usable = self._cells(method.readable[None].astype(np.float32))[0] > 0.99
        inner = np.zeros((height, width), np.bool_)
        inner[BORDER:-BORDER, BORDER:-BORDER] = True  # in a strip no cell counts
        self.usable &= inner
        self.steep = STEEP_SHARE * (method.card.steepest_slope or 0.0)
        light = self.light = method.light_law
        if light is not None:
            place = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)
            answers = answers_at(light.terms, place).reshape(height, width, -1, 3)
            self.answers: Picture = np.ascontiguousarray(answers.transpose(2, 3, 0, 1), np.float32)
            noise = np.stack([cv2.resize(plane, self.size) for plane in light.noise])
            self.noise_square = self._noise_square(noise)

    def __call__(self, frame: FrameChange) -> Inconsistency:
        """Return the inconsistent cells of a frame."""
        change, slopes, known = self.read(frame)
        score, share = self._curl(slopes) if self.light is None else self._colours(change, slopes)
        score *= known
        if self.steep:
            score[cv2.dilate(_length(slopes), self.near) > self.steep] = 0.0
        share *= np.clip((score - RAMP) / (1.0 - RAMP), 0.0, 1.0)
        depth = np.zeros_like(score)
        if share.any():
            np.minimum(share, 1.0, out=share)
            depth = integrate_small(slopes * share, self.cell_mm)
            depth -= median(depth.ravel())
        inconsistent = score > 1.0
        return Inconsistency(inconsistent, depth, float(inconsistent.sum() * self.cell_mm[0] * self.cell_mm[1]))

    def read(self, frame: FrameChange) -> tuple[Picture, Picture, Bools]:
        """Return changes (3, h, w) of the cells of a frame, their slopes (2, h, w), and which (h, w) count."""
        known = self.usable
        if frame.missing is not None:
            known = known & (frame.missing.tiles(self.px, self.size) == 0)
        if self.method.reference.marks is None:
            px, light = self.method.change.tracker.px, self.maps.light(frame.drift.gains)
            change = self.maps.changes(self._cells(frame.means(px), px), self.whole, light)
        else:  # marks are filled in the whole picture
            change = self._cells(frame.changes)
        slopes: Picture = np.empty((2, *change.shape[1:]), np.float32)
        self.evaluate.strip(change, self.whole, slopes)
        slopes *= self.kept_share
        slopes -= self.bias
        return change, slopes, known

    def _colours(self, change: Picture, slopes: Picture) -> tuple[Picture, Picture]:
        """Return t over its limit, and the unexplained share of the change of colour, (h, w) each."""
        assert self.light is not None
        off, size = self.residual(change, slopes), self._size(change)
        return self.deviations(off, size) / np.float32(self.light.limit), _length(off) / (size + TINY)

    def deviations(self, off: Picture, size: Picture) -> Picture:
        """Return t (h, w) of residuals (3, h, w) of changes of a mean `size` (h, w)."""
        usual = np.float32(self.light.share if self.light else 0.0) * size
        return np.asarray(np.sqrt((off * off / (self.noise_square + usual * usual)).sum(axis=0)))

    def _noise_square(self, noise: Picture) -> Picture:
        """Return the variance (3, h, w) of changes of cells, for `noise` (3, h, w) of untouched gel."""
        return np.asarray(np.square(2.0 * noise) + np.square(GREY * self.maps.scale))

    def _size(self, values: Picture) -> Picture:
        """Return the mean length (h, w) of values (n, h, w) over REACH_MM."""
        return self._mean(_length(values))

    def residual(self, change: Picture, slopes: Picture) -> Picture:
        """Return the light law's residual of changes (3, h, w) at slopes (2, h, w), means over REACH_MM."""
        p, q = (
            np.stack(list(accumulate([slope] * 4, np.multiply, initial=np.ones_like(slope)))) for slope in slopes
        )
        i, j = np.array(SLOPE_POWERS).T
        light = np.einsum("kchw,khw->chw", self.answers, p[i] * q[j])
        light += 1.0
        light /= np.sqrt(1.0 + p[2] + q[2])
        return np.stack([self._mean(plane) for plane in change + 1.0 - light])

    def _curl(self, slopes: Picture) -> tuple[Picture, Picture]:
        """Return the curl part of slopes (2, h, w) over its limit, and over the slopes, (h, w) each."""
        depth = integrate_small(slopes, self.cell_mm)
        down, across = np.gradient(depth, self.cell_mm[1], self.cell_mm[0])
        off = _length(np.stack([self._mean(slopes[0] - across), self._mean(slopes[1] - down)]))
        size = self._size(slopes)
        return off / (CURL + CURL_SHARE * size), off / (size + TINY)

    def _mean(self, plane: Picture) -> Picture:
        reach = REACH_MM / self.cell_mm[0], REACH_MM / self.cell_mm[1]
        return np.asarray(cv2.GaussianBlur(plane, (0, 0), reach[0], sigmaY=reach[1]))

    def _cells(self, planes: Picture | Bytes, px: int = 1) -> Picture:
        """Return means (n, h, w) over the cells of planes (n, H // px, W // px) of `px`-pixel means."""
        columns, rows = (n * (self.px // px) for n in self.size)
        return np.stack(
            [cv2.resize(one[:rows, :columns], self.size, interpolation=cv2.INTER_AREA) for one in planes]
        )


def rises_too_much(depth_mm: Picture) -> bool:
    """Return whether `depth_mm` (H, W) in mm, positive into the gel, rises more than gel around such depth can.

    Gel that contacts enclose, as within a ring, is displaced inwards; its rise is not limited.
    """
    low, high, *_ = cv2.minMaxLoc(depth_mm)
    limit = RISE_SHARE * max(high, 0.0) + RISE_MM
    if -low <= limit:
        return False
    beside = np.ones(depth_mm.shape, np.uint8)
    if high > 0:
        pressed = cv2.findNonZero((depth_mm > high / 2).astype(np.uint8))
        cv2.fillConvexPoly(beside, cv2.convexHull(pressed), (0.0,))
    return bool((depth_mm[beside > 0] < -limit).any())


def _length(values: Picture) -> Picture:
    return np.asarray(np.sqrt(np.square(values).sum(axis=0)), np.float32)


def measured_light(
    method: CalibratedMethod,
    pictures: Sequence[BallPicture],
    *,
    balls: Sequence[Ball | None],
    free: Sequence[Bytes],
    mm_per_px: Pair,
) -> LightLaw | None:
    """Return the method's light law with its noise and limit, from ball pictures and rectified frames of `free`
    gel.

    A picture is (H, W, 3), in grey. None where the method has no law.
    """
    if method.light_law is None:
        return None
    check = LightCheck(method, mm_per_px)
    shown: list[tuple[Bytes, Ball | None]] = [*pressed_balls(pictures, balls), *((rgb, None) for rgb in free)]
    sizes, off, radii = [], [], []
    for rgb, ball in shown:
        change, slopes, _ = check.read(method.change.take(rgb))
        sizes.append(check._size(change))
        off.append(check.residual(change, slopes))
        apart = (
            np.full(method.reference.shape, np.inf)
            if ball is None
            else radii_from(ball, method.reference.shape, mm_per_px=mm_per_px)
        )
        radii.append(check._cells(apart[None].astype(np.float32))[0])
    noise = _usual_length(np.stack(off), np.stack(radii)[:, None] > OUTSIDE)
    noise = np.stack([check._mean(one) for one in noise])
    check.noise_square = check._noise_square(noise)
    reached = [
        np.percentile(check.deviations(*one)[near <= NEARBY], REACHED)
        for *one, near, (_, ball) in zip(off, sizes, radii, shown, strict=True)
        if ball is not None and (near <= NEARBY).any()  # a contact of a few pixels fills no cell
    ]
    limit = max(LEAST, float(np.percentile(reached or [LEAST], PICTURES)))
    return dataclasses.replace(method.light_law, noise=noise, limit=limit)


def _usual_length(off: Picture, known: Bools) -> Picture:
    """Return the root of the median square (3, h, w) over pictures (n, 3, h, w) where `known` (n, 1, h, w)."""
    hidden = np.ma.masked_where(np.broadcast_to(~known, off.shape), np.square(off))
    square = np.ma.median(hidden, axis=0)  # type: ignore[no-untyped-call]
    usual = np.ma.median(hidden, axis=(0, 2, 3)).filled(0.0)  # type: ignore[no-untyped-call]
    return np.asarray(np.sqrt(np.where(np.ma.getmaskarray(square), usual[:, None, None], square.data)), np.float32)
