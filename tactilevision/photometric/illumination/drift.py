"""Follows the light: how brightness has drifted since the reference was taken, seen on the untouched gel.

    I^p = A I_0^p + o      then times 1 + g_x X + g_y Y      X, Y from -1 to 1 over the picture

I^p is light (`camera_response.py`); A mixes the channels a little where lamps fade apart, o is stray light's. It
is fitted by iteratively reweighted least squares on block means, so that a contact (whose colours leave the
pattern) and what lies close to it do not count: first as a gain with a plane, which is held to a part of the gain,
as the gel's gentle slopes round a contact look much like an uneven drift; and once it is known which blocks count,
`drift_priors.py` tells drift, its kind and those slopes apart. Valid while less than about half of the picture is
touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.compiled import compiled
from tactilevision.errors import InputError
from tactilevision.photometric.illumination.block_means import Planes, means, shares, tile_px_of
from tactilevision.photometric.illumination.camera_response import SOFTENING_GREY, Response
from tactilevision.photometric.illumination.drift_priors import OTHERS, TERMS, drift_of, likely_slopes, noise_of
from tactilevision.photometric.reference import Reference
from tactilevision.records import Bools, Bytes, Floats
from tactilevision.records.contact_thresholds import colour_limit
from tactilevision.robust import median

BLOCKS = 600  # blocks over the picture, about
MAX_ITERATIONS = 3  # rounds of reweighting; each frame pays for every one
# of the brightness, far below a grey level: a round that moves the drift by less is the last
CONVERGENCE_TOL = 3e-4
DETECTION_SIGMA = 5.0  # deviations of a block's noise by which most blocks differ from the reference: no noise
MAX_SWAPPED_SHARE = 0.3  # of that difference, when it all but goes with red and blue in each other's place
BITS = (3.5, 80.0)  # times darker: from 14 bits in 16, with noise, to 10 bits
COMPRESSED_GREY = 0.3  # what rounding and compression leave on a block's mean
MEDIAN_LENGTH = 1.5382  # median length of three standard normal numbers
MIN_BLOCKS = 30  # blocks away from contacts; with fewer, those beside contacts count in the fit as well
PLANE_SHARE = 0.3  # a lamp that fades does so all over its picture: its plane is a part of its mean
MIN_PLANE = 2e-4  # of the brightness: the plane's deviation where the mean has not drifted at all
MIN_DRIFT = 1e-3  # drift whose pattern is lost in the noise
SOLID = np.ones((2, 2), np.uint8)  # blocks that a contact fills at least
NEAR = np.ones((8, 8), np.uint8)  # these, and 3 on either side
CORRELATED = 20.0  # blocks whose errors, gentle slopes of the gel among them, hang together


@dataclass(frozen=True, slots=True)
class Drift:
    """`gains` (3 channels, 3): constant, x, y in parts of the brightness of a picture on which `undo` (3, 4) has
    been used, an affine map of its light; None: of the picture as it is.

    `untouched` (h, w): blocks that follow it; `normalised_residual` (h, w) in noise. `covariance` (18, 18): of
    constant, x, y, stray light, and parts of the other two channels, channel by channel; None where nothing has
    drifted. `misfit`: median residual, of what is touched, too. `left` (3, blocks): what the drift leaves of each
    channel, in noise.
    """

    gains: Floats
    untouched: Bools
    normalised_residual: Floats
    undo: Floats | None = None
    covariance: Floats | None = None
    misfit: float = 0.0
    left: Floats | None = None


class DriftTracker:
    """Measures the drift of frames against one reference; what depends on the reference alone is made once."""

    def __init__(self, reference: Reference, response: Response) -> None:
        height, width = reference.shape
        self.power, self.dark = response.power, reference.dark_colour
        block = max(4, int(np.sqrt(height * width / BLOCKS)))
        self.size = (max(2, width // block), max(2, height // block))
        self.px = tile_px_of(reference)
        share = cv2.resize(reference.usable.astype(np.float32), self.size, interpolation=cv2.INTER_AREA)
        self.usable = (share > 0.5).ravel()
        if not self.usable.any():
            raise InputError("no part of the reference is bright enough and free of marks", where="the reference")
        noise = np.asarray(reference.noise_grey)[:, None]
        self.noise = np.sqrt(noise**2 / block**2 + COMPRESSED_GREY**2)  # of a block's mean
        x, y = np.meshgrid(_centres(self.size[0], width), _centres(self.size[1], height))
        self.basis = np.stack([np.ones_like(x), x, y], axis=-1).reshape(-1, 3)
        self.squares = (self.basis[:, :, None] * self.basis[:, None, :]).reshape(-1, 9)
        self.means = means(reference.rgb, self.px)  # of the last frame that was measured
        self.down = shares(self.means.shape[1], self.size[1])
        self.across = np.ascontiguousarray(shares(self.means.shape[2], self.size[0]).T)
        self.level = self._blocks(self.means)
        self.all_usable = bool(self.usable.all())
        self._bright, self._shown, self._bend = np.empty((3, *self.level.shape))
        answers = response.to_slope(self.basis[:, 1], self.basis[:, 2])
        self._answers: Floats = np.eye(3)[:, :, None] if answers is None else answers
        self._to_slopes = np.empty((*self._answers.shape[:2], len(self.basis)))
        self._terms, self._normal = np.empty((3, TERMS, len(x.ravel()))), np.empty((len(x.ravel()), 27))
        self._update_level()

    def follow(self, rgb: Bytes, share: float) -> None:
        """Count from a picture moved towards `rgb` by `share`: what the reference follows is drift no more."""
        self.level += share * (self._blocks(means(rgb, self.px)) - self.level)
        self._update_level()

    def measure(self, rgb: Bytes) -> Drift:
        """The drift of a rectified frame. Raises InputError where it cannot be one of this sensor's."""
        blocks = self._blocks(means(rgb, self.px, out=self.means))
        if self.dark is not None:
            blocks[self.dark] = self.level[self.dark]
        change = blocks - self.level
        self._check(blocks, change)
        gains = np.zeros((3, 3))
        gains[:, 0] = median(self._among_usable(change / self._bright))
        change /= self.noise
        gains, weights, touched, limit = self._reweighted(change, gains)
        drift, undo, covariance = gains, None, None
        if np.abs(gains[:, 0]).max() > MIN_DRIFT:
            if self.power == 2:
                change *= 1.0 + self._bend * change
            drift, covariance = self._separated(change, weights, gains[:, 0], touched)
            gains, undo = self._inverse(drift)
        left = self._left(change, drift)
        squares = np.add.reduce(left * left)
        shape = (self.size[1], self.size[0])
        untouched = (self.usable & (squares < limit)).reshape(shape)
        misfit = float(median(self._among_usable(squares))) ** 0.5
        return Drift(gains, untouched, np.sqrt(squares).reshape(shape), undo, covariance, misfit, left)

    def _reweighted(self, change: Floats, gains: Floats) -> tuple[Floats, Floats, Bools, float]:
        """Gains (3, 3) fitted from a start; the blocks' weights, and which are touched (blocks,); their limit."""
        if compiled():
            from tactilevision.photometric.illumination.drift_kernels import reweighted

            tables = self._shown, self._terms, self.basis, self._normal, self.usable, self.size[0]
            limits = MEDIAN_LENGTH**2, colour_limit(1.0), PLANE_SHARE, MIN_PLANE, CORRELATED
            return reweighted(change, gains, *tables, *limits, MIN_BLOCKS, MAX_ITERATIONS, CONVERGENCE_TOL)
        weighted = change * self._shown
        for _ in range(MAX_ITERATIONS):
            squares = self._squares(change, gains)
            scale = max(1.0, float(median(self._among_usable(squares))) / MEDIAN_LENGTH**2)
            weights = squares * (1.0 / (9.0 * scale))
            weights += 1.0
            weights *= weights
            np.divide(self.usable, weights, out=weights)
            touched = self.usable & (squares > colour_limit(scale))
            near_contact = self._near_contact(touched)
            fitting = weights if near_contact is None else weights * ~near_contact
            if near_contact is not None and np.count_nonzero(fitting) < MIN_BLOCKS:
                fitting = weights
            before, gains = gains, self._fit(weighted, fitting, gains[:, 0])
            if np.abs(gains - before).max() < CONVERGENCE_TOL:
                break
        return gains, fitting, touched, colour_limit(scale)

    @property
    def effects(self) -> Floats:
        """Grey levels (3, 6, blocks) that a unit of each coefficient in a drift's covariance adds to a channel."""
        return np.asarray(self._terms * self.noise[:, :, None])

    @property
    def slope_effects(self) -> Floats:
        """What a slope of 1 along x and y adds to a channel (3, 2, blocks), in noise; (3, 3, blocks) of 1 each
        where no ball has told it.
        """
        return self._to_slopes

    def _update_level(self) -> None:
        """What depends on the level alone: in units of the noise, over the basis, and its normal equations."""
        self.mean_grey = float(self._among_usable(self.level).mean())
        self.clear_grey = DETECTION_SIGMA * float(self.noise.mean())
        np.maximum(self.level, 1.0, out=self._bright)
        np.divide(self.level, self.noise, out=self._shown)
        np.multiply(self._shown[:, None, :], self.basis.T, out=self._terms[:, :3])
        np.divide(0.5 * self.noise, self._bright, out=self._bend)  # change of light to second order
        self.grey = self._among_usable(self.level).mean(axis=1)
        np.multiply(self._answers, ((self.level + SOFTENING_GREY) / self.noise)[:, None], out=self._to_slopes)
        light = self._bright**self.power
        self.light = self._among_usable(light).mean(axis=1)
        light /= self.light[:, None]
        per_light = self._shown / (self.power * light)
        self._terms[:, 3] = per_light
        for c, others in enumerate(OTHERS):
            for term, j in zip((4, 5), others, strict=True):
                self._terms[c, term] = (light[j] - light[c]) * per_light[c]
        squares = self._normal.reshape(-1, 3, 9).transpose(1, 0, 2)
        np.multiply(np.square(self._shown)[:, :, None], self.squares, out=squares)

    def _among_usable(self, values: Floats) -> Floats:
        """`values` (..., blocks) of the usable blocks."""
        return values if self.all_usable else values[..., self.usable]

    def _near_contact(self, touched: Bools) -> Bools | None:
        """Blocks near enough to a contact for its slopes to pass for drift; a lone noisy block is none."""
        if not touched.any():
            return None
        solid = cv2.erode(touched.reshape(self.size[1], self.size[0]).view(np.uint8), SOLID)
        return np.asarray(cv2.dilate(solid, NEAR, anchor=(3, 3)).ravel() > 0)

    def _inverse(self, drift: Floats) -> tuple[Floats, Floats | None]:
        """Gains (3, 3) of the picture after it has been undone, out of (3, 6), and what undoes it."""
        gain = 1.0 + self.power * drift[:, 0]
        gains = np.column_stack([np.zeros(3), drift[:, 1:3] / gain[:, None]])
        if np.abs(drift[:, 3:]).max() < self.power * CONVERGENCE_TOL:
            level = gain ** (1.0 / self.power)
            gains *= level[:, None]
            gains[:, 0] = level - 1.0
            return gains, None
        mix = np.diag(gain - drift[:, 4] - drift[:, 5])
        for c, others in enumerate(OTHERS):
            mix[c, others] = drift[c, 4:]
        undo = np.linalg.inv(self.light[:, None] * mix / self.light)
        return gains, np.column_stack([undo, -undo @ (drift[:, 3] * self.light)])

    def _separated(
        self, change: Floats, weights: Floats, constant: Floats, touched: Bools
    ) -> tuple[Floats, Floats]:
        """The drift (3, 6) and its covariance, told from the gel's own slopes beside what is `touched` (blocks,).

        Lone blocks are noise.
        """
        shape = self.size[1], self.size[0]
        contact = solid(touched.reshape(shape))
        noise = noise_of(change.reshape(3, *shape), weights.reshape(shape))
        slopes = likely_slopes(change / noise, self._to_slopes / noise, touched=contact) if contact.any() else None
        gain = (1.0 + constant) ** self.power - 1.0
        return drift_of(
            change / noise, weights, terms=self._terms / noise, slopes=slopes, gain=gain, power=self.power
        )

    def _blocks(self, planes: Planes) -> Floats:
        """Means (3, h * w) of planes over the blocks."""
        blocks = (self.down @ planes).reshape(-1, planes.shape[2]) @ self.across
        return blocks.astype(np.float64).reshape(3, -1)

    def _squares(self, change: Floats, gains: Floats) -> Floats:
        """Squared distance of each block from the drift over the channels, `change` in deviations of its noise."""
        residual = self._left(change, gains)
        residual *= residual
        return np.asarray(residual.sum(axis=0))

    def _left(self, change: Floats, gains: Floats) -> Floats:
        return np.asarray(change - np.matmul(gains[:, None, :], self._terms[:, : gains.shape[1]])[:, 0])

    def _fit(self, weighted: Floats, weights: Floats, constant: Floats) -> Floats:
        """Weighted ridge regression: the steeper the drift's plane against its mean, the less it is believed."""
        normal = (weights @ self._normal).reshape(3, 9)
        prior_std = PLANE_SHARE * np.abs(constant) + MIN_PLANE
        normal[:, 4::4] += (CORRELATED / prior_std**2)[:, None]  # the diagonal but for its first
        normal[:, 0] += 1e-9
        right = (weighted * weights) @ self.basis
        return np.asarray(np.linalg.solve(normal.reshape(3, 3, 3), right[:, :, None])[:, :, 0])

    def _check(self, blocks: Floats, change: Floats) -> None:
        blocks, mean_grey, clear_grey = self._among_usable(blocks), self.mean_grey, self.clear_grey
        grey = np.add.reduce(blocks, axis=1) / blocks.shape[1]
        dark = bool((grey < 0.1 * self.grey).any())
        if dark or (blocks.max() > 252.0 > mean_grey + 20.0 and float(median(blocks.max(axis=0))) > 252.0):
            raise InputError(
                "the frame is " + ("black, or one of its channels is" if dark else "saturated"),
                where="frame",
                value=f"mean grey {grey.mean():.0f}, the reference has {mean_grey:.0f}",
                remedy=f"Leave the frame out; check lights and exposure.{_of_bits(grey, mean_grey)}",
            )
        size = np.abs(self._among_usable(change))
        if 2.0 * float(np.add.reduce(size, axis=None)) <= min(clear_grey, 0.5 * mean_grey) * size.size:
            return  # no median of what is not negative is more than twice its mean
        off = float(median(size.ravel()))
        swapped = np.abs(blocks[::-1] - self._among_usable(self.level))
        if off > clear_grey and float(median(swapped.ravel())) < MAX_SWAPPED_SHARE * off:
            raise InputError(
                "the frame's colours are in the order blue, green, red",
                where="frame",
                remedy="Hand frames over as red, green, blue.",
            )
        if off > 0.5 * mean_grey:
            raise InputError(
                "the frame is nothing like the reference",
                where="frame",
                value=f"mean grey {grey.mean():.0f}, the reference has {mean_grey:.0f}",
                remedy=f"Use a reference of the same sensor and light.{_of_bits(grey, mean_grey)}",
            )


def _of_bits(grey: Floats, mean_grey: float) -> str:
    """What to think of where a frame's `grey` (3,) and its reference's mean part by as much as whole bits do."""
    times = max(float(grey.mean()), 0.1) / max(mean_grey, 0.1)
    if not BITS[0] < max(times, 1 / times) < BITS[1]:
        return ""
    which, much = ("reference", times) if times > 1 else ("frame", 1 / times)
    return (
        f" The {which} is {much:.0f} times darker: are these numbers of 12 bits in 16 (16 times) or 10 (64 times)?"
        " State white_level."
    )


def solid(touched: Bools) -> Bools:
    """Mask of those blocks (h, w) of `touched` ones that fill two by two, as a contact does.

    The others are noise.
    """
    whole = cv2.erode(touched.astype(np.uint8), SOLID, borderValue=0)
    return np.asarray(cv2.dilate(whole, SOLID, anchor=(0, 0)) > 0)


def undo_drift(greys: Sequence[npt.NDArray[Any]] | npt.NDArray[Any], undo: Floats, *, power: int) -> Planes:
    """The `greys` (3, h, w), in grey levels, with the affine map `undo` (3, 4) used on their light."""
    light = np.asarray(greys, np.float32).reshape(3, -1)
    mix, stray = np.split(undo.astype(np.float32), [3], axis=1)
    linear = np.asarray(mix @ (light if power == 1 else light * light) + stray)
    if power == 2:
        cv2.sqrt(np.maximum(linear, 0.0, out=linear), dst=linear)
    return linear.reshape(3, *greys[0].shape)


def _centres(blocks: int, pixels: int) -> Floats:
    """Middles of the blocks on a line of pixels whose ends are at -1 and 1."""
    return np.asarray((2.0 * (np.arange(blocks) + 0.5) * pixels / blocks - pixels) / (pixels - 1))
