"""Decide whether the frames of a recording show cast shadows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.lamps import find_lamps
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import some_frames
from tactilevision.heightmap.unshadowed import MIN_DEPTH_MM
from tactilevision.heightmap.walls import LEAN
from tactilevision.photometric.illumination.cast_shadow import LightField, shadow_share
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.recording.model import Recording
from tactilevision.records.maps import MEANING, UNKNOWN_LAMPS
from tactilevision.records.measured import Bytes

FRAMES_READ = 60  # frames of a recording that are looked at: of 15 the deepest of ten presses were missed
FRAMES_TRIED = 4  # the deepest of these, whose shadows are undone to see whether there are any
SEEN_SHARE = 0.2  # of the forecast shadow: ten sensors showed .21 to 1.26, nine without shadows -.17 to .12
# of lamps beside walls (steep_edges.py): the dark side of a wall is brightened along with the gel at its foot, so
# that less is missing there; fitted to faces of two sensors of the family `train`
UNDONE_LEAN = 1.6
# of a face's depth: with it one deviation holds 71 %, two 99 % of 40 faces of five sensors that lack a lamp
UNKNOWN_LAMPS_STD = 0.1
DOUBTED = f"{UNKNOWN_LAMPS}: {MEANING[UNKNOWN_LAMPS]}"
SAID = (
    "the frames show cast shadows: they are undone by the lamps' places, which the balls tell; a deep frame takes "
    "up to a second (--no-shadows leaves them)"
)


def with_shadows(
    recording: Recording, reader: Reconstructor, *, frames: Sequence[Bytes] | None = None
) -> Reconstructor:
    """The reader itself, which from now on undoes cast shadows where `frames` (H, W, 3), rectified, show them.

    None: FRAMES_READ of the recording's. Needs its balls or a method's file that knows the lamps; without them, or
    without shadows, the reader stays as it is.
    """
    share = share_seen(recording, reader, frames=frames)
    if share is not None and share > SEEN_SHARE:  # no share (NaN) is no shadow
        reader.warnings += (SAID,)
    else:
        leave(reader)
    return reader


def share_seen(
    recording: Recording, reader: Reconstructor, *, frames: Sequence[Bytes] | None = None
) -> float | None:
    """Share of the forecast shadow that `frames` (H, W, 3), rectified, show; NaN: none is forecast.

    None where it cannot be told: without balls, lamps that explain all of the light, or a deep frame. The reader
    undoes shadows afterwards where it could be told; `leave` takes that back.
    """
    method = reader.referenced
    if method is None or not (recording.balls or getattr(method, "lamps", None)):
        return None
    frames = some_frames(recording, count=FRAMES_READ) if frames is None else frames
    peaks = [_peak_mm(reader, rgb) for rgb in frames]
    deepest = [frames[k] for k in np.argsort(peaks)[::-1][:FRAMES_TRIED] if peaks[k] > MIN_DEPTH_MM]
    lamps = find_lamps(recording, reader) if deepest else None
    if lamps is None:
        return None
    if lamps.doubtful:
        doubt(reader)
        return None
    field = undo_by(reader, lamps)
    pictures = [(rgb, reader.rectified_map(rgb).depth_mm) for rgb in deepest]
    return shadow_share(field, pictures, reference=method.reference.rgb)


def _peak_mm(reader: Reconstructor, rgb: Bytes) -> float:
    """How deep a rectified frame (H, W, 3) is pressed, mm; 0 where it cannot be read: a black one shows none."""
    try:
        return float(reader.rectified_map(rgb).depth_mm.max())
    except InputError:
        return 0.0


def shows_none(recording: Recording, reader: Reconstructor) -> bool:
    """Whether it can be told that the frames show no cast shadows; the reader leaves them afterwards."""
    share = share_seen(recording, reader)
    leave(reader)
    return share is not None and share <= SEEN_SHARE


def undo_by(reader: Reconstructor, lamps: Lamps) -> LightField:
    """Let the reader undo the shadows that these lamps cast from now on; their light over its picture."""
    field = LightField.of(lamps, (reader.sensor.height_px, reader.sensor.width_px), reader.sensor.mm_per_px)
    reader.shadows, reader.lean, reader.keeps_shadows = field, UNDONE_LEAN, False
    return field


def doubt(reader: Reconstructor) -> None:
    """Let the reader flag deep maps from now on, and state more of faces, since it knows some lamps not."""
    reader.unknown_lamps = True
    if reader.error is not None:
        reader.error.lamps_std = UNKNOWN_LAMPS_STD
    if DOUBTED not in reader.warnings:
        reader.warnings += (DOUBTED,)


def leave(reader: Reconstructor) -> None:
    """Let the reader leave cast shadows as they are from now on, and say no more that it undoes them."""
    reader.shadows, reader.lean = None, LEAN
    reader.warnings = tuple(one for one in reader.warnings if one != SAID)
