"""A height map without cast shadows: the light that lamps lost on their way is given back, and the map made anew.

    depth <- map(picture / dimming(depth)),    damped, until it moves no more

The forecast of shadows (`photometric/illumination/cast_shadow.py`) needs the depth that it mends. Heights read in
shadow are too high beside the wall, so the first forecast is too short and the face too deep; half steps from one
map to the next settle where whole ones swing. What was given back is known to a share of itself, which the
deviation holds.

Assumes three near lamps found from balls. What it does to faces and the gel beside is measured on pictures of a
path tracer in docs/evidence/rendered.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.illumination.cast_shadow import LightField, dimming, shadow_share
from tactilevision.records import Bools, Bytes

if TYPE_CHECKING:
    from tactilevision.reconstruct.reconstructor import Reconstructor
    from tactilevision.recording import Recording

Mapped = tuple[npt.NDArray[np.floating[Any]], Bools, npt.NDArray[np.floating[Any]] | None, tuple[str, ...]]

MIN_DEPTH_MM = 0.08  # mm: gentler contacts cast no shadow that matters
STEP = 0.5  # of the way from one depth to the next: whole steps swing beyond .3 mm
MAX_ROUNDS = 10  # maps of one frame: what moves then moves by less than its deviation
SETTLED_MM = 0.003  # mm, the most that 99 % of pixels move between rounds that end it
GIVEN_BACK_STD = 0.35  # of what the map changed by: rms on three sensors of the path tracer
# of lamps beside walls (steep_edges.py): the dark side of a wall is brightened along with the gel at its foot, so
# that less is missing there; fitted to faces of two sensors of the family `train`
UNDONE_LEAN = 1.3
BRIGHTEST = 250  # grey levels that a pixel is given at most, lest it count as saturated
FRAMES_READ = 15  # frames of a recording that are looked at: presses are a good part of most
FRAMES_TRIED = 4  # the deepest of these, whose shadows are undone to see whether there are any
SEEN_SHARE = (
    0.2  # of the forecast shadow: four sensors showed .31 to 1.26 (one frame .15), without shadows -.01 to .08
)

SAID = (
    "the frames show cast shadows: they are undone by the lamps' places, which the balls tell; a deep frame takes "
    "half a second (--no-shadows leaves them)"
)


def undo_shadows(
    mapped: Callable[[Bytes], Mapped], rgb: Bytes, field: LightField
) -> tuple[Mapped, npt.NDArray[np.floating[Any]] | None]:
    """Depth (H, W) mm, validity, deviation and flags of a rectified picture (H, W, 3), shadows undone.

    `mapped` gives them for a picture as it is. And the part (H, W) mm of the deviation that the shadows bring,
    None for contacts too gentle to cast any.
    """
    surface, valid, std, flags = mapped(rgb)
    if surface.max() < MIN_DEPTH_MM:
        return (surface, valid, std, flags), None
    plain, depth = surface.copy(), surface.copy()
    for _ in range(MAX_ROUNDS):
        surface, valid, std, flags = mapped(_brightened(rgb, dimming(field, depth)))
        moved = STEP * (surface - depth)
        depth += moved
        if np.percentile(np.abs(moved), 99) < SETTLED_MM:
            break
    given_back = GIVEN_BACK_STD * np.abs(surface - plain)
    if std is not None:
        std = np.hypot(std, given_back).astype(std.dtype)
    return (surface, valid, std, flags), given_back


def _brightened(rgb: Bytes, factor: npt.NDArray[np.float32]) -> Bytes:
    return np.maximum(rgb, np.minimum(np.rint(rgb / factor), BRIGHTEST).astype(np.uint8))


def with_shadows(
    recording: Recording, reader: Reconstructor, *, frames: Sequence[Bytes] | None = None
) -> Reconstructor:
    """The reader itself, which from now on undoes cast shadows where `frames` (H, W, 3), rectified, show them.

    None: FRAMES_READ of the recording's. Needs its balls, which tell the lamps; without them, or without shadows,
    the reader stays as it is.
    """
    from tactilevision.quality.reference_match import some_frames
    from tactilevision.reconstruct.lamps import find_lamps

    method = reader.referenced
    frames = some_frames(recording, count=FRAMES_READ) if frames is None else frames
    if method is None or not recording.balls:
        return reader
    peaks = [float(reader.rectified_map(rgb).depth_mm.max()) for rgb in frames]
    deepest = [frames[k] for k in np.argsort(peaks)[::-1][:FRAMES_TRIED] if peaks[k] > MIN_DEPTH_MM]
    lamps = find_lamps(recording, reader) if deepest else None
    if lamps is None:
        return reader
    height, width = method.reference.shape
    field, usual = LightField.of(lamps, (height, width), reader.sensor.mm_per_px), reader.lean
    reader.shadows, reader.lean = field, UNDONE_LEAN
    shares = [
        shadow_share(field, rgb, reference=method.reference.rgb, depth_mm=reader.rectified_map(rgb).depth_mm)
        for rgb in deepest
    ]
    known = [share for share in shares if np.isfinite(share)]
    if known and np.median(known) > SEEN_SHARE:
        reader.warnings += (SAID,)
    else:
        reader.shadows, reader.lean = None, usual
    return reader
