"""Estimate the drift of the illumination since the reference: exposure, stray light, lamps, gradient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.windows import Planes, distance_px, means, shares, tile_px_of
from tactilevision.records.contact_thresholds import colour_limit
from tactilevision.records.measured import Bools, Bytes, Floats
from tactilevision.robust import MAD_TO_STD, median

# Which kind of drift is it? One without a pattern, stray light's, that of lamps which fade apart, or a lean.
#
#     d(I_c^p) / p I_c^(p-1) = I_c (g_0 + g_x X + g_y Y) + I_c (b + sum_j m_j (l_j - l_c)) / p l_c
#                              + (I_c + s) J_c slope
#
# I is the untouched picture, c a channel and j the other two, I^p the light that made it (`camera_response.py`), l
# that light, its mean 1 in each channel. Exposure and supply dim all channels alike: g_x, g_y, b, m are 0. A stray
# light that does not fade with the lamps leaves b = -p g_0 times it. Lamps add up in light, so what the fading of
# one leaves is a mixture of channels, m, exactly; m_j has the sign of what channel j gained over c, as it is a
# part of that lamp's light that c sees. A lean is for what is none of these; lamps fade apart under one as well,
# as where stray light is uneven itself. The last term is the gel's own slope beside the contacts, which is no
# drift: J (3, 2) is what a slope makes of colours, s the softening of `colour_change.py`. Which shape it has is
# left open: in each block a slope may be as steep as SLOPE_SHARE of those under the contact times exp(-d / a), at
# a distance d from a contact of radius a, and is integrated out (a Gaussian of that deviation). So near a contact
# drift is read in the one combination of three colours that slopes leave alone, and far from it in all. Where J is
# not known, slopes may change each channel by itself. Each kind is a prior on g_0 (of all channels alike, or of
# each its own), g_x, g_y, b, m, and the kinds count as far as the untouched gel makes them likely (Bayesian
# evidence of a linear model; Bishop, Pattern Recognition and Machine Learning, 3.5). Noise is what the frame's own
# blocks show against their neighbours. Valid where errors hang together over no more than CORRELATED blocks.

UNBOUNDED = 1e4  # of g_0: a deviation so large that each channel drifts by itself
# stray light and its deviation in parts of the light, lean in parts of g_0; m and its deviation, and lean once
# more, in parts of that by which channels left each other; that by which they do, in parts of g_0, or anything
DRIFT_KINDS = np.array(
    [
        (0.0, 0.0, 0.003, 0.0, 0.0, 0.03, 0.02),
        (0.1, 0.1, 0.003, 0.0, 0.0, 0.03, 0.02),
        (0.0, 0.0, 0.003, 0.0, 0.0, 0.03, UNBOUNDED),
        (0.1, 0.1, 0.003, 0.0, 0.0, 0.03, UNBOUNDED),
        (0.0, 0.15, 0.003, 0.2, 0.2, 0.03, UNBOUNDED),
        (0.0, 0.0, 0.3, 0.0, 0.0, 0.3, UNBOUNDED),
        (0.0, 0.15, 0.1, 0.2, 0.2, 0.1, UNBOUNDED),
    ]
)
PRIOR_WEIGHTS = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.05])  # each kind, beforehand; all at once is rare
MIN_STD = 1e-4  # of the light: the least deviation of any coefficient, which keeps priors invertible
COMMON_STD = 10.0  # of the light: deviation of g_0 of all channels alike, far above any drift
CORRELATED_NOISE = 6.0  # blocks whose noise hangs together; more widen the covariance (test_drift_error.py)
SLOPE_SHARE = 0.4  # of the slopes under a contact, close beside it
GUESSED_SHARE = 0.04  # of its colours, where nobody knows what slopes do: more would leave nothing to read
TERMS = 6  # g_0, g_x, g_y, b, m, m
CHANNELS = np.arange(3)
TINY = 1e-30  # keeps blocks without weight from 0 / 0
COMMON_PLACES = [TERMS * c for c in range(3)]  # where g_0 stands
OTHERS = ((1, 2), (0, 2), (0, 1))  # the other two channels of each
MIN_NOISE = 0.05  # least noise, in parts of what a block's is taken to be


def likely_slopes(change: Floats, answers: Floats, *, touched: Bools) -> Floats:
    """What a slope of one deviation makes of the channels (3, k, blocks): `answers` (3, k, blocks) to slopes of 1.

    How steep the gel is under the contact, blocks `touched` (h, w), is read out of the `change` (3, blocks) there.
    `answers` are for x and y, or, k = 3, for each channel by itself.
    """
    under = touched.ravel()
    slope_rms = np.sqrt(
        np.median(np.sum(change[:, under] ** 2, axis=0) / np.sum(answers[:, :, under] ** 2, axis=(0, 1)))
    )
    distance = distance_px(~touched).ravel()
    fall = np.exp(distance * -np.sqrt(np.pi / np.count_nonzero(under)))
    return np.asarray(answers * ((SLOPE_SHARE if answers.shape[1] == 2 else GUESSED_SHARE) * slope_rms * fall))


def noise_of(change: Floats, weights: Floats) -> float:
    """Relative noise of blocks (3, h, w) by their neighbours in a row, 1 as assumed.

    `weights` (h, w) of those that count.
    """
    bend = np.abs(change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2])[:, weights[:, 1:-1] > 0.5]
    return max(MIN_NOISE, MAD_TO_STD / np.sqrt(6.0) * float(median(bend.ravel()))) if bend.size else 1.0


def drift_of(
    change: Floats, weights: Floats, *, terms: Floats, slopes: Floats | None, gain: Floats, power: int
) -> tuple[Floats, Floats]:
    """g_0, g_x, g_y, b, m, m (3 channels, 6), and their covariance (18, 18).

    `change` (3, blocks), the equation's left side, `terms` (3, 6, blocks) and what a likely slope makes of it,
    `slopes` (3, k, blocks), are in deviations of a block's noise, `weights` (blocks,); `gain` (3,) is the light's,
    roughly.
    """
    normal, right = _normal(change, weights / CORRELATED_NOISE, terms, slopes)
    expected, precision, log_of_spread = _expected(gain, power)
    target = right + np.matmul(precision, expected[..., None])[..., 0]
    precision += normal
    spread = np.linalg.inv(precision)
    solution = np.matmul(spread, target[..., None])[..., 0]
    log_evidence = np.sum(target * solution, axis=1) - np.linalg.slogdet(precision)[1] - log_of_spread
    probability = PRIOR_WEIGHTS * np.exp(0.5 * (log_evidence - log_evidence.max()))
    probability /= probability.sum()
    mean = probability @ solution
    deviation = solution - mean
    spread += deviation[:, :, None] * deviation[:, None, :]
    return mean.reshape(3, TERMS), np.tensordot(probability, spread, axes=1)


def _normal(change: Floats, weights: Floats, terms: Floats, slopes: Floats | None) -> tuple[Floats, Floats]:
    """Normal equations (18, 18) and right side (18,) of all channels; noise is 1, and slopes add to it."""
    trust = np.zeros((3, 3, len(weights)))
    trust[CHANNELS, CHANNELS] = weights
    for unit in () if slopes is None else slopes.transpose(1, 0, 2):  # one slope after the other is integrated out
        projection = np.sum(trust * unit, axis=1)
        trust -= projection[:, None] * (projection / (weights + np.sum(unit * projection, axis=0) + TINY))
    weighted = (trust[:, :, None] * terms).reshape(3, 3 * TERMS, -1)
    normal = np.matmul(terms, weighted.transpose(0, 2, 1)).reshape(3 * TERMS, 3 * TERMS)
    return normal, np.matmul(terms, np.sum(trust * change, axis=1)[..., None]).ravel()


def _expected(gain: Floats, power: int) -> tuple[Floats, Floats, Floats]:
    """What the coefficients are under each kind (kinds, 18), the inverse of their covariance about it (kinds, 18,
    18), and the log of its determinant and of what is expected (kinds,)."""
    common, spread = np.abs(gain), float(np.abs(gain - median(gain)).max())
    stray, stray_std, lean, mixed, mixed_std, uneven, alike = DRIFT_KINDS.T[:, :, None]
    expected, std = np.zeros((2, len(DRIFT_KINDS), 3, TERMS))
    gain_std = np.minimum(alike * float(common.max()) + MIN_STD, COMMON_STD)
    std[..., 0] = gain_std / power
    std[..., 1:3] = ((lean * common + uneven * spread + MIN_STD) / power)[..., None]
    expected[..., 3], std[..., 3] = -stray * gain, stray_std * common + MIN_STD
    expected[..., 4:] = mixed[..., None] * (gain[np.array(OTHERS)] - gain[:, None])
    std[..., 4:] = (mixed_std * spread + MIN_STD)[..., None]
    expected, std = (values.reshape(len(DRIFT_KINDS), -1) for values in (expected, std))
    precision, diagonal = np.zeros((len(DRIFT_KINDS), 3 * TERMS, 3 * TERMS)), np.arange(3 * TERMS)
    precision[:, diagonal, diagonal] = std**-2
    weight = std[:, 0] ** -2  # what all channels have in common, COMMON_STD, beside what each has of its own
    shared = weight / (3.0 + 1.0 / (COMMON_STD**2 * weight))
    for c in COMMON_PLACES:
        precision[:, c, COMMON_PLACES] -= shared[:, None]
    log_of_spread = 2.0 * np.log(std).sum(axis=1) + np.log1p(3.0 * COMMON_STD**2 * weight)
    return expected, precision, log_of_spread + np.sum((expected / std) ** 2, axis=1)


# How a camera answers to light and its picture to slope: what drift is told from contact with.
#
# Lamps add up in light, not in grey levels: cameras write either the light itself (power 1) or about its root
# (power 2: sRGB and video, 1.8 to 2.4). Balls tell which (`gamma.py`).

DEFAULT_POWER = 2  # of a grey level, which is light: sRGB and video write about its root
SOFTENING_GREY = 20.0  # added to brightness where a change of it is divided by it (`colour_change.py`)
LINEAR_TERMS = np.array([(a, 1 - a, i, n - i) for a in range(2) for n in range(3) for i in range(n + 1)])


@dataclass(frozen=True, slots=True)
class Response:
    """`power` of the grey level that is light, 1 or 2.

    `answers` (12, 3): colour change of the channels to gentle slopes, by the terms LINEAR_TERMS, powers of slope
    in x and y and of place; None where no ball has told it.
    """

    power: int = DEFAULT_POWER
    answers: Floats | None = None

    def to_slope(self, x: Floats, y: Floats) -> Floats | None:
        """Colour changes (3, 2, N) for a unit of slope in x and in y, at places x, y (N,) from -1 to 1."""
        if self.answers is None:
            return None
        changes = np.zeros((3, 2, len(x)))
        for (along_x, _, i, j), row in zip(LINEAR_TERMS, self.answers, strict=True):
            changes[:, 1 - along_x] += row[:, None] * (x**i * y**j)
        return changes

    def to_card(self) -> dict[str, Any]:
        """The entry of a card."""
        answers = None if self.answers is None else np.round(self.answers, 5).tolist()
        return {"power": self.power, "answers": answers}


def response_from_card(entry: Mapping[str, Any] | None) -> Response:
    """The response of the card's `entry` (power, answers); that of most cameras for None."""
    if entry is None:
        return Response()
    answers = entry["answers"]
    return Response(int(entry["power"]), None if answers is None else np.array(answers, np.float64))


# Follows the light: how brightness has drifted since the reference was taken, seen on the untouched gel.
#
#     I^p = A I_0^p + o      then times 1 + g_x X + g_y Y      X, Y from -1 to 1 over the picture
#
# I^p is light (`camera_response.py`); A mixes the channels a little where lamps fade apart, o is stray light's. It
# is fitted by iteratively reweighted least squares on block means, so that a contact (whose colours leave the
# pattern) and what lies close to it do not count: first as a gain with a plane, which is held to a part of the
# gain, as the gel's gentle slopes round a contact look much like an uneven drift; and once it is known which
# blocks count, `drift_priors.py` tells drift, its kind and those slopes apart. Valid while less than about half of
# the picture is touched.

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
    channel, in noise. `means` (3, h, w): the frame in means of the tracker's `px`.
    """

    gains: Floats
    untouched: Bools
    normalised_residual: Floats
    undo: Floats | None = None
    covariance: Floats | None = None
    misfit: float = 0.0
    left: Floats | None = None
    means: Planes | None = None


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
        tiles = means(reference.rgb, self.px)
        self.down = shares(tiles.shape[1], self.size[1])
        self.across = np.ascontiguousarray(shares(tiles.shape[2], self.size[0]).T)
        self.level = self._blocks(tiles)
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
        tiles = means(rgb, self.px)
        blocks = self._blocks(tiles)
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
        return Drift(gains, untouched, np.sqrt(squares).reshape(shape), undo, covariance, misfit, left, tiles)

    def _reweighted(self, change: Floats, gains: Floats) -> tuple[Floats, Floats, Bools, float]:
        """Gains (3, 3) fitted from a start; the blocks' weights, and which are touched (blocks,); their limit."""
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
