"""Estimate the drift of the illumination since the reference: exposure, stray light, lamps, gradient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, singledispatch
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.reference import Reference
from tactilevision.records.constants import TINY
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.measured import Bools, Bytes, Floats, Picture
from tactilevision.robust import MAD_TO_STD, ascending, filled, masked_median, median, namespace

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


@singledispatch
def distance_px(inside: Any) -> Any:
    """Return the distance (..., H, W) in px of each place inside the mask to the nearest one outside; 0 outside.

    float32, for masks (H, W) of less than 2896 px across (squares to 2^24), or tensors (B, H, W).
    """
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance *= distance
    np.rint(distance, out=distance)
    return np.asarray(np.sqrt(distance, out=distance), np.float32)


@singledispatch
def inverse(matrix: Any, *, log: bool = False) -> tuple[Any, Any]:
    """Return the inverses of matrices (..., n, n) that need no pivots, and, for `log`, the logarithms (...) of
    their determinants.
    """
    return np.linalg.inv(matrix), np.linalg.slogdet(matrix)[1] if log else None


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
OTHERS = ((1, 2), (0, 2), (0, 1))  # the other two channels of each
MIN_NOISE = 0.05  # of the assumed noise of a block


# Formulas are of arrays, or of tensors with a leading axis of B frames (`batched_drift.py`).


def likely_slopes(change: Any, answers: Any, *, touched: Any) -> Any:
    """Return the change (..., 3, k, blocks) of the channels for a slope of one standard deviation.

    `answers` (..., 3, k, blocks) are the changes for slopes of 1 along x and y, or, for k = 3, of each channel.
    The slopes under the contact, blocks `touched` (..., h, w), follow from the `change` (..., 3, blocks) there.
    """
    xp, under = namespace(change), touched.reshape(*change.shape[:-2], -1)
    ratio = masked_median((change**2).sum(-2) / (answers**2).sum((-3, -2)), under)
    slope_rms = xp.sqrt(filled(ratio, ~under.any(-1), 0.0))[..., None]
    distance = distance_px(~touched).reshape(under.shape)
    fall = xp.exp(-distance * xp.sqrt(np.pi / under.sum(-1).clip(1))[..., None])
    share = SLOPE_SHARE if answers.shape[-2] == 2 else GUESSED_SHARE
    return answers * (share * slope_rms * fall)[..., None, None, :]


def noise_of(change: Any, weights: Any) -> Any:
    """Return the noise (...) of blocks (..., 3, h, w) relative to the assumed one, from second differences in
    rows.

    Blocks whose `weights` (..., h, w) are small do not count.
    """
    xp = namespace(change)
    bend = xp.abs(change[..., 2:] - 2.0 * change[..., 1:-1] + change[..., :-2])
    counted = xp.broadcast_to(weights[..., None, :, 1:-1] > 0.5, bend.shape)
    bend, counted = (values.reshape(*change.shape[:-3], -1) for values in (bend, counted))
    found = (MAD_TO_STD / 6**0.5 * masked_median(bend, counted)).clip(MIN_NOISE)
    return filled(found, ~counted.any(-1), 1.0)


class Priors(NamedTuple):
    """The kinds of drift (kinds, 7), logarithms of their weights (kinds,), and each channel's others (3, 2)."""

    kinds: Any = DRIFT_KINDS
    log_weights: Any = np.log(PRIOR_WEIGHTS)
    others: Any = np.array(OTHERS)


def drift_of(
    change: Any, weights: Any, *, terms: Any, slopes: Any, gain: Any, power: int, priors: Priors | None = None
) -> tuple[Any, Any]:
    """Return g_0, g_x, g_y, b, m, m (..., 3 channels, 6) and their covariance (..., 18, 18).

    `change` (..., 3, blocks), the left side of the equation, `terms` (..., 3, 6, blocks) and the changes `slopes`
    (..., 3, k, blocks) by likely slopes, or None, are in units of a block's noise; `weights` (..., blocks). `gain`
    (..., 3): rough gain of the light.
    """
    xp, priors = namespace(change), priors or Priors()
    normal, right = _normal(change, weights / CORRELATED_NOISE, terms, slopes)
    expected, precision, log_of_spread = _expected(gain, power, priors)
    target = right[..., None, :] + (precision @ expected[..., None])[..., 0]
    spread, log_determinant = inverse(precision + normal[..., None, :, :], log=True)
    solution = (spread @ target[..., None])[..., 0]
    log_of = priors.log_weights + 0.5 * ((target * solution).sum(-1) - log_determinant - log_of_spread)
    probability = xp.exp(log_of - xp.amax(log_of, -1)[..., None])
    probability = (probability / probability.sum(-1)[..., None])[..., None]
    mean = (probability * solution).sum(-2)
    off = solution - mean[..., None, :]
    spread = spread + off[..., None] * off[..., None, :]
    return mean.reshape(*gain.shape, TERMS), (probability[..., None] * spread).sum(-3)


def _normal(change: Any, weights: Any, terms: Any, slopes: Any) -> tuple[Any, Any]:
    """Return the normal equations (..., 18, 18) and their right side (..., 18), slopes integrated out.

    The trust of a block is diag(w) - sum_k v_k v_k' / p_k; its products are summed term by term.
    """
    xp, same = namespace(change), weights[..., None, :]
    lost: list[tuple[Any, Any]] = []
    wanted = same * change
    for k in range(0 if slopes is None else slopes.shape[-2]):
        unit = slopes[..., k, :]
        pull = same * unit
        for before, power in lost:
            pull = pull - before * ((before * unit).sum(-2) / power)[..., None, :]
        lost.append((pull, (weights + (unit * pull).sum(-2)).clip(TINY)))
        wanted = wanted - pull * ((pull * change).sum(-2) / lost[-1][1])[..., None, :]
    blocks = (terms * same[..., None, :]) @ terms.mT
    channels = xp.eye(3, dtype=blocks.dtype, device=blocks.device)[:, None, :, None]
    normal = (blocks[..., None, :] * channels).reshape(*weights.shape[:-1], 3 * TERMS, 3 * TERMS)
    for pull, power in lost:
        part = terms * (pull / xp.sqrt(power)[..., None, :])[..., None, :]
        part = part.reshape(*weights.shape[:-1], 3 * TERMS, -1)
        normal = normal - part @ part.mT
    return normal, (terms @ wanted[..., None]).reshape(*weights.shape[:-1], -1)


def _expected(gain: Any, power: int, priors: Priors) -> tuple[Any, Any, Any]:
    """Return the priors: means (..., kinds, 18), precisions (..., kinds, 18, 18), log terms (..., kinds)."""
    xp, each = namespace(gain), gain[..., None, :]
    common, spread = xp.abs(each), xp.amax(xp.abs(gain - ascending(gain)[..., 1:2]), -1)[..., None, None]
    stray, stray_std, gradient, mixture, mixture_std, uneven, separate = priors.kinds.T[:, :, None]
    gain_std = (separate * xp.amax(common, -1)[..., None] + MIN_STD).clip(None, COMMON_STD) / power
    plane = (gradient * common + uneven * spread + MIN_STD) / power
    none, mixed = xp.zeros_like(plane), mixture_std * spread + MIN_STD
    std = (none + gain_std, plane, plane, none + stray_std * common + MIN_STD, none + mixed, none + mixed)
    mixing = mixture[..., None] * (gain[..., priors.others] - gain[..., None])[..., None, :, :]
    expected = (none, none, none, none - stray * each, mixing[..., 0], mixing[..., 1])
    std, expected = (xp.stack(one, -1).reshape(*none.shape[:-1], 3 * TERMS) for one in (std, expected))
    precision = xp.eye(3 * TERMS, dtype=gain.dtype, device=gain.device) * (std**-2)[..., None]
    weight = std[..., 0] ** -2  # of a channel's own g_0; COMMON_STD is that of the shared g_0
    shared = weight / (3 + 1 / (COMMON_STD**2 * weight))
    precision[..., ::TERMS, ::TERMS] -= shared[..., None, None]
    log_of_spread = 2.0 * xp.log(std).sum(-1) + xp.log1p(3 * COMMON_STD**2 * weight)
    return expected, precision, log_of_spread + ((expected / std) ** 2).sum(-1)


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
    """Measure the drift of frames against one reference.

    Private methods take a frame's arrays, or tensors of B frames with a leading axis (`batched_drift.py`).
    """

    records = False  # whether steps are recorded, so that none may depend on numbers

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
        self.counted: Any = slice(None) if self.all_usable else np.flatnonzero(self.usable)
        self.priors = Priors()
        self.tilts, self.floor = np.diag([0.0, 1.0, 1.0]).ravel(), np.diag([TINY, 0.0, 0.0]).ravel()
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
        constant = self._medians(change / self.bright)
        change /= self.noise
        gains, weighted = constant[:, None] * np.eye(1, 3), change * self.shown
        for _ in range(MAX_ITERATIONS):
            before = gains
            gains, weights, touched, limit = self._reweighted(change, weighted, before)
            if np.abs(gains - before).max() < CONVERGENCE_TOL:
                break
        drift, undo, covariance = gains, None, None
        if np.abs(gains[:, 0]).max() > MIN_DRIFT:
            if self.power == 2:
                change *= 1.0 + self.bend * change
            drift, covariance = self._separated(change, weights, gains[:, 0], touched)
            gains, correction, mixed = self._inverse(drift)
            undo = correction if mixed else None
        left = self._left(change, drift)
        squares = np.add.reduce(left * left)
        shape = (self.size[1], self.size[0])
        untouched = (self.usable & (squares < limit)).reshape(shape)
        misfit = float(self._medians(squares)) ** 0.5
        return Drift(gains, untouched, np.sqrt(squares).reshape(shape), undo, covariance, misfit, left, tiles)

    def _reweighted(self, change: Any, weighted: Any, gains: Any) -> tuple[Any, Any, Any, Any]:
        """Return a round's gains (..., 3, 3), weights of the blocks, the mask (..., blocks) of touched ones, and
        its threshold (..., 1).
        """
        xp, squares = namespace(change), (self._left(change, gains) ** 2).sum(-2)
        scale = (self._medians(squares)[..., None] / MEDIAN_LENGTH**2).clip(1.0)
        limit = CONTACT.colour_sigma**2 * scale
        weights = self.usable / (1.0 + squares * (1 / (9 * scale))) ** 2
        touched = self.usable & (squares > limit)
        near = near_contact(touched.reshape(*touched.shape[:-1], self.size[1], self.size[0]))
        fitting = weights * ~near.reshape(touched.shape)
        few = (fitting != 0).sum(-1)[..., None] < MIN_BLOCKS
        fitting = xp.where(few, weights, fitting)
        return self._fit(weighted, fitting, gains[..., 0]), fitting, touched, limit

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

    def _among_usable(self, values: Any) -> Any:
        """Return the `values` (..., blocks) of the usable blocks."""
        return values if self.all_usable else values[..., self.counted]

    def _medians(self, values: Any) -> Any:
        """Return the medians (...) of `values` (..., blocks) over the usable blocks."""
        ordered = ascending(self._among_usable(values))
        low, high = self._middle
        return 0.5 * (ordered[..., low] + ordered[..., high])

    def _inverse(self, drift: Any) -> tuple[Any, Any, Any]:
        """Return gains (..., 3, 3) of the corrected picture, corrections (..., 3, 4) of light, and whether (...)
        they mix it, of a drift (..., 3, 6).
        """
        xp, gain = namespace(drift), 1.0 + self.power * drift[..., 0]
        mixed = xp.amax(xp.abs(drift[..., 3:]), (-2, -1)) >= self.power * CONVERGENCE_TOL
        level = filled(gain, mixed[..., None], 1.0) ** (1.0 / self.power)
        gains = xp.concatenate([(level - 1.0)[..., None], drift[..., 1:3] * (level / gain)[..., None]], -1)
        same = xp.eye(3, dtype=drift.dtype, device=drift.device)
        mix = same * (gain - drift[..., 4] - drift[..., 5])[..., None]
        for term in (0, 1):
            mix = mix + same[self.priors.others[:, term]] * drift[..., 4 + term, None]
        undo = inverse(self.light[:, None] * mix / self.light)[0]
        stray = -undo @ (drift[..., 3] * self.light)[..., None]
        return gains, xp.concatenate([undo, stray], -1), mixed

    def _separated(self, change: Any, weights: Any, constant: Any, touched: Any) -> tuple[Any, Any]:
        """Return the drift (..., 3, 6) and its covariance, separated from slopes around the `touched` blocks."""
        shape, slopes = (self.size[1], self.size[0]), None
        contact = solid(touched.reshape(*touched.shape[:-1], *shape))
        noise = noise_of(change.reshape(*change.shape[:-1], *shape), weights.reshape(contact.shape))
        noise = noise[..., None, None]
        change, effects, terms = (
            change / noise,
            self.slope_effects / noise[..., None],
            self.terms / noise[..., None],
        )
        if self.records or contact.any():
            slopes = likely_slopes(change, effects, touched=contact)
        gain, power, priors = (1.0 + constant) ** self.power - 1.0, self.power, self.priors
        return drift_of(change, weights, terms=terms, slopes=slopes, gain=gain, power=power, priors=priors)

    def _blocks(self, planes: Any) -> Any:
        """Return the means (..., 3, h * w) of planes over the blocks."""
        blocks, xp = (self.down @ planes).reshape(-1, planes.shape[-1]) @ self.across, namespace(planes)
        return xp.asarray(blocks, dtype=xp.float64).reshape(*planes.shape[:-2], -1)

    def _left(self, change: Any, gains: Any) -> Any:
        return change - (gains[..., None, :] @ self.terms[:, : gains.shape[-1]])[..., 0, :]

    def _fit(self, weighted: Any, weights: Any, constant: Any) -> Any:
        """Return gains (..., 3, 3) by weighted least squares with a prior on the plane."""
        prior = CORRELATED / (PLANE_SHARE * abs(constant) + MIN_PLANE) ** 2
        normal = (weights @ self.normal).reshape(*prior.shape, 9) + (prior[..., None] * self.tilts + self.floor)
        right = (weighted * weights[..., None, :]) @ self.basis
        return (inverse(normal.reshape(*prior.shape, 3, 3))[0] @ right[..., None])[..., 0]

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


@singledispatch
def solid(touched: Any) -> Any:
    """Return the mask (..., h, w) of `touched` blocks that fill two by two; the others are noise."""
    whole = cv2.erode(touched.astype(np.uint8), SOLID, borderValue=0)
    return np.asarray(cv2.dilate(whole, SOLID, anchor=(0, 0)) > 0)


@singledispatch
def near_contact(touched: Any) -> Any:
    """Return the mask (..., h, w) of blocks near a contact, whose slopes resemble drift; single ones are noise."""
    if not touched.any():
        return touched
    whole = cv2.erode(touched.view(np.uint8), SOLID)
    return np.asarray(cv2.dilate(whole, NEAR, anchor=(3, 3)) > 0)


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
