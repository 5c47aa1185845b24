"""The untouched gel: mean picture, camera noise, usable pixels, and slope bias of a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.markers import Marks, find_marks
from tactilevision.recording import layout
from tactilevision.records.measured import Bools, Bytes, Floats
from tactilevision.robust import MAD_TO_STD

# What a law says of gel that nobody touches: its bias and its noise over the picture.
#
# Where a channel is nearly dark, its noise goes through the law's products and comes out as a slope that is not
# there; and clipping at black moves the mean of noisy frames, by about DARK^2/(DARK^2 + I^2) grey levels, against
# that of quieter ones. The ball pictures show plenty of untouched gel: the mean slope found on it is taken off,
# and a place where noise, bias or darkness come to more than a slope is likely to be is damped towards flat:
#
#     slope -> (slope - bias) / (1 + D^2)     D = (bias^2 + noise^2) / NOISE_LIMIT^2 + dark^2 / DARK_LIMIT^2
#
# so that a place of little doubt is not touched, and one with D > 1 is marked as not readable.
# The gel far from a ball still slopes a little, and always outwards at the picture's border; so a bias counts only
# as far as it exceeds MIN_BIAS.

Picture = npt.NDArray[np.float32]
BLOCK = 8  # px along each side of a block; smaller ones hold too few pixels to tell bias from noise
# slope up to which a bias counts as the gel's own lean near a ball; less would take true slopes off
MIN_BIAS = 0.01
DARK_LIMIT = 0.01  # slope from darkness; all of a dark place's pixels share it, so that it does not average out
DARK = 6.0  # grey levels of a channel at which clipping at black moves its mean by half a grey level
PAIRS = 4  # draws of noise, each with both signs; more cost time at start, and the blur below averages as well
BLUR_PX = 8.0  # px, sigma of the blur of the drawn bias; less leaves more of the draws' own noise in it
NOISE_LIMIT = 0.1  # slope noise at which a pixel tells no more than expecting a flat gel does


@dataclass(frozen=True, slots=True)
class SlopeBackground:
    """`bias_x`, `bias_y`, `noise` (h, w) float32 in blocks of BLOCK pixels: slopes found where there are none."""

    bias_x: Picture
    bias_y: Picture
    noise: Picture

    def over(self, shape: tuple[int, int]) -> tuple[Picture, Picture, Picture]:
        """The three maps at (H, W), smooth between blocks."""
        size = (shape[1], shape[0])
        maps = [
            cv2.resize(m, size, interpolation=cv2.INTER_LINEAR) for m in (self.bias_x, self.bias_y, self.noise)
        ]
        return maps[0], maps[1], maps[2]


class BackgroundSums:
    """Gathers untouched slopes, picture by picture, block by block."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.size = (max(2, shape[1] // BLOCK), max(2, shape[0] // BLOCK))
        self.count, self.sum_x, self.sum_y, self.squares = np.zeros((4, self.size[1], self.size[0]))

    def add(self, slope_x: Picture, slope_y: Picture, untouched: Bools) -> None:
        """Count in the slopes (H, W) found where the gel is `untouched` (H, W)."""
        mask = untouched.astype(np.float32)
        self.count += self._blocks(mask)
        self.sum_x += self._blocks(slope_x * mask)
        self.sum_y += self._blocks(slope_y * mask)
        self.squares += self._blocks((slope_x**2 + slope_y**2) * mask)

    def result(self, expected: Picture) -> SlopeBackground:
        """Bias and noise; where the gel was never untouched, no bias and the `expected` noise (H, W)."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        bias_x, bias_y = np.where(counted, self.sum_x / count, 0.0), np.where(counted, self.sum_y / count, 0.0)
        size = np.hypot(bias_x, bias_y)
        excess_share = np.maximum(0.0, 1.0 - MIN_BIAS / np.maximum(size, 1e-9))
        variance = 0.5 * np.maximum(self.squares / count - bias_x**2 - bias_y**2, 0.0)
        noise = np.where(counted, np.sqrt(variance), self._blocks(expected))
        return SlopeBackground(_single(excess_share * bias_x), _single(excess_share * bias_y), _single(noise))

    def added_to(self, background: SlopeBackground, kept_share: Picture) -> SlopeBackground:
        """`background` with the mean slopes gathered here, which came out damped by `kept_share` (H, W), in its
        bias.

        Smooth over three blocks, over which a law's bias hardly changes and noise averages out.
        """
        count = np.where(self.count > 0.5, self.count, np.inf)
        damped = np.maximum(self._blocks(kept_share), 0.5)
        extra = [cv2.GaussianBlur(total / count / damped, (0, 0), 1.5) for total in (self.sum_x, self.sum_y)]
        return SlopeBackground(
            _single(background.bias_x + extra[0]), _single(background.bias_y + extra[1]), background.noise
        )

    def noise_over(self, noise: Picture) -> float:
        """Median ratio of the noise gathered here to `noise` (H, W), which often is that of means of pictures."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        variance = 0.5 * (self.squares - (self.sum_x**2 + self.sum_y**2) / count) / count
        return float(
            np.median(np.sqrt(np.maximum(variance, 0.0))[counted] / np.maximum(self._blocks(noise), 1e-9)[counted])
        )

    def _blocks(self, picture: Picture) -> npt.NDArray[np.float64]:
        return np.asarray(cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA), np.float64)


def _single(values: npt.NDArray[np.floating[Any]]) -> Picture:
    return np.asarray(values, np.float32)


def damping(background: tuple[Picture, Picture, Picture], dark: Picture) -> Picture:
    """D (H, W) out of bias in x, bias in y, noise, and the slope that darkness may pretend."""
    return _single(
        (background[0] ** 2 + background[1] ** 2 + background[2] ** 2) / NOISE_LIMIT**2 + (dark / DARK_LIMIT) ** 2
    )


def darkness(levels: Picture) -> Picture:
    """Grey levels by which clipping at black may have moved channels of mean `levels` (grey, any shape)."""
    return _single(DARK**2 / (DARK**2 + levels**2))


def noise_bias(evaluate: Callable[[Picture], tuple[Picture, Picture]], noise: Picture) -> tuple[Picture, Picture]:
    """Mean slopes (H, W) that a law finds in nothing but noise: its even part makes a slope of the noise's square.

    `noise` (3, H, W) is the standard deviation of the changes. Drawn in pairs of opposite sign, in which the odd
    part cancels; smooth over BLUR_PX pixels.
    """
    rng = np.random.default_rng(0)  # a fixed draw: a method does not change between runs
    total = np.zeros((2, *noise.shape[1:]), np.float32)
    for _ in range(PAIRS):
        drawn = rng.standard_normal(noise.shape, dtype=np.float32) * noise
        for signed in (drawn, -drawn):
            for slope, drawn_slope in zip(total, evaluate(signed), strict=True):
                slope += drawn_slope
    smooth = [cv2.GaussianBlur(slope / (2 * PAIRS), (0, 0), BLUR_PX) for slope in total]
    return _single(smooth[0]), _single(smooth[1])


# The untouched gel: its mean picture, the camera's noise, and where the picture can be used at all.

COLOURS = ("red", "green", "blue")
SATURATED = 253  # grey level from which a channel no longer counts light (JPEG moves 255 about)
MAX_OVEREXPOSED = 0.05  # of the picture; nine real sensors have none, .15 cost 20 um of depth
MIN_SIGNAL = 12.0  # brightness over noise below which a pixel tells nothing of slope


@dataclass(frozen=True, slots=True)
class Reference:
    """`rgb` (H, W, 3) float32, the mean untouched picture; `noise_grey` (3,) of one reading; `usable` (H, W); the
    gel's `marks`, None where it has none."""

    rgb: npt.NDArray[np.float32]
    noise_grey: tuple[float, float, float]
    usable: Bools
    marks: Marks | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self.rgb.shape[0], self.rgb.shape[1]

    @property
    def overexposed(self) -> Bools | None:
        """Where (3, H, W) a colour of the untouched gel is overexposed; None where none is."""
        over = self.rgb >= SATURATED
        return over.transpose(2, 0, 1).copy() if over.any() else None

    @property
    def dark_colour(self) -> int | None:
        """The one colour that is dark on most of the gel: a lamp that is off. None: none is, or several."""
        dark = np.flatnonzero(np.median(self.rgb, axis=(0, 1)) < DARK)
        return int(dark[0]) if len(dark) == 1 else None

    @property
    def lit_by_two(self) -> Bools:
        """Where (H, W) colours that are not overexposed, two at least, have signal enough to tell slopes."""
        return _lit_by_two(self.rgb, self.noise_grey)


def make_reference(flats: Sequence[Bytes], *, may_have_marks: bool = True) -> Reference:
    """The reference out of one or more rectified pictures of the untouched gel; its marks, if it `may_have_marks`.

    Noise comes from the differences between flats, or of a single one from its finest detail. Raises
    InputError for no flats, sizes that differ, black or saturated ones, ones of one colour, and ones that disagree
    (contact).
    """
    if not flats:
        raise InputError(
            "no picture of the untouched gel",
            where=layout.FLATS,
            remedy="One or more frames without contact are needed.",
        )
    sizes = {flat.shape for flat in flats}
    if len(sizes) > 1:
        raise InputError("the flat frames differ in size", where=layout.FLATS, value=sorted(sizes))
    stack = np.stack([np.asarray(flat, dtype=np.float32) for flat in flats])
    mean = stack.mean(axis=0)
    noise = _noise_between(stack) if len(flats) > 1 else _noise_within(mean)
    _check_agreement(stack, noise)
    signal = np.sqrt(np.sum((mean / np.asarray(noise, np.float32)) ** 2, axis=2))
    usable = (mean.max(axis=2) < SATURATED) & (signal > MIN_SIGNAL)
    if (usable | _lit_by_two(mean, noise)).mean() < 0.3:
        dark = float(mean.mean()) < 100
        raise InputError(
            "most of the reference is " + ("black" if dark else "saturated"),
            where=layout.FLATS,
            value=f"mean grey {mean.mean():.0f} of 255",
            remedy="Check the lights." if dark else "Shorten the exposure.",
        )
    _check_lit(mean)
    marks = find_marks(np.rint(mean).astype(np.uint8)) if may_have_marks else None
    return Reference(mean, noise, usable, marks)


def dark_colour_warning(reference: Reference) -> tuple[str, ...]:
    """What to know where a colour of the untouched gel is dark."""
    if (dark := reference.dark_colour) is None:
        return ()
    level = float(np.median(reference.rgb[..., dark]))
    return (
        f"the untouched gel is dark in {COLOURS[dark]} (grey {level:.0f} of 255): is that lamp off? Slopes are "
        "told by the other two colours alone, worse along one direction",
    )


def overexposed_warning(reference: Reference) -> tuple[str, ...]:
    """What to know where a colour of the untouched gel is overexposed in more than MAX_OVEREXPOSED of it."""
    shares = np.mean(reference.rgb >= SATURATED, axis=(0, 1))
    named = [
        f"{name} in {100 * share:.0f} %"
        for name, share in zip(COLOURS, shares, strict=True)
        if share > MAX_OVEREXPOSED
    ]
    if not named:
        return ()
    return (
        f"the untouched gel is overexposed, {' and '.join(named)} of it: the others tell slopes there, less "
        "surely, and without ball presses nothing does. Shorten the exposure, or dim that lamp",
    )


def _check_lit(mean: npt.NDArray[np.float32]) -> None:
    """Raise InputError where less than two colours are above DARK on most of the gel."""
    levels = np.median(mean, axis=(0, 1))
    if np.count_nonzero(levels >= DARK) < 2:
        raise InputError(
            "the untouched gel is dark in two colours or more, and one alone tells no slope",
            where=layout.FLATS,
            value="grey of 255: " + ", ".join(f"{name} {x:.0f}" for name, x in zip(COLOURS, levels, strict=True)),
            remedy="Check the lights and the exposure. Of 16-bit pictures state the sensor's white_level.",
        )


def _lit_by_two(mean: npt.NDArray[np.float32], noise_grey: tuple[float, float, float]) -> Bools:
    known = mean < SATURATED
    signal = np.sqrt(np.sum((known * mean / np.asarray(noise_grey, np.float32)) ** 2, axis=2))
    return np.asarray((known.sum(axis=2) >= 2) & (signal > MIN_SIGNAL))


def darkest_grey(noise_grey: tuple[float, float, float]) -> float:
    """Grey level of its brightest channel up to which a frame's pixel lies in shadow and tells nothing of slope: a
    signal of MIN_SIGNAL where all three are alike."""
    return MIN_SIGNAL / 3**0.5 * float(np.mean(noise_grey))


def _noise_between(stack: npt.NDArray[np.float32]) -> tuple[float, float, float]:
    spread = np.sqrt(np.mean(np.var(stack, axis=0, ddof=1), axis=(0, 1)))
    return _floored(spread)


def _noise_within(mean: npt.NDArray[np.float32]) -> tuple[float, float, float]:
    """Median response to a filter that no plane or curved surface excites (Immerkaer, CVIU 64, 1996)."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6.0
    fine = np.abs(cv2.filter2D(mean, -1, kernel))
    return _floored(MAD_TO_STD * np.median(fine.reshape(-1, 3), axis=0))


def _floored(noise: npt.NDArray[np.floating]) -> tuple[float, float, float]:
    """Rounding to whole grey levels is noise of 0.29; no camera has less."""
    red, green, blue = (max(float(value), 0.29) for value in noise)
    return red, green, blue


def _check_agreement(stack: npt.NDArray[np.float32], noise: tuple[float, float, float]) -> None:
    """A contact in one of several flats shows as a patch that leaves their median."""
    if len(stack) < 3:
        return
    median = np.median(stack, axis=0)
    for index, flat in enumerate(stack):
        change = cv2.GaussianBlur(flat - median, (0, 0), 3.0)
        change -= np.median(change, axis=(0, 1))
        size = np.abs(change / np.asarray(noise, np.float32)).max(axis=2)
        if (size > 5.0).mean() > 0.002:
            raise InputError(
                "a flat frame shows a contact, or the light changed over part of it",
                where=layout.FLATS,
                value=f"frame {index + 1} of {len(stack)}",
                remedy="Remove that frame.",
            )


# Has a method been made in the light that it is to be used in?
#
# Slope is read from colour change over brightness, so exposure and white balance cancel out. What remains is how
# the light falls: where lamps stand otherwise, the brightness of the untouched gel has another pattern, and the
# gain of slope changes by about as much as that pattern does.

BLOCKS = (8, 6)  # across, down: coarse enough that neither marks nor noise tell
MIN_CHANGE = 0.1  # of brightness: lamps age and gels wear by half of it
SAME_SHAPE = 0.02  # of the ratio of width to height: what a resized picture loses by whole pixels


def light_of(reference: Reference) -> Floats:
    """Mean grey (6, 8, 3) of the untouched gel in blocks, NaN where a block is mostly unusable."""
    usable = reference.usable.astype(np.float32)
    share = cv2.resize(usable, BLOCKS, interpolation=cv2.INTER_AREA)[..., None]
    mean = cv2.resize(reference.rgb * usable[..., None], BLOCKS, interpolation=cv2.INTER_AREA)
    return np.where(share > 0.5, mean / np.maximum(share, 1e-6), np.nan).astype(np.float64)


def change_of_light(before: npt.ArrayLike, after: npt.ArrayLike) -> float:
    """Rms by which the pattern of the light changed, as a share of brightness; gains cancel out."""
    ratio = np.log(np.maximum(np.asarray(after, float), 1.0) / np.maximum(np.asarray(before, float), 1.0))
    if not np.isfinite(ratio).any():
        return float("nan")
    return float(np.sqrt(np.nanmean((ratio - np.nanmedian(ratio, axis=(0, 1))) ** 2)))


def other_light(before: npt.ArrayLike, reference: Reference, *, scale_error: float) -> tuple[str, ...]:
    """A warning where the scale of slope is off by more for the light than it was on balls of its own sensor.

    `scale_error` is the latter, relatively, of whole balls: that of single pixels is mostly their noise.
    """
    change = change_of_light(before, light_of(reference))
    if not change > max(MIN_CHANGE, scale_error):
        return ()
    return (
        "the method was made in another light: over the picture brightness differs by "
        f"{100 * change:.0f} %, exposure allowed for, and so does the scale of slopes (error in its own light: "
        f"{100 * scale_error:.0f} %); depths are not to be trusted, train a method on this sensor's balls",
    )


def check_view(before: tuple[int, int], after: tuple[int, int]) -> None:
    """Raises InputError where two pictures (height, width) cannot be one view at two sizes."""
    if abs(before[1] * after[0] / (before[0] * after[1]) - 1) > SAME_SHAPE:
        raise InputError(
            "the method was made for pictures of another shape",
            where="method",
            value=f"{before[1]} x {before[0]}, the recording's are {after[1]} x {after[0]}",
            remedy="Rectify alike, or train a method on this sensor's balls.",
        )
