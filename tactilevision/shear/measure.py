"""Two frames -> tangential displacement of the gel's surface, with its standard deviation."""

from __future__ import annotations

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records import Bytes, Floats, Pair, ShearMap
from tactilevision.shear.markers import (
    FEWEST,
    MarkerMotion,
    are_markers,
    find_markers,
    follow_markers,
    hull,
    spread_motion,
)
from tactilevision.shear.texture import CORRELATION_PX, follow_texture

STEP_PX = 4
LOST = "markers lost"


def measure_shear(reference: Bytes, frame: Bytes, mm_per_px: Pair, *, markers: bool | None = None) -> ShearMap:
    """Displacement since `reference` (the untouched gel), both rectified (H, W, 3), at places of `reference`.

    `markers` True or False says whether the gel carries marks; None: looked for. Without marks the texture
    of the ink is followed. Where more than a tenth of the markers are not found again the map is flagged.
    Raises InputError for frames that do not match, and where markers are promised but too few are found.
    """
    if reference.shape != frame.shape or reference.ndim != 3:
        raise InputError("the two frames are of one size, (H, W, 3)", where="measure_shear",
                         value=(reference.shape, frame.shape))  # fmt: skip
    places = find_markers(reference) if markers is not False else np.zeros((0, 2))
    if markers or (markers is None and are_markers(places)):
        return _by_markers(places, frame, mm_per_px)
    motion, std_px, valid = follow_texture(reference, frame)
    scale = np.array(mm_per_px)
    return ShearMap(
        u_x_mm=motion[..., 0] * scale[0],
        u_y_mm=motion[..., 1] * scale[1],
        valid=valid,
        mm_per_px=mm_per_px,
        std_mm=std_px * float(scale.mean()),
        correlation_px=CORRELATION_PX,
    )


def marker_motion(reference: Bytes, frame: Bytes, guess_px: Floats | None = None) -> MarkerMotion:
    """The markers of `reference` and how each moved, for drawing and for following from frame to frame."""
    return follow_markers(find_markers(reference), find_markers(frame), guess_px)


def _by_markers(places: Floats, frame: Bytes, mm_per_px: Pair) -> ShearMap:
    if len(places) < FEWEST:
        raise InputError("too few markers in the reference frame to follow the gel", where="measure_shear",
                         value=len(places), remedy="Say markers=False to follow the ink's texture.")  # fmt: skip
    motion = follow_markers(places, find_markers(frame))
    shape = (frame.shape[0], frame.shape[1])
    found = int(motion.found.sum())
    flags = (f"{LOST}: {len(places) - found} of {len(places)}",) if found < 0.9 * len(places) else ()
    if found < FEWEST:
        nothing = np.zeros(shape)
        return ShearMap(nothing, nothing, np.zeros(shape, dtype=bool), mm_per_px, flags=flags)
    dense, std_px = spread_motion(motion, shape, STEP_PX)
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
