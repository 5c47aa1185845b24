"""Is a picture one of the scene and the light that its reference was taken of?

Drift of the light is undone (`photometric/illumination/drift.py`). What it cannot explain, in deviations of a
block's noise, is small in most of the picture as long as that shows the reference's gel under the reference's
lamps: its median, the misfit, is compared with what the calibration's own pictures had. It is MAX_MISFIT times
larger where daylight falls in from a side, where the picture has moved by several pixels, and where a contact, or
the slopes round it, fill most of the picture, so that no untouched gel tells the drift. Where gentle slopes beside
a contact make it large they are taken off (`gel_beside_contact.py`). What passes for drift and is none (a lamp was
moved) bends the untouched gel instead, so that its zero plane is known less well: the product of both may be
MAX_PRODUCT times the usual. A shift is seen from 1.5 px on by the gel's grain (`quality/image_shift.py`), which
takes longer: asked for once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.integration.zero_plane import ZeroPlane
from tactilevision.photometric.ball.consistency import COVERED
from tactilevision.photometric.illumination.drift import Drift
from tactilevision.photometric.illumination.light_match import light_of, other_light
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.photometric.reference import Reference
from tactilevision.quality.fitness import scale_is_assumed, unfit
from tactilevision.quality.gel_beside_contact import misfit_beside
from tactilevision.quality.image_shift import image_shift
from tactilevision.quality.scene_faults import exchanged, scene_faults
from tactilevision.records import Bytes, Frame, Pair
from tactilevision.records.flags import ASSUMED_SCALE, BALLS, LIGHT, MOVED, REFERENCE, UNFIT
from tactilevision.sensors import rectify

if TYPE_CHECKING:
    from tactilevision.recording import Recording

MAX_MISFIT = 3.0  # times the baseline's misfit
# times the baseline's product of both: a large contact leaves the zero plane less well known, but fits
MAX_PRODUCT = 15.0
MIN_MISFIT = 0.8  # the least misfit that is usual: one reading's own noise
MIN_STD_MM = 0.001  # mm: the least deviation of the zero plane that is usual: one reading's own noise
# as real pictures have against a reference of a single JPEG
DEFAULT_BASELINE = {"misfit": 7.5, "zero_std_mm": 0.02}
FRAMES_READ = 9  # frames spread over a recording; of a video the first ones


class ReferenceMatch:
    """Flags the pictures of one method that are unlike its reference.

    `other_light`: method or pictures are of another light or order than the reference. `shift_px` (right, down) of
    the pictures; `contact_px`, where (x, y) the reference itself, or that of the calibration, shows a contact;
    `residuals` of the last picture, in the order of DEFAULT_BASELINE.

    `baseline` is what to compare with (`misfit`, `zero_std_mm`), None: what the method's card has.
    """

    def __init__(self, method: ReferencedMethod, *, baseline: Mapping[str, float] | None = None) -> None:
        self.method = method
        chosen: Mapping[str, float] = baseline or method.card.baseline or DEFAULT_BASELINE
        self.baseline = max(MIN_MISFIT, float(chosen["misfit"])), max(MIN_STD_MM, float(chosen["zero_std_mm"]))
        self.other_light = False
        self.shift_px: Pair | None = None
        self.contact_px: Pair | None = method.card.contact_in_reference_px
        self.unfit = bool(unfit(method.card))
        self.assumed_scale = scale_is_assumed(method.card)
        self.residuals: tuple[float, ...] = ()

    def check_light(self, light: npt.ArrayLike) -> tuple[str, ...]:
        """See whether the method was made in another `light` (`illumination/light_match.py`), or for pictures
        whose sides or colours were exchanged since; a warning where it was.
        """
        before, now = (
            np.log(np.maximum(one, 1.0)) for one in (np.asarray(light, float), light_of(self.method.reference))
        )
        if exchange := exchanged(before, now):
            self.other_light = True
            return (
                f"the untouched gel's pictures {exchange} against those that the method was made of: read both in "
                "the same way; depths are false",
            )
        gain_std = self.method.card.held_out_gain_std
        warning = other_light(
            light, self.method.reference, scale_error=self.method.relative_error if gain_std is None else gain_std
        )
        self.other_light = bool(warning)
        return warning

    def check_shift(self, pictures: Sequence[Bytes]) -> tuple[str, ...]:
        """See by rectified `pictures` whether they have moved; a warning where they have."""
        shape = self.method.reference.rgb.shape
        self.shift_px = image_shift(self.method.reference.rgb, [rgb for rgb in pictures if rgb.shape == shape])
        if self.shift_px is None:
            return ()
        x, y = self.shift_px
        return (
            f"the frames lie ({x:+.1f}, {y:+.1f}) px (right, down) beside the untouched reference: was the camera "
            "or the gel moved since? Depths are false; take a new reference",
        )

    def check_scene(self, frames: Sequence[Frame], *, before: Reference | None = None) -> tuple[str, ...]:
        """See by rectified `frames` what happened since the reference (scene_faults.py); a warning for each.

        `before`: the reference as it was taken, where such frames have renewed it. Frames without times are in
        order.
        """
        frames = sorted(frames, key=lambda frame: np.nan_to_num(frame.time_s))
        names = [frame.name for frame in frames]
        found = scene_faults((before or self.method.reference).rgb, [frame.rgb for frame in frames], names=names)
        self.other_light |= any(fault.spoils for fault in found)
        return tuple(fault.sentence for fault in found)

    def flags(self, drift: Drift | None, zero: ZeroPlane) -> tuple[str, ...]:
        """What makes a frame of this `drift` and zero plane doubtful (flags.py)."""
        lasting = [UNFIT] if self.unfit else []
        lasting += [flag for flag, px in ((MOVED, self.shift_px), (REFERENCE, self.contact_px)) if px is not None]
        if min(self.method.card.balls_cover or (1.0,)) <= COVERED:
            lasting.append(BALLS)
        if self.assumed_scale:
            lasting.append(ASSUMED_SCALE)
        self.residuals = (drift.misfit if drift is not None else 0.0, zero.std_mm)
        unlike = self.other_light or self._is_unlike(*self.residuals)
        if drift is not None and unlike and not self.other_light:
            unlike = self._is_unlike(misfit_beside(drift, self.method.change.tracker), zero.std_mm)
        return (*lasting, LIGHT) if unlike else tuple(lasting)

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
    from tactilevision.recording import read_frame

    frames = []
    for index in indices:
        with suppress(InputError):  # a torn frame is reported where the press is read
            frame = read_frame(recording, int(index))
            of = [one.press for one in recording.presses if one.start_s <= frame.time_s <= one.end_s]
            name = f"{frame.name} (press {of[0]})" if of else frame.name
            frames.append(Frame(rectify(recording.sensor, frame.rgb), frame.time_s, name))
    return frames
