"""The untouched gel: its mean picture, the camera's noise, and where the picture can be used at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.background import DARK
from tactilevision.photometric.markers import Marks, find_marks
from tactilevision.recording import layout
from tactilevision.records import Bools, Bytes
from tactilevision.robust import MAD_TO_STD

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
