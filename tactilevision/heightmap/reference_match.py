"""Compare frames with their reference: image shift, contact in the reference, and gel slopes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import scale_is_assumed, unfit
from tactilevision.heightmap.scene_faults import exchanged, scene_faults
from tactilevision.heightmap.zero_plane import ZeroPlane
from tactilevision.photometric.ball_consistency import COVERED
from tactilevision.photometric.colour_change import FrameChange
from tactilevision.photometric.drift import MEDIAN_LENGTH, Drift, DriftTracker, block_means, distance_px, solid
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.reference import Reference, light_of, other_light
from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.maps import ASSUMED_SCALE, BALLS, LIGHT, MOVED, REFERENCE, UNFIT, Frame, HeightMap
from tactilevision.records.measured import Array, Bools, Bytes, Floats, Pair, Picture
from tactilevision.robust import mad_std, median
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# How much of the colour change that drift does not explain comes from sloping gel around a contact?
#
#     residual_c(b) = sum_n a_n J_c(b) u(b) exp(-d(b) / L_n)
#
# d is the distance of block b from the contact, u the direction away from it, J (3, 2) the colour change per
# slope. The lengths L_n are fractions of the contact's equivalent radius and cover gels of all thicknesses. The
# three a_n are fitted to the untouched blocks by iteratively reweighted least squares. A moved lamp, daylight or a
# shift has no such pattern.
#
# Measured on an independent renderer, lamps at 13 to 30 degrees: 16 flat faces of .12 to .46 mm have 1 to 7.6
# times the usual misfit before the fit and .7 to 2.3 times after it; lamps turned by 3 degrees or more have 3.3 to
# 40 times where a face is pressed.

LENGTHS = (0.25, 0.5, 1.0)  # of the contact's radius: decay lengths of the slopes outside it
ROUNDS = 3  # of reweighting; ten change the misfit by at most .06 of it
WIDTH = 3  # deviations beyond which a block has less weight


def misfit_beside(drift: Drift, tracker: DriftTracker) -> float:
    """Return the misfit of the last `drift` measured by `tracker`, excluding gel slopes around contacts; ratio.

    Without a contact, or without balls that determine the effect of slopes, the misfit is unchanged.
    """
    usable = tracker.usable
    contact = solid(~drift.untouched & usable.reshape(drift.untouched.shape))
    answers = tracker.slope_effects
    if drift.left is None or answers.shape[1] != 2 or not contact.any():
        return drift.misfit
    patterns = np.einsum("ckb,nkb->ncb", answers, _away(contact))
    beside = usable & ~contact.ravel()
    squares = _without(drift.left, patterns, beside)
    return min(drift.misfit, float(np.sqrt(median(squares[usable]))))


def _away(contact: Bools) -> Floats:
    """Return slopes (lengths, 2, blocks) directed away from a `contact` (h, w), 1 at its rim."""
    distance = distance_px(~contact).astype(np.float64)
    down, across = np.gradient(cv2.GaussianBlur(distance, (0, 0), 1.0))
    direction = np.stack([across, down]) / np.maximum(np.hypot(across, down), TINY)
    lengths = np.array(LENGTHS) * np.sqrt(np.count_nonzero(contact) / np.pi)
    fall = np.exp(-distance / lengths[:, None, None])
    return np.asarray((direction * fall[:, None]).reshape(len(lengths), 2, -1))


def _without(left: Floats, patterns: Floats, beside: Bools) -> Floats:
    """Return squares (blocks,) of `left` (3, blocks) after fitting `patterns` (n, 3, blocks) at `beside`."""
    weights = beside.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = patterns * weights
        normal = np.einsum("ncb,mcb->nm", weighted, patterns)
        normal[np.diag_indices_from(normal)] *= 1.0 + ROUNDING  # similar patterns make the matrix singular
        shares = np.linalg.solve(normal, np.einsum("ncb,cb->n", weighted, left))
        squares = np.sum((left - np.tensordot(shares, patterns, axes=1) * beside) ** 2, axis=0)
        scale = max(1.0, float(median(squares[beside])) / MEDIAN_LENGTH**2)
        weights = beside / (1.0 + squares / (WIDTH**2 * scale)) ** 2
    return np.asarray(squares)


# Has the picture moved relative to its reference, as after a knock on the camera?
#
# Colour change is computed pixel by pixel, so a shift of 10 px produces up to a millimetre of false depth. Light
# is too smooth to separate a shift from drift; the gel's grain, dirt and marks show it:
#
#     c(d) = sum_x g_0(x) g(x + d)        g: normalised detail of 1 to 3 px of the logarithm of brightness
#
# has its peak at the shift. A contact only blurs the peak. Fixed sensor noise keeps a peak at 0, so a shift counts
# only where its peak clearly exceeds that one. The search covers REACH_PX: lattice marks repeat beyond it. A gel
# without grain gives no result.

FINE_PX = 0.8  # px: sigma of the finer blur; detail is its difference from the coarser
COARSE_PX = 3  # px: sigma of the coarser blur
EVEN_PX = 15  # px: sigma of the blur that gives the detail's local strength
DARK_GREY = 30  # sum of three channels, below which noise dominates the detail
MAX_DETAIL = 3  # of the detail's strength: limits the weight of one scratch
REACH_PX = 16  # px: the largest shift searched
# deviations of the correlation at which its peak is significant; unmoved real frames have 15 and more
SHIFT_SIGMA = 12
MIN_PEAK_RATIO = 1.5  # times the correlation at zero shift
MIN_PX = 1.5  # px: gel that is pressed sideways moves by as much, and frames differ by less from their median
SHIFT_FRAMES = 8  # maximum number of frames examined, evenly spaced


def image_shift(reference: npt.NDArray[Any], pictures: Sequence[Bytes]) -> Pair | None:
    """Return the shift (right, down) in px of most `pictures` (H, W, 3) relative to the `reference` (H, W, 3).

    None without a common or measurable shift. At most SHIFT_FRAMES evenly spaced pictures are examined.
    """
    chosen = np.unique(np.linspace(0, len(pictures) - 1, min(SHIFT_FRAMES, len(pictures))).astype(int))
    spectrum = _spectrum(reference)
    shifts = [shift for k in chosen if (shift := _shift(spectrum, pictures[k])) is not None]
    if not shifts:
        return None
    median = np.median(shifts, axis=0)
    alike = [shift for shift in shifts if np.hypot(*(shift - median)) < MIN_PX]
    if 2 * len(alike) <= len(chosen):
        return None
    x, y = np.mean(alike, axis=0)
    return float(x), float(y)


def shared_detail(reference: npt.NDArray[Any], picture: npt.NDArray[Any]) -> float:
    """Return the correlation of detail of two unmoved pictures (H, W, 3), grey, in deviations over all shifts."""
    return float(_correlation(_spectrum(reference), picture)[0, 0])


def _correlation(spectrum: npt.NDArray[np.complex128], picture: npt.NDArray[Any]) -> Floats:
    """Return the correlation (H, W) of detail at all shifts, in its deviations."""
    whole = np.fft.irfft2(spectrum.conj() * _spectrum(picture), s=picture.shape[:2])
    return np.asarray(whole / (mad_std(whole, centre=0.0) + TINY))


def _shift(spectrum: npt.NDArray[np.complex128], picture: Bytes) -> Floats | None:
    """Return the shift (2,) of one picture in px; None where it has not moved or the shift is not measurable."""
    reach = min(REACH_PX, (min(picture.shape[:2]) - 3) // 2)
    whole = np.roll(_correlation(spectrum, picture), (reach + 1, reach + 1), axis=(0, 1))
    around = whole[: 2 * reach + 3, : 2 * reach + 3]
    y, x = np.unravel_index(np.argmax(around[1:-1, 1:-1]), (2 * reach + 1, 2 * reach + 1))
    peak, unmoved = around[y + 1, x + 1], around[reach + 1, reach + 1]
    at: Floats = np.array([x + _vertex(around[y + 1, x : x + 3]), y + _vertex(around[y : y + 3, x + 1])]) - reach
    if peak < max(SHIFT_SIGMA, MIN_PEAK_RATIO * unmoved) or np.hypot(*at) < MIN_PX:
        return None
    return at


def _vertex(three: Floats) -> float:
    """Return the vertex of the parabola through three values, a pixel apart, relative to the middle one."""
    curvature = float(three[0] - 2.0 * three[1] + three[2])
    return 0.0 if curvature >= 0 else float(np.clip(0.5 * (three[0] - three[2]) / curvature, -0.5, 0.5))


def _spectrum(picture: npt.NDArray[Any]) -> npt.NDArray[np.complex128]:
    grain = _grain(picture)
    window = [np.hanning(length) for length in grain.shape]
    return np.asarray(np.fft.rfft2(grain * np.outer(*window)))


def _grain(picture: npt.NDArray[Any]) -> Picture:
    """Return the detail (H, W) of a picture, normalised to uniform strength."""
    bright = np.log(picture.sum(axis=2, dtype=np.float32) + np.float32(DARK_GREY))
    fine = cv2.GaussianBlur(bright, (0, 0), FINE_PX) - cv2.GaussianBlur(bright, (0, 0), COARSE_PX)
    strength = cv2.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), EVEN_PX)) + np.float32(1e-4)
    return np.asarray(np.clip(fine / strength, -MAX_DETAIL, MAX_DETAIL), np.float32)


# Does a picture show the scene and the light of its reference?
#
# Drift of the light is corrected (`photometric/drift.py`). The residual, in deviations of a block's noise, is
# small in most of the picture while it shows the reference's gel under the reference's lamps: its median, the
# misfit, is compared with that of the calibration's pictures. It exceeds MAX_MISFIT times that value under lateral
# daylight, after a shift of several pixels, and where a contact and its surrounding slopes fill most of the
# picture, so that no untouched gel determines the drift. Gentle slopes around a contact are subtracted first. A
# moved lamp that the drift model absorbs bends the untouched gel instead and increases the zero plane's deviation:
# the product of both may be MAX_PRODUCT times the usual. The gel's grain shows shifts from 1.5 px
# (`heightmap/reference_match.py`); this slower check runs only once.

MAX_MISFIT = 3  # times the baseline's misfit
# times the baseline's product of both: a large contact increases the zero plane's deviation, but fits
MAX_PRODUCT = 15
MIN_MISFIT = 0.8  # least usual misfit: the noise of one reading
MIN_STD_MM = 0.001  # mm: least usual deviation of the zero plane: the noise of one reading
# as for real pictures against a reference of a single JPEG
DEFAULT_BASELINE = {"misfit": 7.5, "zero_std_mm": 0.02}
FRAMES_READ = 9  # frames spread over a recording; of a video the first ones


@dataclass(frozen=True, eq=False)
class ReferenceMatch:
    """Flags the pictures of one method that differ from its reference.

    `usual` is the baseline (`misfit`, `zero_std_mm`); None: that of the method's card. `other_light`: method or
    pictures have another light or order than the reference. `shift_px` (right, down) of the pictures;
    `contact_px`: where (x, y) frames show a contact in the reference itself; `registered`: it is of another crop.
    """

    method: CalibratedMethod
    usual: Mapping[str, float] | None = None
    other_light: bool = False
    shift_px: Pair | None = None
    contact_px: Pair | None = None
    registered: bool = False

    @property
    def pressed_px(self) -> Pair | None:
        """Return where the reference, or that of the calibration, shows a contact, in px."""
        return self.contact_px or self.method.card.contact_in_reference_px

    @cached_property
    def baseline(self) -> Pair:
        """Return the usual misfit and deviation of the zero plane (mm)."""
        chosen: Mapping[str, float] = self.usual or self.method.card.baseline or DEFAULT_BASELINE
        return max(MIN_MISFIT, float(chosen["misfit"])), max(MIN_STD_MM, float(chosen["zero_std_mm"]))

    @cached_property
    def lasting(self) -> tuple[str, ...]:
        """Return the flags common to all pictures."""
        card = self.method.card
        found = {
            UNFIT: bool(unfit(card)),
            MOVED: self.shift_px is not None,
            REFERENCE: self.pressed_px is not None,
            BALLS: min(card.balls_cover or (1.0,)) <= COVERED,
            ASSUMED_SCALE: scale_is_assumed(card),
        }
        return tuple(flag for flag, there in found.items() if there)

    def with_light(self, light: npt.ArrayLike) -> tuple[ReferenceMatch, tuple[str, ...]]:
        """Check whether the method was made in another `light` (photometric/reference.py), or before sides or
        colours were
        exchanged; warn if so.
        """
        before, now = (
            np.log(np.maximum(one, 1.0)) for one in (np.asarray(light, float), light_of(self.method.reference))
        )
        if exchange := exchanged(before, now):
            return replace(self, other_light=True), (
                f"the untouched gel's pictures {exchange} against those that the method was made of: read both in "
                "the same way; depths are false",
            )
        gain_std = self.method.card.held_out_gain_std
        warning = other_light(
            light, self.method.reference, scale_error=self.method.relative_error if gain_std is None else gain_std
        )
        return replace(self, other_light=bool(warning)), warning

    def with_shift(self, pictures: Sequence[Bytes]) -> tuple[ReferenceMatch, tuple[str, ...]]:
        """Check whether rectified `pictures` have shifted; warn if so."""
        shape = self.method.reference.rgb.shape
        shift = image_shift(self.method.reference.rgb, [rgb for rgb in pictures if rgb.shape == shape])
        if shift is None:
            return replace(self, shift_px=None), ()
        x, y = shift
        return replace(self, shift_px=shift), (
            f"the frames lie ({x:+.1f}, {y:+.1f}) px (right, down) beside the untouched reference: was the camera "
            "or the gel moved since? Depths are false; take a new reference",
        )

    def with_scene(
        self, frames: Sequence[Frame], *, before: Reference | None = None
    ) -> tuple[ReferenceMatch, tuple[str, ...]]:
        """Check rectified `frames` for changes since the reference (scene_faults.py); issue a warning for each.

        `before`: the original reference, where such frames have renewed it. Frames without times are in order.
        """
        frames = sorted(frames, key=lambda frame: np.nan_to_num(frame.time_s))
        names = [frame.name for frame in frames]
        found = scene_faults((before or self.method.reference).rgb, [frame.rgb for frame in frames], names=names)
        other = self.other_light or any(fault.spoils for fault in found)
        return replace(self, other_light=other), tuple(fault.sentence for fault in found)

    def flags(self, frame: FrameChange | None, zero: ZeroPlane) -> tuple[str, ...]:
        """Return the flags of a `frame`, None without a reference, with its zero plane (records/maps.py)."""
        misfit = frame.drift.misfit if frame else 0.0
        unlike = self.other_light or self._is_unlike(misfit, zero.std_mm)
        if frame and unlike and not self.other_light:
            unlike = self._is_unlike(misfit_beside(frame.drift, self.method.change.tracker), zero.std_mm)
        return (*self.lasting, LIGHT) if unlike else self.lasting

    def _is_unlike(self, misfit: float, std_mm: float) -> bool:
        misfit, flatness = misfit / self.baseline[0], std_mm / self.baseline[1]
        return max(misfit / MAX_MISFIT, misfit * flatness / MAX_PRODUCT) > 1.0


def baseline(residuals: Callable[[Bytes], tuple[float, ...]], pictures: Sequence[Bytes]) -> dict[str, float]:
    """Return the median misfit and zero-plane deviation in mm of rectified `pictures`, presses included.

    `residuals` gives both for one picture. Unreadable pictures are excluded.
    """
    measured = []
    for rgb in pictures:
        with suppress(InputError):
            measured.append(residuals(rgb))
    if not measured:
        return DEFAULT_BASELINE
    return dict(zip(DEFAULT_BASELINE, map(float, np.median(measured, axis=0)), strict=True))


def some_frames(recording: Recording, *, count: int = FRAMES_READ) -> list[Bytes]:
    """Return the rectified pictures (H, W, 3) of `spread_frames`."""
    return [frame.rgb for frame in spread_frames(recording, count=count)]


def spread_frames(recording: Recording, *, count: int = FRAMES_READ, raw: bool = False) -> list[Frame]:
    """Return `count` named frames spread over a recording (of a video its first), rectified unless `raw`."""
    there = len(recording.frame_names)
    if recording.frames_path is None or not there:
        return []
    last = there - 1 if recording.frames_path.is_dir() else min(count, there) - 1
    return rectified_frames(recording, np.unique(np.linspace(0, last, count).astype(int)), raw=raw)


def rectified_frames(recording: Recording, indices: Iterable[int], *, raw: bool = False) -> list[Frame]:
    """Return the frames at `indices`, rectified unless `raw`, named with their press; skip unreadable ones."""
    from tactilevision.recording.pictures import read_frame

    frames = []
    for index in indices:
        with suppress(InputError):  # a torn frame is reported where the press is read
            frame = read_frame(recording, int(index))
            of = [one.press for one in recording.presses if one.start_s <= frame.time_s <= one.end_s]
            name = f"{frame.name} (press {of[0]})" if of else frame.name
            rgb = frame.rgb if raw else rectify(recording.sensor, frame.rgb)
            frames.append(Frame(rgb, frame.time_s, name))
    return frames


# Was the gel touched when its reference was taken? Every frame then shows that contact inverted, as a hill.
#
# Gel pressed in the reference and free now appears as a hill; gel that rises around a contact stays much lower
# than the contact is deep. A hill counts if it lies at one place in the median of several frames, in gel whose
# colour change no drift explains in most of them. The picture's border, where light and gel change first, is
# excluded.


MIN_FRAMES = 3  # readable frames; fewer are inconclusive
CONTACT_FRAMES = 9  # maximum number of frames read, evenly spaced
MIN_BLOCKS = 6  # of the drift's; fewer are an edge of a contact, or noise
# times the usual deviation of a picture's depths; false hills on real gel have 3 where they count
CONTACT_SIGMA = 6
MIN_MM = 0.03  # mm: the least height that counts, whatever the deviations
MIN_DENT_SHARE = 0.5  # of the deepest dent next to the hill: gel outside a contact rises by at most a fifth
PRESSED_SIGMA = 3  # deviations of depth for a dent in a candidate reference, which is then rejected
# of the hill: 49 of 54 free medians have a dent of .39 of it at most, 46 of 47 pressed ones .42 and more
MAX_RISE_SHARE = 0.4
BORDER = 2  # excluded blocks along the border of the picture


def check_reference(
    match: ReferenceMatch, height_map: Callable[[Bytes], HeightMap], *, pictures: Sequence[Bytes]
) -> tuple[ReferenceMatch, tuple[str, ...]]:
    """Warn where rectified `pictures` (H, W, 3), not shifted, show a contact in the reference; record it.

    `height_map` gives the map, in mm, of a rectified picture.
    """
    if match.shift_px is not None or match.pressed_px is not None:
        return match, ()
    contact_px = contact_in_reference(match.method, height_map, pictures=pictures)
    if contact_px is None:
        return match, ()
    x, y = contact_px
    return replace(match, contact_px=contact_px), (
        f"most frames show a hill near ({x:.0f}, {y:.0f}) px: a contact in the untouched reference, or gel that "
        "has changed since. Take a new reference",
    )


def contact_in_reference(
    method: CalibratedMethod, height_map: Callable[[Bytes], HeightMap], *, pictures: Sequence[Bytes]
) -> Pair | None:
    """Return where (x, y in px) the reference of `method` shows a contact, from rectified `pictures` (H, W, 3) of
    its run.

    None where it shows none, or where fewer than MIN_FRAMES are readable; at most CONTACT_FRAMES, evenly spaced,
    are read. A contact that most frames press again, deeper, is not detectable.
    """
    some = np.unique(np.linspace(0, len(pictures) - 1, min(CONTACT_FRAMES, len(pictures))).astype(int))
    read = [_in_blocks(method, height_map, pictures[k]) for k in some]
    maps = [one for one in read if one is not None]
    if len(maps) < MIN_FRAMES:
        return None
    depth, std = (np.median([one[k] for one in maps], axis=0) for k in (0, 1))
    often = np.mean([changed for _, _, changed in maps], axis=0) > 0.5
    least = max(MIN_MM, CONTACT_SIGMA * float(np.median(std)))
    block = method.reference.shape[1] / depth.shape[1]
    for patch in _patches(often):
        top = np.unravel_index(np.argmin(np.where(patch, depth, np.inf)), depth.shape)
        high, dent = -float(depth[top]), float(depth[patch].max())
        inside = all(BORDER <= at < size - BORDER for at, size in zip(top, depth.shape, strict=True))
        if inside and high > max(least, MIN_DENT_SHARE * dent):
            return block * (float(top[1]) + 0.5), block * (float(top[0]) + 0.5)
    return None


def pressed_beside(method: CalibratedMethod, height_map: Callable[[Bytes], HeightMap], *, picture: Bytes) -> bool:
    """Return whether rectified `picture` (H, W, 3) shows a contact outside that of the reference of `method`, 1 or
    0.

    A contact in the reference alone gives a hill, surrounded by risen gel that reads as a shallow dent. A gentler
    contact inside the reference's own is not detectable. True also where the picture is unreadable.
    """
    found = _in_blocks(method, height_map, picture)
    if found is None:
        return True
    depth, std, changed = found
    least = max(MIN_MM, PRESSED_SIGMA * float(np.median(std)))
    ends = [(float(depth[patch].max()), -float(depth[patch].min())) for patch in _patches(changed)]
    return any(dent > max(least, MAX_RISE_SHARE * hill) for dent, hill in ends)


def _in_blocks(
    method: CalibratedMethod, height_map: Callable[[Bytes], HeightMap], picture: Bytes
) -> tuple[Array, Array, Bools] | None:
    """Return depth and its deviation in mm, and the changed blocks (h, w), of a rectified picture (H, W, 3).

    None where it is unreadable.
    """
    with suppress(InputError):
        height = height_map(picture)
        if height.std_mm is not None:
            tracker = method.change.tracker
            depth, std = (block_means(field, tracker.size) for field in (height.depth_mm, height.std_mm))
            changed = ~tracker.measure(picture).untouched
            return depth, std, changed & tracker.usable.reshape(changed.shape)
    return None


def _patches(changed: Bools) -> list[Bools]:
    """Return each group of MIN_BLOCKS or more among the changed blocks (h, w)."""
    count, patches = cv2.connectedComponents(solid(changed).astype(np.uint8))
    found = [np.asarray(patches == number) for number in range(1, count)]
    return [patch for patch in found if patch.sum() >= MIN_BLOCKS]
