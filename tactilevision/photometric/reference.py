"""The untouched gel: mean picture, camera noise, usable pixels, and slope bias of a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.markers import Marks, find_marks
from tactilevision.recording import layout
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Array, Bools, Bytes, Floats, Picture
from tactilevision.records.rig import Sensor
from tactilevision.robust import MAD_TO_STD

# Bias and noise of a law on untouched gel.
#
# Where a channel is nearly dark, products of its noise give a false slope, and clipping at black shifts the mean
# of noisy frames by about DARK^2/(DARK^2 + I^2) grey levels. The mean slope on the untouched gel of the ball
# pictures is subtracted, and slopes are damped where noise, bias or darkness exceed a likely slope:
#
#     slope -> (slope - bias) / (1 + D^2)     D = (bias^2 + noise^2) / NOISE_LIMIT^2 + dark^2 / DARK_LIMIT^2
#
# Places with D > 1 are marked unreadable. The gel far from a ball still slopes a little, outwards at the border,
# so only the part of a bias above MIN_BIAS counts.

BLOCK = 8  # px along each side of a block; smaller ones do not separate bias from noise
MIN_BIAS = 0.01  # slope that may be that of the gel far from a ball
DARK_LIMIT = 0.01  # slope from darkness; it is shared by all pixels of a dark place and does not average out
DARK = 6  # grey levels of a channel at which clipping at black shifts its mean by half a grey level
PAIRS = 4  # realisations of noise, each with both signs
BLUR_PX = 8  # px, sigma of the blur of the simulated bias
NOISE_LIMIT = 0.1  # slope noise at which a pixel weighs as much as the prior of flat gel


def background_over(background: Picture, shape: tuple[int, int]) -> Picture:
    """Return bias in x, bias in y and noise (3, H, W) of slopes, linear between the blocks of `background`."""
    blocks = cv2.resize(np.dstack([*background]), shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.stack(cv2.split(blocks))


class BackgroundSums:
    """Sums of slopes on untouched gel over pictures, by blocks of BLOCK pixels.

    A background (3, h, w) is the bias in x, the bias in y and the noise of the slopes there.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.size = (max(2, shape[1] // BLOCK), max(2, shape[0] // BLOCK))
        self.count, self.sum_x, self.sum_y, self.squares = np.zeros((4, self.size[1], self.size[0]))

    def add(self, slope_x: Picture, slope_y: Picture, untouched: Bools) -> None:
        """Add the slopes (H, W) where the gel is `untouched` (H, W)."""
        mask = untouched.astype(np.float32)
        self.count += self._blocks(mask)
        self.sum_x += self._blocks(slope_x * mask)
        self.sum_y += self._blocks(slope_y * mask)
        self.squares += self._blocks((slope_x**2 + slope_y**2) * mask)

    def result(self, expected: Picture) -> Picture:
        """Return the background; no bias and the `expected` noise (H, W) where the gel was never untouched."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        bias_x, bias_y = np.where(counted, self.sum_x / count, 0.0), np.where(counted, self.sum_y / count, 0.0)
        size = np.hypot(bias_x, bias_y)
        excess_share = np.maximum(0.0, 1.0 - MIN_BIAS / np.maximum(size, TINY))
        variance = 0.5 * np.maximum(self.squares / count - bias_x**2 - bias_y**2, 0.0)
        noise = np.where(counted, np.sqrt(variance), self._blocks(expected))
        return _single(np.stack([excess_share * bias_x, excess_share * bias_y, noise]))

    def added_to(self, background: Picture, kept_share: Picture) -> Picture:
        """Return `background` with these mean slopes, damped by `kept_share` (H, W), added to its bias.

        They are smoothed over three blocks, over which the bias of a law hardly changes.
        """
        count = np.where(self.count > 0.5, self.count, np.inf)
        damped = np.maximum(self._blocks(kept_share), 0.5)
        extra = [cv2.GaussianBlur(total / count / damped, (0, 0), 1.5) for total in (self.sum_x, self.sum_y)]
        return _single(background + np.stack([*extra, np.zeros_like(damped)]))

    def noise_over(self, noise: Picture) -> float:
        """Return the median ratio of this noise to `noise` (H, W)."""
        counted = self.count > 0.5
        count = np.where(counted, self.count, 1.0)
        variance = 0.5 * (self.squares - (self.sum_x**2 + self.sum_y**2) / count) / count
        ratio = np.sqrt(np.maximum(variance, 0.0)) / np.maximum(self._blocks(noise), TINY)
        return float(np.median(ratio[counted]))

    def _blocks(self, picture: Picture) -> Floats:
        return np.asarray(cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA), np.float64)


def _single(values: Array) -> Picture:
    return np.asarray(values, np.float32)


def damping(background: Picture, dark: Picture) -> Picture:
    """Return D (H, W) from bias in x, bias in y and noise (3, H, W), and the slope error by darkness."""
    return _single((background**2).sum(axis=0) / NOISE_LIMIT**2 + (dark / DARK_LIMIT) ** 2)


def darkness(levels: Picture) -> Picture:
    """Return the shift in grey levels by clipping at black of channels of mean `levels` (grey, any shape)."""
    return _single(DARK**2 / (DARK**2 + levels**2))


def noise_bias(evaluate: Callable[[Picture], tuple[Picture, Picture]], noise: Picture) -> tuple[Picture, Picture]:
    """Return the mean slopes (H, W) by a law of noise alone, which its even part makes of the square of the noise.

    `noise` (3, H, W): standard deviation of the changes, simulated in pairs of opposite sign, in which the odd
    part cancels. The result is blurred over BLUR_PX pixels.
    """
    rng = np.random.default_rng(0)  # fixed: a method does not change between runs
    total = np.zeros((2, *noise.shape[1:]), np.float32)
    for _ in range(PAIRS):
        sample = rng.standard_normal(noise.shape, dtype=np.float32) * noise
        for signed in (sample, -sample):
            for total_slope, slope in zip(total, evaluate(signed), strict=True):
                total_slope += slope
    smooth = [cv2.GaussianBlur(slope / (2 * PAIRS), (0, 0), BLUR_PX) for slope in total]
    return _single(smooth[0]), _single(smooth[1])


# Mean picture of the untouched gel, noise of the camera, and usable pixels.

COLOURS = ("red", "green", "blue")
SATURATED = 253  # grey level from which a channel is saturated (JPEG changes 255)
MAX_OVEREXPOSED = 0.05  # of the picture; nine real sensors have none, .15 cost 20 um of depth
MIN_SIGNAL = 12  # brightness over noise of a usable pixel
MIN_GREY_NOISE = 0.29  # grey levels, of rounding


@dataclass(frozen=True, slots=True)
class Reference:
    """Mean untouched picture `rgb` (H, W, 3) float32, `noise_grey` (3,) of one frame, `usable` (H, W), `marks`."""

    rgb: Picture
    noise_grey: tuple[float, float, float]
    usable: Bools
    marks: Marks | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self.rgb.shape[0], self.rgb.shape[1]

    @property
    def overexposed(self) -> Bools | None:
        """Mask (3, H, W) of overexposed colours of the untouched gel; None without any."""
        over = self.rgb >= SATURATED
        return over.transpose(2, 0, 1).copy() if over.any() else None

    @property
    def dark_colour(self) -> int | None:
        """Number of the one colour that is dark on most of the gel (a lamp is off); None for none or several."""
        dark = np.flatnonzero(np.array(medians(self.rgb)) < DARK)
        return int(dark[0]) if len(dark) == 1 else None

    @property
    def lit_by_two(self) -> Bools:
        """Mask (H, W) where at least two colours are not overexposed and have enough signal."""
        known = self.rgb < SATURATED
        signal = np.sqrt(np.sum((known * self.rgb / np.asarray(self.noise_grey, np.float32)) ** 2, axis=2))
        return np.asarray((known.sum(axis=2) >= 2) & (signal > MIN_SIGNAL))


def make_reference(flats: Sequence[Bytes], *, may_have_marks: bool = True) -> Reference:
    """Return the reference from rectified pictures of the untouched gel; its marks, if it `may_have_marks`.

    Noise is estimated from differences between flats, or from the finest detail of a single one. Raises InputError
    for no flats, different sizes, black, saturated or single-coloured flats, and a contact in one of them.
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
    _check_agreement(flats, noise)
    signal = np.sqrt(np.sum((mean / np.asarray(noise, np.float32)) ** 2, axis=2))
    usable = (mean.max(axis=2) < SATURATED) & (signal > MIN_SIGNAL)
    reference = Reference(mean, noise, usable)
    if (usable | reference.lit_by_two).mean() < 0.3:
        dark = float(mean.mean()) < 100
        raise InputError(
            "most of the reference is " + ("black" if dark else "saturated"),
            where=layout.FLATS,
            value=f"mean grey {mean.mean():.0f} of 255",
            remedy="Check the lights." if dark else "Shorten the exposure.",
        )
    _check_lit(mean)
    return replace(reference, marks=find_marks(np.rint(mean).astype(np.uint8))) if may_have_marks else reference


def dark_colour_warning(reference: Reference) -> tuple[str, ...]:
    """Return a warning where a colour of the untouched gel is dark."""
    if (dark := reference.dark_colour) is None:
        return ()
    level = float(np.median(reference.rgb[..., dark]))
    return (
        f"the untouched gel is dark in {COLOURS[dark]} (grey {level:.0f} of 255): is that lamp off? Slopes follow "
        "from the other two colours alone, with a larger error along one direction",
    )


def overexposed_warning(reference: Reference) -> tuple[str, ...]:
    """Return a warning where a colour is overexposed in more than MAX_OVEREXPOSED of the untouched gel."""
    shares = np.mean(reference.rgb >= SATURATED, axis=(0, 1))
    named = [
        f"{name} in {100 * share:.0f} %"
        for name, share in zip(COLOURS, shares, strict=True)
        if share > MAX_OVEREXPOSED
    ]
    if not named:
        return ()
    return (
        f"the untouched gel is overexposed, {' and '.join(named)} of it: slopes there follow from the other "
        "colours, with a larger error, and are unknown without ball presses. Shorten the exposure or dim the lamp",
    )


ROUND = 0.02  # of the radius, rms: lit parts of five real flat pads differ from a circle by .057 or more
EDGE = 0.7  # ln of grey: over a tenth of the radius vignetting of those five loses .21 at most


def round_outline_px(reference: Reference) -> float | None:
    """Return the radius (px) of the circle that limits the lit gel; None where its outline is not one circle.

    The lit part is above Otsu's threshold of ln of grey. Its outline inside the picture is a circle where it
    deviates from one by ROUND of the radius (rms) at most, covers half of it, and is an edge: light falls by more
    than EDGE over a tenth of the radius. A gel that fills the picture shows no outline.
    """
    light = np.log1p(cv2.GaussianBlur(reference.rgb, (0, 0), 1).max(axis=2))
    height, width = light.shape
    levels = cv2.normalize(light, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    lit = cv2.threshold(levels, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1]
    outlines, _ = cv2.findContours(lit, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=len, default=np.empty((0, 1, 2)))[:, 0].astype(float)
    outline = outline[((outline > 1) & (outline < (width - 2, height - 2))).all(axis=1)]
    if len(outline) < min(light.shape):
        return None
    columns = np.column_stack([2 * outline, np.ones(len(outline))])  # of x^2 + y^2 = 2 x0 x + 2 y0 y + constant
    (x, y, constant), *_ = np.linalg.lstsq(columns, (outline**2).sum(axis=1))
    radius = float(np.sqrt(constant + x**2 + y**2))
    off = outline - (x, y)
    angles = np.unique(np.floor(np.degrees(np.arctan2(off[:, 1], off[:, 0]))))
    if np.sqrt(np.mean((np.hypot(*off.T) - radius) ** 2)) > ROUND * radius or len(angles) < 180:
        return None
    distance = np.hypot(np.arange(width) - x, np.arange(height)[:, None] - y) / radius
    within, beyond = (light[abs(distance - place) < 0.025] for place in (0.95, 1.05))
    return radius if within.size and beyond.size and np.median(within) - np.median(beyond) > EDGE else None


def round_outline_warning(reference: Reference, sensor: Sensor) -> tuple[str, ...]:
    """Return a warning where the untouched gel is seen as a disc, and stated as a layer without a round side."""
    if sensor.gel is None or sensor.gel.shape not in ("unbounded", "rectangle"):
        return ()
    if (radius := round_outline_px(reference)) is None:
        return ()
    return (
        f"the untouched picture shows gel within a circle of {radius * sensor.mm_per_px[0]:.1f} mm radius, and "
        f'its shape is stated as "{sensor.gel.shape}": state "disc" for a flat pad, or "dome" for a round finger, '
        "whose forces are off by a third if read as a flat layer",
    )


def _check_lit(mean: Picture) -> None:
    """Raise InputError where less than two colours are above DARK on most of the gel."""
    levels = medians(mean)
    if np.count_nonzero(np.array(levels) >= DARK) < 2:
        raise InputError(
            "the untouched gel is dark in two colours or more, and one alone does not determine slopes",
            where=layout.FLATS,
            value="grey of 255: " + ", ".join(f"{name} {x:.0f}" for name, x in zip(COLOURS, levels, strict=True)),
            remedy="Check the lights and the exposure. Of 16-bit pictures state the sensor's white_level.",
        )


def medians(picture: Picture) -> list[float]:
    """Return the median of each channel of a picture (H, W, 3), in its unit."""
    return [float(np.median(plane)) for plane in cv2.split(picture)]


def darkest_grey(noise_grey: tuple[float, float, float]) -> float:
    """Return the grey level of the brightest channel up to which a pixel is shaded."""
    return MIN_SIGNAL / 3**0.5 * float(np.mean(noise_grey))


def _noise_between(stack: Picture) -> tuple[float, float, float]:
    spread = np.sqrt(np.mean(np.var(stack, axis=0, ddof=1), axis=(0, 1)))
    return _floored(spread)


def _noise_within(mean: Picture) -> tuple[float, float, float]:
    """Return the noise (3,) by a filter that cancels planes and quadratics (Immerkaer, CVIU 64, 1996)."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    fine = np.abs(cv2.filter2D(mean, -1, kernel))
    return _floored(MAD_TO_STD * np.median(fine.reshape(-1, 3), axis=0))


def _floored(noise: Array) -> tuple[float, float, float]:
    red, green, blue = (max(float(value), MIN_GREY_NOISE) for value in noise)
    return red, green, blue


def _check_agreement(flats: Sequence[Bytes], noise: tuple[float, float, float]) -> None:
    """Raise InputError where one of several flats differs from their median over a patch, as in a contact."""
    if len(flats) < 3:
        return
    median = np.median(flats, axis=0).astype(np.float32)
    for index, flat in enumerate(flats):
        change = cv2.GaussianBlur(flat - median, (0, 0), 3)
        change -= np.asarray(medians(change), np.float32)
        size = [np.abs(plane / np.float32(std)) for plane, std in zip(cv2.split(change), noise, strict=True)]
        if (np.maximum.reduce(size) > 5).mean() > 0.002:
            raise InputError(
                "a flat frame shows a contact, or the light changed over part of it",
                where=layout.FLATS,
                value=f"frame {index + 1} of {len(flats)}",
                remedy="Remove that frame.",
            )


# Whether the light is that in which a method was made.
#
# Slopes follow from relative colour changes, which exposure and white balance do not affect. Other lamp positions
# change the pattern of brightness of the untouched gel, and the gain of slope by about as much.

BLOCKS = (8, 6)  # across, down: coarse enough to average out marks and noise
MIN_CHANGE = 0.1  # of brightness: ageing of lamps and wear of gels make half of it
SAME_SHAPE = 0.02  # of the ratio of width to height: rounding of a resized picture to whole pixels


def light_of(reference: Reference) -> Floats:
    """Return the mean grey (6, 8, 3) of the untouched gel in blocks, NaN where a block is mostly unusable."""
    usable = reference.usable.astype(np.float32)
    share = cv2.resize(usable, BLOCKS, interpolation=cv2.INTER_AREA)[..., None]
    mean = cv2.resize(reference.rgb * usable[..., None], BLOCKS, interpolation=cv2.INTER_AREA)
    return np.where(share > 0.5, mean / np.maximum(share, TINY), np.nan).astype(np.float64)


def change_of_light(before: npt.ArrayLike, after: npt.ArrayLike) -> float:
    """Return the relative rms change of the pattern of the light; gains cancel."""
    ratio = np.log(np.maximum(np.asarray(after, float), 1.0) / np.maximum(np.asarray(before, float), 1.0))
    if not np.isfinite(ratio).any():
        return float("nan")
    return float(np.sqrt(np.nanmean((ratio - np.nanmedian(ratio, axis=(0, 1))) ** 2)))


def other_light(before: npt.ArrayLike, reference: Reference, *, scale_error: float) -> tuple[str, ...]:
    """Return a warning where the light changed by more than `scale_error`, the relative error on own balls."""
    change = change_of_light(before, light_of(reference))
    if not change > max(MIN_CHANGE, scale_error):
        return ()
    return (
        "the method was made in another light: corrected for exposure, brightness over the picture differs by "
        f"{100 * change:.0f} %, and so does the scale of slopes (error in its own light: "
        f"{100 * scale_error:.0f} %); depths are unreliable, train a method on balls of this sensor",
    )


def check_view(before: tuple[int, int], after: tuple[int, int]) -> None:
    """Raise InputError where two pictures (height, width) cannot be one view at two sizes."""
    if abs(before[1] * after[0] / (before[0] * after[1]) - 1) > SAME_SHAPE:
        raise InputError(
            "the method was made for pictures of another shape",
            where="method",
            value=f"{before[1]} x {before[0]}, the recording's are {after[1]} x {after[0]}",
            remedy="Use the same rectification, or train a method on balls of this sensor.",
        )
