"""Estimate the drift of the illumination since the reference: exposure, stray light, lamps, gradient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.reference import Reference
from tactilevision.records.constants import TINY
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.measured import Bools, Bytes, Floats, Picture
from tactilevision.robust import MAD_TO_STD

# Means over several pixels.

TILES = 60  # approximate number of means along the shorter side of the picture
MIN_TILE_PX = 2  # pixels along each side of a mean at least
MAX_TILE_PX = 4  # at most: wider ones blur the smallest contacts


def tile_px_of(reference: Reference) -> int:
    """Return the pixels along each side of the means of frames, the least for gel with marks."""
    if reference.marks is not None:
        return MIN_TILE_PX
    return min(MAX_TILE_PX, max(MIN_TILE_PX, round(min(reference.shape) / TILES)))


def means(picture: npt.NDArray[np.generic], px: int) -> Picture:
    """Return means (n, H // px, W // px) over `px` by `px` pixels of a picture (H, W, n).

    Exact for integers; of 8 bits with `px` up to 16.
    """
    height, width, count = picture.shape[0] // px, picture.shape[1] // px, picture.shape[2]
    lines = picture[: px * height].reshape(height, px, -1)[..., : px * width * count]
    down = np.add.reduce(lines, axis=1, dtype=np.uint16 if picture.dtype == np.uint8 else np.float32).ravel()
    size = down.size - (px - 1) * count
    # running sums over all pixels: faster than strided sums
    total = sum((down[k * count :][:size] for k in range(1, px)), down[:size])
    out = np.empty((count, height, width), np.float32)
    share = np.float32(1.0 / px)
    for c, plane in enumerate(out):
        np.multiply(total[c :: px * count].reshape(height, width), share, out=plane)
    out *= share
    return out


@lru_cache(maxsize=64)
def shares(count: int, blocks: int) -> Picture:
    """Return the shares (blocks, count) of `count` places on a line in the mean of each block."""
    return np.asarray(cv2.resize(np.eye(count, dtype=np.float32), (count, blocks), interpolation=cv2.INTER_AREA))


# Reproducible distance transform: the last bits of the square root in OpenCV's precise transform depend on memory
# alignment. Squared distances in pixels are integers, so they are rounded before numpy's square root.


def distance_px(inside: Bools) -> Picture:
    """Return the distance (H, W) in px of each place inside the mask (H, W) to the nearest one outside; 0 outside.

    float32, for masks of less than 2896 px across (squares to 2^24).
    """
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance *= distance
    np.rint(distance, out=distance)
    return np.asarray(np.sqrt(distance, out=distance), np.float32)


# Bayesian model of the drift of the light, given which blocks of a frame are untouched.
#
#     d(I_c^p) / p I_c^(p-1) = I_c (g_0 + g_x X + g_y Y) + I_c (b + sum_j m_j (l_j - l_c)) / p l_c
#                              + (I_c + s) J_c slope
#
# I is the untouched picture, c a channel and j the other two, I^p the light that made it, l that light with mean 1
# in each channel. Exposure and supply dim all channels alike: g_x, g_y, b, m are 0. Stray light that does not fade
# with the lamps gives b = -p g_0 times its share. Lamps that fade separately mix the channels, m. A linear
# gradient (g_x, g_y) covers the rest. The last term is the slope of the gel outside the contacts: J (3, 2) is the
# response of the colours to slope, s the softening of `colour_change.py`. In each block this slope has a Gaussian
# prior of deviation SLOPE_SHARE exp(-d / a) times the slopes under the contact, d from a contact of radius a, and
# is integrated out. Where J is unknown, slopes may change each channel separately. Each kind of drift is a prior
# on g_0, g_x, g_y, b, m, weighted by its evidence (Bishop, Pattern Recognition and Machine Learning, 3.5). The
# noise is estimated from differences of neighbouring blocks. Valid for errors correlated over at most CORRELATED
# blocks.

UNBOUNDED = 10_000  # deviation of g_0 that leaves the channels independent


class DriftKind(NamedTuple):
    """Prior of one kind of drift: means and standard deviations."""

    stray: float = 0.0  # b, as a share of g_0
    stray_std: float = 0.0
    gradient: float = 0.003  # std of g_x, g_y, as a share of g_0
    mixture: float = 0.0  # m, as a share of the difference of the channels' g_0
    mixture_std: float = 0.0
    uneven: float = 0.03  # std of g_x, g_y, as a share of that difference
    separate: float = UNBOUNDED  # std of a channel's own g_0, as a share of g_0


DRIFT_KINDS = np.array(
    [
        DriftKind(separate=0.02),
        DriftKind(0.1, 0.1, separate=0.02),
        DriftKind(gradient=0.3, uneven=0.3),
        DriftKind(0, 0.15, 0.1, 0.2, 0.2, 0.1),
    ]
)  # all lamps alike, without and with stray light; a gradient; all of it, each lamp on its own
PRIOR_WEIGHTS = np.array([1, 1, 1, 0.05])
MIN_STD = 1e-4  # of any coefficient: keeps priors invertible
COMMON_STD = 10  # of g_0 that all channels share, far above any drift
CORRELATED_NOISE = 6  # blocks with correlated noise; more widen the covariance (test_drift_error.py)
SLOPE_SHARE = 0.4  # of the slopes under a contact, just outside it
GUESSED_SHARE = 0.04  # of the colour changes under a contact, where J is unknown
TERMS = 6  # g_0, g_x, g_y, b, m, m
CHANNELS = np.arange(3)
COMMON_PLACES = [TERMS * c for c in range(3)]  # indices of g_0
OTHERS = ((1, 2), (0, 2), (0, 1))  # the other two channels of each
MIN_NOISE = 0.05  # of the assumed noise of a block


def likely_slopes(change: Floats, answers: Floats, *, touched: Bools) -> Floats:
    """Return the change (3, k, blocks) of the channels for a slope of one standard deviation.

    `answers` (3, k, blocks) are the changes for slopes of 1 along x and y, or, for k = 3, of each channel alone.
    The slopes under the contact, blocks `touched` (h, w), follow from the `change` (3, blocks) there.
    """
    under = touched.ravel()
    slope_rms = np.sqrt(
        np.median(np.sum(change[:, under] ** 2, axis=0) / np.sum(answers[:, :, under] ** 2, axis=(0, 1)))
    )
    distance = distance_px(~touched).ravel()
    fall = np.exp(distance * -np.sqrt(np.pi / np.count_nonzero(under)))
    return np.asarray(answers * ((SLOPE_SHARE if answers.shape[1] == 2 else GUESSED_SHARE) * slope_rms * fall))


def noise_of(change: Floats, weights: Floats) -> float:
    """Return the noise of blocks (3, h, w) relative to the assumed one, from second differences along the rows.

    Blocks whose `weights` (h, w) are small do not count.
    """
    bend = np.abs(change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2])[:, weights[:, 1:-1] > 0.5]
    return max(MIN_NOISE, MAD_TO_STD / np.sqrt(6) * float(np.median(bend))) if bend.size else 1.0


def drift_of(
    change: Floats, weights: Floats, *, terms: Floats, slopes: Floats | None, gain: Floats, power: int
) -> tuple[Floats, Floats]:
    """Return g_0, g_x, g_y, b, m, m (3 channels, 6) and their covariance (18, 18).

    `change` (3, blocks), the left side of the equation, `terms` (3, 6, blocks) and the changes `slopes` (3, k,
    blocks) by likely slopes are in units of a block's noise; `weights` (blocks,). `gain` (3,): rough gain of the
    light.
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
    """Return the normal equations (18, 18) and their right side (18,) of all channels, slopes integrated out."""
    trust = np.zeros((3, 3, len(weights)))
    trust[CHANNELS, CHANNELS] = weights
    for unit in () if slopes is None else slopes.transpose(1, 0, 2):
        projection = np.sum(trust * unit, axis=1)
        power = weights + np.sum(unit * projection, axis=0)
        trust -= projection[:, None] * (projection / np.maximum(power, np.finfo(float).tiny))
    weighted = (trust[:, :, None] * terms).reshape(3, 3 * TERMS, -1)
    normal = np.matmul(terms, weighted.transpose(0, 2, 1)).reshape(3 * TERMS, 3 * TERMS)
    return normal, np.matmul(terms, np.sum(trust * change, axis=1)[..., None]).ravel()


def _expected(gain: Floats, power: int) -> tuple[Floats, Floats, Floats]:
    """Return the priors: means (kinds, 18), precisions (kinds, 18, 18), log terms of the evidence (kinds,)."""
    common, spread = np.abs(gain), float(np.abs(gain - np.sort(gain)[1]).max())
    stray, stray_std, gradient, mixture, mixture_std, uneven, separate = DRIFT_KINDS.T[:, :, None]
    expected, std = np.zeros((2, len(DRIFT_KINDS), 3, TERMS))
    gain_std = np.minimum(separate * float(common.max()) + MIN_STD, COMMON_STD)
    std[..., 0] = gain_std / power
    std[..., 1:3] = ((gradient * common + uneven * spread + MIN_STD) / power)[..., None]
    expected[..., 3], std[..., 3] = -stray * gain, stray_std * common + MIN_STD
    expected[..., 4:] = mixture[..., None] * (gain[np.array(OTHERS)] - gain[:, None])
    std[..., 4:] = (mixture_std * spread + MIN_STD)[..., None]
    expected, std = (values.reshape(len(DRIFT_KINDS), -1) for values in (expected, std))
    precision, diagonal = np.zeros((len(DRIFT_KINDS), 3 * TERMS, 3 * TERMS)), np.arange(3 * TERMS)
    precision[:, diagonal, diagonal] = std**-2
    weight = std[:, 0] ** -2  # of a channel's own g_0; COMMON_STD is that of the shared g_0
    shared = weight / (3 + 1 / (COMMON_STD**2 * weight))
    for c in COMMON_PLACES:
        precision[:, c, COMMON_PLACES] -= shared[:, None]
    log_of_spread = 2.0 * np.log(std).sum(axis=1) + np.log1p(3 * COMMON_STD**2 * weight)
    return expected, precision, log_of_spread + np.sum((expected / std) ** 2, axis=1)


# Response of the camera to light, and of its colours to slope.

DEFAULT_POWER = 2  # light = grey^power: sRGB and video store about the root of light (1.8 to 2.4)
SOFTENING_GREY = 20  # added to brightness where a change is divided by it (`colour_change.py`)
LINEAR_TERMS = np.array([(a, 1 - a, i, n - i) for a in range(2) for n in range(3) for i in range(n + 1)])


@dataclass(frozen=True, slots=True)
class Response:
    """`power` of the grey level that is proportional to light, 1 or 2.

    `answers` (12, 3): colour change per gentle slope, by LINEAR_TERMS, powers of slope in x and y and of place;
    None without balls.
    """

    power: int = DEFAULT_POWER
    answers: Floats | None = None

    def to_slope(self, x: Floats, y: Floats) -> Floats | None:
        """Return colour changes (3, 2, N) per unit of slope in x and y, at places x, y (N,) from -1 to 1."""
        if self.answers is None:
            return None
        changes = np.zeros((3, 2, len(x)))
        for (along_x, _, i, j), row in zip(LINEAR_TERMS, self.answers, strict=True):
            changes[:, 1 - along_x] += row[:, None] * (x**i * y**j)
        return changes

    def to_card(self) -> dict[str, Any]:
        """Return the entry of a card."""
        answers = None if self.answers is None else np.round(self.answers, 5).tolist()
        return {"power": self.power, "answers": answers}


def response_from_card(entry: Mapping[str, Any] | None) -> Response:
    """Return the response of the card's `entry` (power, answers); that of most cameras for None."""
    if entry is None:
        return Response()
    answers = entry["answers"]
    return Response(int(entry["power"]), None if answers is None else np.array(answers, np.float64))


# Drift of the light since the reference, measured on the untouched gel.
#
#     I^p = A I_0^p + o      then times 1 + g_x X + g_y Y      X, Y from -1 to 1 over the picture
#
# I^p is light; A mixes the channels where lamps fade separately, o is stray light. A gain with a plane is fitted
# by iteratively reweighted least squares to block means, so that contacts and their surroundings do not count. The
# prior of the plane is a share of the gain, as gentle slopes around a contact resemble an uneven drift. Then
# `drift_of` separates the drift from those slopes. Valid while less than about half of the picture is touched.

BLOCKS = 600  # approximate number of blocks over the picture
MAX_ITERATIONS = 3  # rounds of reweighting
CONVERGENCE_TOL = 3e-4  # of the brightness, far below a grey level
DETECTION_SIGMA = 5  # median difference of blocks from the reference, in noise, that is significant
MAX_SWAPPED_SHARE = 0.3  # of that difference, left when red and blue are swapped
BITS = (3.5, 80)  # times darker: from 14 bits in 16, with noise, to 10 bits
COMPRESSED_GREY = 0.3  # error of a block's mean by rounding and compression
MEDIAN_LENGTH = 1.5382  # median length of three standard normal numbers
MIN_BLOCKS = 30  # blocks away from contacts; with fewer, those near contacts count in the fit as well
PLANE_SHARE = 0.3  # prior deviation of the plane, as a share of the gain
MIN_PLANE = 2e-4  # the same without any gain
MIN_DRIFT = 1e-3  # gain below which the pattern of the drift is lost in the noise
SOLID = np.ones((2, 2), np.uint8)  # least blocks of a contact
NEAR = np.ones((8, 8), np.uint8)  # these, and 3 on either side
CORRELATED = 20  # blocks whose errors, including gentle slopes of the gel, are correlated


@dataclass(frozen=True, slots=True)
class Drift:
    """Drift of a frame's light against the reference.

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
    means: Picture | None = None


class DriftTracker:
    """Measure the drift of frames against one reference."""

    def __init__(self, reference: Reference, response: Response) -> None:
        height, width = reference.shape
        self.power, self.dark = response.power, reference.dark_colour
        self.size, block = blocks_of(reference.shape)
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
        self.all_usable, count = bool(self.usable.all()), np.count_nonzero(self.usable)
        self._middle = (count - 1) // 2, count // 2  # of the usable blocks in order
        self.bright, self.shown, self.bend = np.empty((3, *self.level.shape))
        answers = response.to_slope(self.basis[:, 1], self.basis[:, 2])
        self._answers: Floats = np.eye(3)[:, :, None] if answers is None else answers
        # grey change per noise for slopes of 1 along x and y (3, 2, blocks), or of each channel (3, 3, blocks)
        self.slope_effects = np.empty((*self._answers.shape[:2], len(self.basis)))
        self.terms, self.normal = np.empty((3, TERMS, len(x.ravel()))), np.empty((len(x.ravel()), 27))
        self._update_level()

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the reference towards `rgb` by `share` of the difference."""
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
        gains[:, 0] = self._medians(change / self.bright)
        change /= self.noise
        gains, weights, touched, limit = self._reweighted(change, gains)
        drift, undo, covariance = gains, None, None
        if np.abs(gains[:, 0]).max() > MIN_DRIFT:
            if self.power == 2:
                change *= 1.0 + self.bend * change
            drift, covariance = self._separated(change, weights, gains[:, 0], touched)
            gains, undo = self._inverse(drift)
        left = self._left(change, drift)
        squares = np.add.reduce(left * left)
        shape = (self.size[1], self.size[0])
        untouched = (self.usable & (squares < limit)).reshape(shape)
        misfit = float(self._medians(squares)) ** 0.5
        return Drift(gains, untouched, np.sqrt(squares).reshape(shape), undo, covariance, misfit, left, tiles)

    def _reweighted(self, change: Floats, gains: Floats) -> tuple[Floats, Floats, Bools, float]:
        """Return gains (3, 3), weights of the blocks, the mask (blocks,) of touched ones, and its threshold."""
        weighted = change * self.shown
        for _ in range(MAX_ITERATIONS):
            squares = np.sum(self._left(change, gains) ** 2, axis=0)
            scale = max(1.0, float(self._medians(squares)) / MEDIAN_LENGTH**2)
            limit = CONTACT.colour_sigma**2 * scale
            weights = squares * (1 / (9 * scale))
            weights += 1.0
            weights *= weights
            np.divide(self.usable, weights, out=weights)
            touched = self.usable & (squares > limit)
            near_contact = self._near_contact(touched)
            fitting = weights if near_contact is None else weights * ~near_contact
            if near_contact is not None and np.count_nonzero(fitting) < MIN_BLOCKS:
                fitting = weights
            before, gains = gains, self._fit(weighted, fitting, gains[:, 0])
            if np.abs(gains - before).max() < CONVERGENCE_TOL:
                break
        return gains, fitting, touched, limit

    @property
    def effects(self) -> Floats:
        """Grey levels (3, 6, blocks) that a unit of each coefficient of a drift adds to a channel."""
        return np.asarray(self.terms * self.noise[:, :, None])

    def _update_level(self) -> None:
        """Compute what depends on the level alone: terms in units of the noise, and normal equations."""
        self.mean_grey = float(self._among_usable(self.level).mean())
        self.clear_grey = DETECTION_SIGMA * float(self.noise.mean())
        np.maximum(self.level, 1.0, out=self.bright)
        np.divide(self.level, self.noise, out=self.shown)
        np.multiply(self.shown[:, None, :], self.basis.T, out=self.terms[:, :3])
        np.divide(0.5 * self.noise, self.bright, out=self.bend)  # change of light to second order
        self.grey = self._among_usable(self.level).mean(axis=1)
        np.multiply(self._answers, ((self.level + SOFTENING_GREY) / self.noise)[:, None], out=self.slope_effects)
        light = self.bright**self.power
        self.light = self._among_usable(light).mean(axis=1)
        light /= self.light[:, None]
        per_light = self.shown / (self.power * light)
        self.terms[:, 3] = per_light
        for c, others in enumerate(OTHERS):
            for term, j in zip((4, 5), others, strict=True):
                self.terms[c, term] = (light[j] - light[c]) * per_light[c]
        squares = self.normal.reshape(-1, 3, 9).transpose(1, 0, 2)
        np.multiply(np.square(self.shown)[:, :, None], self.squares, out=squares)

    def _among_usable(self, values: Floats) -> Floats:
        """Return the `values` (..., blocks) of the usable blocks."""
        return values if self.all_usable else values[..., self.usable]

    def _medians(self, values: Floats) -> Any:
        """Return the medians (...) of `values` (..., blocks) over the usable blocks."""
        ordered = np.sort(self._among_usable(values), axis=-1)
        low, high = self._middle
        return 0.5 * (ordered[..., low] + ordered[..., high])

    def _near_contact(self, touched: Bools) -> Bools | None:
        """Return the mask of blocks near a contact, whose slopes resemble drift; single blocks are noise."""
        if not touched.any():
            return None
        solid = cv2.erode(touched.reshape(self.size[1], self.size[0]).view(np.uint8), SOLID)
        return np.asarray(cv2.dilate(solid, NEAR, anchor=(3, 3)).ravel() > 0)

    def _inverse(self, drift: Floats) -> tuple[Floats, Floats | None]:
        """Return the gains (3, 3) of the corrected picture and the correction, of a drift (3, 6)."""
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
        """Return the drift (3, 6) and its covariance, separated from slopes around the `touched` blocks."""
        shape = self.size[1], self.size[0]
        contact, slopes = solid(touched.reshape(shape)), None
        noise = noise_of(change.reshape(3, *shape), weights.reshape(shape))
        if contact.any():
            slopes = likely_slopes(change / noise, self.slope_effects / noise, touched=contact)
        gain = (1.0 + constant) ** self.power - 1.0
        return drift_of(
            change / noise, weights, terms=self.terms / noise, slopes=slopes, gain=gain, power=self.power
        )

    def _blocks(self, planes: Picture) -> Floats:
        """Return the means (3, h * w) of planes over the blocks."""
        blocks = (self.down @ planes).reshape(-1, planes.shape[2]) @ self.across
        return blocks.astype(np.float64).reshape(3, -1)

    def _left(self, change: Floats, gains: Floats) -> Floats:
        return np.asarray(change - np.matmul(gains[:, None, :], self.terms[:, : gains.shape[1]])[:, 0])

    def _fit(self, weighted: Floats, weights: Floats, constant: Floats) -> Floats:
        """Return gains (3, 3) by weighted least squares with a prior on the plane."""
        normal = (weights @ self.normal).reshape(3, 9)
        prior_std = PLANE_SHARE * np.abs(constant) + MIN_PLANE
        normal[:, 4::4] += (CORRELATED / prior_std**2)[:, None]  # the diagonal but for its first
        normal[:, 0] += TINY
        right = (weighted * weights) @ self.basis
        return np.asarray(np.linalg.solve(normal.reshape(3, 3, 3), right[:, :, None])[:, :, 0])

    def _check(self, blocks: Floats, change: Floats) -> None:
        blocks, mean_grey, clear_grey = self._among_usable(blocks), self.mean_grey, self.clear_grey
        grey = np.add.reduce(blocks, axis=1) / blocks.shape[1]
        dark = bool((grey < 0.1 * self.grey).any())
        if dark or (blocks.max() > 252 > mean_grey + 20 and float(np.median(blocks.max(axis=0))) > 252):
            raise InputError(
                "the frame is " + ("black, or one of its channels is" if dark else "saturated"),
                where="frame",
                value=f"mean grey {grey.mean():.0f}, the reference has {mean_grey:.0f}",
                remedy=f"Exclude the frame; check lights and exposure.{_of_bits(grey, mean_grey)}",
            )
        size = np.abs(self._among_usable(change))
        if 2.0 * float(np.add.reduce(size, axis=None)) <= min(clear_grey, 0.5 * mean_grey) * size.size:
            return  # the median of non-negative values is at most twice their mean
        off = float(np.median(size))
        swapped = np.abs(blocks[::-1] - self._among_usable(self.level))
        if off > clear_grey and float(np.median(swapped)) < MAX_SWAPPED_SHARE * off:
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
    """Return a remedy where a frame's `grey` (3,) and the mean of its reference differ by several bits."""
    frame, reference = np.maximum((grey.mean(), mean_grey), 0.1).tolist()
    times = frame / reference
    if not BITS[0] < max(times, 1 / times) < BITS[1]:
        return ""
    which, much = ("reference", times) if times > 1 else ("frame", 1 / times)
    return (
        f" The {which} is {much:.0f} times darker: are these numbers of 12 bits in 16 (16 times) or 10 (64 times)?"
        " State white_level."
    )


def solid(touched: Bools) -> Bools:
    """Return the mask (h, w) of `touched` blocks that fill two by two; the others are noise."""
    whole = cv2.erode(touched.astype(np.uint8), SOLID, borderValue=0)
    return np.asarray(cv2.dilate(whole, SOLID, anchor=(0, 0)) > 0)


def undo_drift(greys: Sequence[npt.NDArray[Any]] | npt.NDArray[Any], undo: Floats, *, power: int) -> Picture:
    """Return grey levels (3, h, w) with the affine map `undo` (3, 4) applied to their light."""
    light = np.asarray(greys, np.float32).reshape(3, -1)
    mix, stray = np.split(undo.astype(np.float32), [3], axis=1)
    linear = np.asarray(mix @ (light if power == 1 else light * light) + stray)
    if power == 2:
        cv2.sqrt(np.maximum(linear, 0.0, out=linear), dst=linear)
    return linear.reshape(3, *greys[0].shape)


def blocks_of(shape: tuple[int, ...]) -> tuple[tuple[int, int], int]:
    """Return the number of blocks (across, down) of a picture of `shape` (H, W), and their side in px."""
    height, width = shape
    block = max(4, int(np.sqrt(height * width / BLOCKS)))
    return (max(2, width // block), max(2, height // block)), block


def block_means(picture: npt.NDArray[Any], size: tuple[int, int]) -> Picture:
    """Return the means (h, w) or (h, w, C) of a picture, in its unit, over `size` (across, down) equal blocks."""
    return np.asarray(cv2.resize(np.asarray(picture, np.float32), size, interpolation=cv2.INTER_AREA))


def _centres(blocks: int, pixels: int) -> Floats:
    """Return the centres of the blocks on a line of pixels whose ends are at -1 and 1."""
    return np.asarray((2.0 * (np.arange(blocks) + 0.5) * pixels / blocks - pixels) / (pixels - 1))
