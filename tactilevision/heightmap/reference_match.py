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
from tactilevision.photometric.drift import MEDIAN_LENGTH, Drift, DriftTracker, solid
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.photometric.reference import Reference, light_of, other_light
from tactilevision.photometric.windows import distance_px
from tactilevision.records.maps import ASSUMED_SCALE, BALLS, LIGHT, MOVED, REFERENCE, UNFIT, Frame, HeightMap
from tactilevision.records.measured import Bools, Bytes, Floats, Pair
from tactilevision.robust import mad_std, median
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# How much of what no drift explains is gel that slopes beside a contact?
#
#     left_c(b) = sum_n a_n J_c(b) u(b) exp(-d(b) / L_n)
#
# d is a block's distance from the contact, u the direction away from it, J (3, 2) what a slope makes of colours.
# The lengths L_n are parts of the contact's radius, that of a circle of its area; they are spread so widely that
# gels of all thicknesses lie between them. The three a_n are fitted to the untouched blocks by iteratively
# reweighted least squares. A lamp that was moved, daylight or a shift have no such pattern about the contact, and
# nothing has one where there is no contact.
#
# Measured on a renderer that shares no code with the library, lamps at 13 to 30 degrees: 16 flat faces of .12 to
# .46 mm leave 1 to 7.6 times the usual misfit as they are, .7 to 2.3 times without their slopes; lamps turned by 3
# degrees or more leave 3.3 to 40 times where a face is pressed.

LENGTHS = (0.25, 0.5, 1.0)  # of the contact's radius, over which slopes beside it die out
ROUNDS = 3  # of reweighting; ten move the misfit by at most .06 of it
WIDTH = 3.0  # deviations from which a block counts less


def misfit_beside(drift: Drift, tracker: DriftTracker) -> float:
    """The misfit of a `drift` that `tracker` measured last, without the gel's slopes beside contacts; no unit.

    As it is where there is no contact, and where no ball has told what slopes do.
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
    """Slopes (lengths, 2, blocks) away from a `contact` (h, w), 1 at its rim."""
    distance = distance_px(~contact).astype(np.float64)
    down, across = np.gradient(cv2.GaussianBlur(distance, (0, 0), 1.0))
    direction = np.stack([across, down]) / np.maximum(np.hypot(across, down), 1e-9)
    lengths = np.array(LENGTHS) * np.sqrt(np.count_nonzero(contact) / np.pi)
    fall = np.exp(-distance / lengths[:, None, None])
    return np.asarray((direction * fall[:, None]).reshape(len(lengths), 2, -1))


def _without(left: Floats, patterns: Floats, beside: Bools) -> Floats:
    """Squares (blocks,) of what is `left` (3, blocks) without `patterns` (n, 3, blocks), fitted `beside`."""
    weights = beside.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = patterns * weights
        normal = np.einsum("ncb,mcb->nm", weighted, patterns)
        normal[np.diag_indices_from(normal)] *= 1.0 + 1e-9  # patterns that are alike leave it singular
        shares = np.linalg.solve(normal, np.einsum("ncb,cb->n", weighted, left))
        squares = np.sum((left - np.tensordot(shares, patterns, axes=1) * beside) ** 2, axis=0)
        scale = max(1.0, float(median(squares[beside])) / MEDIAN_LENGTH**2)
        weights = beside / (1.0 + squares / (WIDTH**2 * scale)) ** 2
    return np.asarray(squares)


# Has the picture moved against its reference? A camera that was knocked, a sensor that was opened.
#
# Colour change is counted pixel by pixel, so a picture that lies 10 px beside its reference shows up to a
# millimetre of depth that is not there. Light is too smooth to tell a shift from drift; the gel's grain, dirt and
# marks tell it:
#
#     c(d) = sum_x g_0(x) g(x + d)        g: detail of 1 to 3 px of the logarithm of brightness, of even strength
#
# has its peak where the picture lies. A contact carries little of the gel with it and blurs the peak, no more.
# Noise on the chip stays in its place and keeps a peak at 0, so a shift counts where its peak stands clearly above
# that one. Shifts of up to REACH_PX are looked for: marks on a lattice look alike farther on. A gel without grain
# tells nothing.

FINE_PX = 0.8  # px: sigma of the finer blur; detail is its difference from the coarser
COARSE_PX = 3.0  # px: sigma of the coarser blur
EVEN_PX = 15.0  # px: sigma of the blur over which the strength of detail is taken
DARK_GREY = 30.0  # of three channels together, below which noise would be most of the detail
MAX_DETAIL = 3.0  # of the detail's strength: one scratch is not all there is to see
REACH_PX = 16  # px: the largest shift that is looked for
# deviations of the correlation by which its peak stands out; unmoved real frames have 15 and more
SHIFT_SIGMA = 12.0
MIN_PEAK_RATIO = 1.5  # times the correlation of a picture that has not moved
MIN_PX = 1.5  # gel that is pressed sideways moves by as much
ALIKE_PX = 1.5  # px from the middle shift, within which shifts count as alike
SHIFT_FRAMES = 8  # frames that are looked at, at most, spread evenly

Single = npt.NDArray[np.float32]


def image_shift(reference: npt.NDArray[Any], pictures: Sequence[Bytes]) -> Pair | None:
    """Shift (right, down) in px by which most `pictures` (H, W, 3) lie beside the `reference` (H, W, 3).

    None where they do not, or where it cannot be seen. At most MAX_FRAMES of them are looked at, spread evenly.
    """
    chosen = np.unique(np.linspace(0, len(pictures) - 1, min(SHIFT_FRAMES, len(pictures))).astype(int))
    spectrum = _spectrum(reference)
    shifts = [shift for k in chosen if (shift := _shift(spectrum, pictures[k])) is not None]
    if not shifts:
        return None
    median = np.median(shifts, axis=0)
    alike = [shift for shift in shifts if np.hypot(*(shift - median)) < ALIKE_PX]
    if 2 * len(alike) <= len(chosen):
        return None
    x, y = np.mean(alike, axis=0)
    return float(x), float(y)


def _shift(spectrum: npt.NDArray[np.complex128], picture: Bytes) -> Floats | None:
    """By how much (2,) one picture has moved; None where it has not, or where it cannot be seen."""
    shape = picture.shape[:2]
    whole = np.fft.irfft2(spectrum.conj() * _spectrum(picture), s=shape)
    noise = mad_std(whole, centre=0.0) + 1e-12
    reach = min(REACH_PX, (min(shape) - 3) // 2)
    around = np.roll(whole, (reach + 1, reach + 1), axis=(0, 1))[: 2 * reach + 3, : 2 * reach + 3] / noise
    y, x = np.unravel_index(np.argmax(around[1:-1, 1:-1]), (2 * reach + 1, 2 * reach + 1))
    peak, unmoved = around[y + 1, x + 1], around[reach + 1, reach + 1]
    at: Floats = np.array([x + _vertex(around[y + 1, x : x + 3]), y + _vertex(around[y : y + 3, x + 1])]) - reach
    if peak < max(SHIFT_SIGMA, MIN_PEAK_RATIO * unmoved) or np.hypot(*at) < MIN_PX:
        return None
    return at


def _vertex(three: Floats) -> float:
    """Where the parabola through three values, a pixel apart, has its top, from the middle one."""
    curvature = float(three[0] - 2.0 * three[1] + three[2])
    return 0.0 if curvature >= 0 else float(np.clip(0.5 * (three[0] - three[2]) / curvature, -0.5, 0.5))


def _spectrum(picture: npt.NDArray[Any]) -> npt.NDArray[np.complex128]:
    grain = _grain(picture)
    window = [np.hanning(length) for length in grain.shape]
    return np.asarray(np.fft.rfft2(grain * np.outer(*window)))


def _grain(picture: npt.NDArray[Any]) -> Single:
    """Detail (H, W) of a picture, of about the same strength all over it."""
    bright = np.log(picture.sum(axis=2, dtype=np.float32) + np.float32(DARK_GREY))
    fine = cv2.GaussianBlur(bright, (0, 0), FINE_PX) - cv2.GaussianBlur(bright, (0, 0), COARSE_PX)
    strength = cv2.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), EVEN_PX)) + np.float32(1e-4)
    return np.asarray(np.clip(fine / strength, -MAX_DETAIL, MAX_DETAIL), np.float32)


# Is a picture one of the scene and the light that its reference was taken of?
#
# Drift of the light is undone (`photometric/drift.py`). What it cannot explain, in deviations of a block's noise,
# is small in most of the picture as long as that shows the reference's gel under the reference's lamps: its
# median, the misfit, is compared with what the calibration's own pictures had. It is MAX_MISFIT times larger where
# daylight falls in from a side, where the picture has moved by several pixels, and where a contact, or the slopes
# round it, fill most of the picture, so that no untouched gel tells the drift. Where gentle slopes beside a
# contact make it large they are taken off. What passes for drift and is none (a lamp was
# moved) bends the untouched gel instead, so that its zero plane is known less well: the product of both may be
# MAX_PRODUCT times the usual. A shift is seen from 1.5 px on by the gel's grain (`heightmap/reference_match.py`),
# which takes longer: asked for once.

MAX_MISFIT = 3.0  # times the baseline's misfit
# times the baseline's product of both: a large contact leaves the zero plane less well known, but fits
MAX_PRODUCT = 15.0
MIN_MISFIT = 0.8  # the least misfit that is usual: one reading's own noise
MIN_STD_MM = 0.001  # mm: the least deviation of the zero plane that is usual: one reading's own noise
# as real pictures have against a reference of a single JPEG
DEFAULT_BASELINE = {"misfit": 7.5, "zero_std_mm": 0.02}
FRAMES_READ = 9  # frames spread over a recording; of a video the first ones


@dataclass(frozen=True, eq=False)
class ReferenceMatch:
    """Flags the pictures of one method that are unlike its reference.

    `usual` is what to compare with (`misfit`, `zero_std_mm`), None: what the method's card has. `other_light`:
    method or pictures are of another light or order than the reference. `shift_px` (right, down) of the pictures;
    `contact_px`, where (x, y) frames show a contact in the reference itself.
    """

    method: ReferencedMethod
    usual: Mapping[str, float] | None = None
    other_light: bool = False
    shift_px: Pair | None = None
    contact_px: Pair | None = None

    @property
    def pressed_px(self) -> Pair | None:
        """Where the reference, or that of the calibration, shows a contact."""
        return self.contact_px or self.method.card.contact_in_reference_px

    @cached_property
    def baseline(self) -> Pair:
        """Misfit and deviation of the zero plane (mm) that are usual."""
        chosen: Mapping[str, float] = self.usual or self.method.card.baseline or DEFAULT_BASELINE
        return max(MIN_MISFIT, float(chosen["misfit"])), max(MIN_STD_MM, float(chosen["zero_std_mm"]))

    @cached_property
    def lasting(self) -> tuple[str, ...]:
        """Flags of every picture."""
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
        """See whether the method was made in another `light` (photometric/reference.py), or for pictures whose
        sides or colours were exchanged since; a warning where it was.
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
        """See by rectified `pictures` whether they have moved; a warning where they have."""
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
        """See by rectified `frames` what happened since the reference (scene_faults.py); a warning for each.

        `before`: the reference as it was taken, where such frames have renewed it. Frames without times are in
        order.
        """
        frames = sorted(frames, key=lambda frame: np.nan_to_num(frame.time_s))
        names = [frame.name for frame in frames]
        found = scene_faults((before or self.method.reference).rgb, [frame.rgb for frame in frames], names=names)
        other = self.other_light or any(fault.spoils for fault in found)
        return replace(self, other_light=other), tuple(fault.sentence for fault in found)

    def flags(self, drift: Drift | None, zero: ZeroPlane) -> tuple[str, ...]:
        """What makes a frame of this `drift` and zero plane doubtful (records/maps.py)."""
        misfit = drift.misfit if drift is not None else 0.0
        unlike = self.other_light or self._is_unlike(misfit, zero.std_mm)
        if drift is not None and unlike and not self.other_light:
            unlike = self._is_unlike(misfit_beside(drift, self.method.change.tracker), zero.std_mm)
        return (*self.lasting, LIGHT) if unlike else self.lasting

    def _is_unlike(self, misfit: float, std_mm: float) -> bool:
        misfit, flatness = misfit / self.baseline[0], std_mm / self.baseline[1]
        return max(misfit / MAX_MISFIT, misfit * flatness / MAX_PRODUCT) > 1.0


def baseline(residuals: Callable[[Bytes], tuple[float, ...]], pictures: Sequence[Bytes]) -> dict[str, float]:
    """The median misfit, and deviation of the zero plane in mm, of rectified `pictures`, presses among them.

    `residuals` gives both for one picture. Those that cannot be read do not count.
    """
    measured = []
    for rgb in pictures:
        with suppress(InputError):
            measured.append(residuals(rgb))
    if not measured:
        return DEFAULT_BASELINE
    return dict(zip(DEFAULT_BASELINE, map(float, np.median(measured, axis=0)), strict=True))


def some_frames(recording: Recording, *, count: int = FRAMES_READ) -> list[Bytes]:
    """The rectified pictures (H, W, 3) of `spread_frames`."""
    return [frame.rgb for frame in spread_frames(recording, count=count)]


def spread_frames(recording: Recording, *, count: int = FRAMES_READ) -> list[Frame]:
    """`count` rectified frames spread over a recording, of a video its first, named as `rectified_frames` does."""
    there = len(recording.frame_names)
    if recording.frames_path is None or not there:
        return []
    last = there - 1 if recording.frames_path.is_dir() else min(count, there) - 1
    return rectified_frames(recording, np.unique(np.linspace(0, last, count).astype(int)))


def rectified_frames(recording: Recording, indices: Iterable[int]) -> list[Frame]:
    """The rectified frames at `indices`, named with their press; torn ones are passed over."""
    from tactilevision.recording.pictures import read_frame

    frames = []
    for index in indices:
        with suppress(InputError):  # a torn frame is reported where the press is read
            frame = read_frame(recording, int(index))
            of = [one.press for one in recording.presses if one.start_s <= frame.time_s <= one.end_s]
            name = f"{frame.name} (press {of[0]})" if of else frame.name
            frames.append(Frame(rectify(recording.sensor, frame.rgb), frame.time_s, name))
    return frames


# Was the gel touched when its reference was taken? Every frame then shows that contact the wrong way round.
#
# Colours count from the reference, so gel that was pressed there and is free now comes out as a hill. Nothing
# makes one but that: gel that rises beside a contact stands much lower than the contact is deep. So hills count
# which lie at one place in the middle one of several frames, in gel that follows no drift of the light in most of
# them. At the picture's border, where light and gel change first, a hill tells nothing.

Array = npt.NDArray[np.floating[Any]]

MIN_FRAMES = 3  # frames that can be read; fewer show nothing
CONTACT_FRAMES = 9  # frames that are read, at most, spread evenly
MIN_BLOCKS = 6  # of the drift's; fewer are an edge of a contact, or noise
# times the usual deviation of a picture's depths; false hills on real gel have 3 where they count
CONTACT_SIGMA = 6.0
MIN_MM = 0.03  # mm: the least height that counts, however small the deviations
MIN_DENT_SHARE = 0.5  # of the deepest dent that touches the hill: gel beside a contact rises by a fifth and less
PRESSED_SIGMA = 3.0  # deviations of depth, for a dent in what may become the reference: in doubt it does not
# of the hill: 49 of 54 free medians have a dent of .39 of it at most, 46 of 47 pressed ones .42 and more
MAX_RISE_SHARE = 0.4
BORDER = 2  # blocks along the border of the picture, which do not count


def check_reference(
    match: ReferenceMatch, height_map: Callable[[Bytes], HeightMap], *, pictures: Sequence[Bytes]
) -> tuple[ReferenceMatch, tuple[str, ...]]:
    """A warning where rectified `pictures` (H, W, 3), not shifted, show a contact in the reference; it is noted.

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
    method: ReferencedMethod, height_map: Callable[[Bytes], HeightMap], *, pictures: Sequence[Bytes]
) -> Pair | None:
    """Where (x, y in px) the reference of `method` shows a contact, by rectified `pictures` (H, W, 3) of its run.

    None where it shows none, and where fewer than MIN_FRAMES can be read; MAX_FRAMES, spread evenly, are read.
    A contact that most frames press again, deeper, cannot be seen.
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


def pressed_beside(method: ReferencedMethod, height_map: Callable[[Bytes], HeightMap], *, picture: Bytes) -> bool:
    """Whether rectified `picture` (H, W, 3) shows a contact beside that of the reference of `method`.

    Where the reference alone is pressed a hill is left, and gel beside it that rose and reads as a shallow dent.
    A gentler contact inside the reference's own cannot be seen. True as well where the picture cannot be read.
    """
    found = _in_blocks(method, height_map, picture)
    if found is None:
        return True
    depth, std, changed = found
    least = max(MIN_MM, PRESSED_SIGMA * float(np.median(std)))
    ends = [(float(depth[patch].max()), -float(depth[patch].min())) for patch in _patches(changed)]
    return any(dent > max(least, MAX_RISE_SHARE * hill) for dent, hill in ends)


def _in_blocks(
    method: ReferencedMethod, height_map: Callable[[Bytes], HeightMap], picture: Bytes
) -> tuple[Array, Array, Bools] | None:
    """Depth and its deviation in mm, and what has changed, in blocks (h, w) of a rectified picture (H, W, 3).

    None where it cannot be read.
    """
    with suppress(InputError):
        height = height_map(picture)
        if height.std_mm is not None:
            tracker = method.change.tracker
            depth, std = (
                cv2.resize(np.asarray(a, np.float32), tracker.size, interpolation=cv2.INTER_AREA)
                for a in (height.depth_mm, height.std_mm)
            )
            changed = ~tracker.measure(picture).untouched
            return depth, std, changed & tracker.usable.reshape(changed.shape)
    return None


def _patches(changed: Bools) -> list[Bools]:
    """Each group of MIN_BLOCKS or more of blocks (h, w) that changed."""
    count, patches = cv2.connectedComponents(solid(changed).astype(np.uint8))
    found = [np.asarray(patches == number) for number in range(1, count)]
    return [patch for patch in found if patch.sum() >= MIN_BLOCKS]
