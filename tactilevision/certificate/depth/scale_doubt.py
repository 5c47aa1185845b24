"""Why the camera's scale of depth is off at gentle faces: by the balls' radius, or by shadows that lamps cast?

A wrong radius makes all depths wrong alike, shadows beside the faces make them too deep, and both may cancel. So
some of the faces are read once more with shadows undone, where the frames show any. On two sensors of a renderer
that shares no code with the library, lamps at 13 to 30 degrees, gentle faces then read 3 % too shallow at most,
and 12 % where balls are stated 10 % too large; with their shadows they read 8 % too deep and 5 % too shallow, or
at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.certificate.depth.certified_faces import Certified, read_faces
from tactilevision.certificate.depth.depth_scale import (
    GENTLE_MM,
    MIN_COUNT,
    scale_off,
    scale_question,
    scale_warning,
)
from tactilevision.errors import TactilevisionError
from tactilevision.reconstruct import Reconstructor
from tactilevision.reconstruct.lamps import find_lamps
from tactilevision.reconstruct.shadows_seen import SEEN_SHARE, leave, share_seen, undo_by
from tactilevision.recording import Recording
from tactilevision.records import Pair

FACES = 5  # faces that are read again, spread over depth: each takes a second


@dataclass(frozen=True, slots=True)
class Undone:
    """Whether frames show cast shadows, None: it cannot be told; faces (read, certified), mm, without them."""

    shows: bool | None
    pairs: tuple[Pair, ...] = ()


def doubt_of_scale(
    recording: Recording, reconstructor: object, *, pairs: Sequence[Pair], certified: Sequence[Certified]
) -> str:
    """As `scale_warning` of gentle faces in `pairs` (seen, certified), mm, but with shadows told from the radius.

    `certified` are the presses that they belong to. The reconstructor leaves shadows as they were.
    """
    radii = [ball.ball_radius_mm for ball in recording.balls]
    said, off = scale_warning(pairs, radii), scale_off(pairs)
    if off is None or not radii or not isinstance(reconstructor, Reconstructor):
        return said
    undone = without_shadows(recording, reconstructor, certified=certified, seen=False)
    if undone.shows is None or len(undone.pairs) < (MIN_COUNT if undone.shows else 0):
        return said
    if not undone.shows:
        return scale_question(off, len(pairs), radii_mm=radii, shadows="")
    left = scale_off(undone.pairs)
    if left is not None:
        return scale_question(left, len(undone.pairs), radii_mm=radii, shadows=" without cast shadows")
    return (
        f"Depth as the picture reads it is {100 * (off - 1):+.0f} % off what the bevel certifies of gentle faces: "
        "lamps cast shadows beside them. Without these it is not, so the balls' radius stands; `depth` and "
        "`force` undo them."
    )


def doubt_beside_shadows(
    recording: Recording, reconstructor: Reconstructor, *, certified: Sequence[Certified]
) -> str:
    """A sentence where gentle faces are off once shadows, which may hide it, are undone; "" where not."""
    radii = [ball.ball_radius_mm for ball in recording.balls]
    undone = without_shadows(recording, reconstructor, certified=certified, seen=True) if radii else Undone(None)
    off = scale_off(undone.pairs)
    if off is None:
        return ""
    return scale_question(off, len(undone.pairs), radii_mm=radii, shadows=" without cast shadows")


def without_shadows(
    recording: Recording, reconstructor: Reconstructor, *, certified: Sequence[Certified], seen: bool
) -> Undone:
    """FACES gentle faces of `certified` presses with cast shadows undone, where the frames show some.

    `seen`: they are known to.
    """
    gentle = sorted((one for one in certified if one.depth_mm <= GENTLE_MM), key=lambda one: one.depth_mm)
    if not gentle or reconstructor.shadows is not None:
        return Undone(None)
    some = [gentle[k] for k in np.unique(np.linspace(0, len(gentle) - 1, FACES).astype(int))]
    kept = reconstructor.keeps_shadows
    try:
        lamps = find_lamps(recording, reconstructor)
        if lamps is None or lamps.doubtful:
            return Undone(None)
        if seen:
            undo_by(reconstructor, lamps)
        elif (share := share_seen(recording, reconstructor)) is None or not share > SEEN_SHARE:
            return Undone(None if share is None else False)
        faces = read_faces(recording, reconstructor, certified=some)
        return Undone(True, tuple((one.as_taught(None), one.certified_mm) for one in faces))
    except TactilevisionError:  # a torn frame; the certificate names it
        return Undone(None)
    finally:
        leave(reconstructor)
        reconstructor.keeps_shadows = kept
