"""Two frames -> tangential displacement of the gel's surface, with its standard deviation.

What the untouched frame says is read once; then each frame is held against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.markers import MIN_COUNT, evenly_spaced
from tactilevision.records import Bytes, Floats, Pair, ShearMap
from tactilevision.shear.markers import MarkerMotion, find_markers, follow_markers, hull, spread_motion
from tactilevision.shear.texture import MIN_KNOWN, Texture, follow_texture, read_texture

STEP_PX = 4  # px: grid on which motion is spread; markers lie much farther apart
LOST = "markers lost"
NOTHING_TO_FOLLOW = "the gel shows neither markers nor texture to follow"


@dataclass(frozen=True, slots=True)
class Untouched:
    """The untouched gel, ready to be compared with: its `markers` (N, 2) in pixels, its `texture`, or neither."""

    shape: tuple[int, int]
    mm_per_px: Pair
    markers: Floats | None = None
    texture: Texture | None = None

    @property
    def shows(self) -> bool:
        """Whether there is anything to follow."""
        return self.markers is not None or self.texture is not None

    def shear(self, frame: Bytes) -> ShearMap:
        """Displacement since then of what a rectified frame (H, W, 3) shows, at places of the untouched one.

        Without anything to follow no pixel is valid, and a flag says so. Where more than a tenth of the markers
        are not found again the map is flagged. Raises InputError for a frame of another size.
        """
        if frame.shape != (*self.shape, 3):
            raise InputError(
                "the two frames are of one size, (H, W, 3)", where="measure_shear", value=(self.shape, frame.shape)
            )
        if self.markers is not None:
            return _by_markers(self.markers, frame, self.mm_per_px)
        if self.texture is None:
            return _nothing(self.shape, self.mm_per_px, (NOTHING_TO_FOLLOW,))
        followed = follow_texture(self.texture, frame)
        if followed is None:
            return _nothing(self.shape, self.mm_per_px, (NOTHING_TO_FOLLOW,))
        motion, std_px, valid = followed
        scale = np.array(self.mm_per_px)
        return ShearMap(
            u_x_mm=motion[..., 0] * scale[0],
            u_y_mm=motion[..., 1] * scale[1],
            valid=valid,
            mm_per_px=self.mm_per_px,
            std_mm=std_px * float(scale.mean()),
            correlation_px=np.inf,  # light that a contact bends deceives all of it alike
        )


def read_untouched(reference: Bytes, mm_per_px: Pair, *, markers: bool | None = None) -> Untouched:
    """Read a rectified frame (H, W, 3) of the untouched gel.

    `markers` True or False says whether the gel carries marks; None: looked for. Without marks the texture of the
    ink is followed, where it stands out of the noise over half of the view. Raises InputError where markers are
    promised but too few are found.
    """
    if reference.ndim != 3 or reference.shape[2] != 3:
        raise InputError("a frame is (H, W, 3)", where="read_untouched", value=reference.shape)
    shape = (reference.shape[0], reference.shape[1])
    places = find_markers(reference) if markers is not False else np.zeros((0, 2))
    if markers and len(places) < MIN_COUNT:
        raise InputError(
            "too few markers in the reference frame to follow the gel",
            where="read_untouched",
            value=len(places),
            remedy="Say markers=False to follow the ink's texture.",
        )
    if markers or (markers is None and evenly_spaced(places)):
        return Untouched(shape, mm_per_px, markers=places)
    texture = read_texture(reference)
    return Untouched(shape, mm_per_px, texture=texture if texture.known.mean() >= MIN_KNOWN else None)


def measure_shear(reference: Bytes, frame: Bytes, mm_per_px: Pair, *, markers: bool | None = None) -> ShearMap:
    """Displacement of `frame` since `reference`, once; for many frames keep what `read_untouched` gives."""
    return read_untouched(reference, mm_per_px, markers=markers).shear(frame)


def marker_motion(reference: Bytes, frame: Bytes, *, guess_px: Floats | None = None) -> MarkerMotion:
    """The markers of `reference` (H, W, 3) and how each moved, in px, for drawing and following."""
    return follow_markers(find_markers(reference), find_markers(frame), guess_px=guess_px)


def _by_markers(places: Floats, frame: Bytes, mm_per_px: Pair) -> ShearMap:
    motion = follow_markers(places, find_markers(frame))
    shape = (frame.shape[0], frame.shape[1])
    found = int(motion.found.sum())
    flags = (f"{LOST}: {len(places) - found} of {len(places)}",) if found < 0.9 * len(places) else ()
    if found < MIN_COUNT:
        return _nothing(shape, mm_per_px, flags)
    dense, std_px = spread_motion(motion, shape, step_px=STEP_PX)
    spacing = float(np.sqrt(np.prod(np.ptp(places, axis=0)) / len(places)))
    return ShearMap(
        u_x_mm=dense[..., 0] * mm_per_px[0],
        u_y_mm=dense[..., 1] * mm_per_px[1],
        valid=hull(places[motion.found], shape),
        mm_per_px=mm_per_px,
        std_mm=std_px * float(np.mean(mm_per_px)),
        correlation_px=spacing,
        flags=flags,
    )


def _nothing(shape: tuple[int, int], mm_per_px: Pair, flags: tuple[str, ...]) -> ShearMap:
    unknown = np.zeros(shape)
    return ShearMap(unknown, unknown, np.zeros(shape, dtype=bool), mm_per_px, flags=flags)
