"""Was the gel touched when its reference was taken? Every frame then shows that contact the wrong way round.

Colours count from the reference, so gel that was pressed there and is free now comes out as a hill. Nothing makes
one but that: gel that rises beside a contact stands much lower than the contact is deep. So hills count which lie
at one place in the middle one of several frames, in gel that follows no drift of the light in most of them.
At the picture's border, where light and gel change first, a hill tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.illumination.drift import solid
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.quality.reference_match import ReferenceMatch
from tactilevision.records import Bools, Bytes, HeightMap, Pair

Array = npt.NDArray[np.floating[Any]]

MIN_FRAMES = 3  # frames that can be read; fewer show nothing
MAX_FRAMES = 9  # frames that are read, at most, spread evenly
MIN_BLOCKS = 6  # of the drift's; fewer are an edge of a contact, or noise
# times the usual deviation of a picture's depths; false hills on real gel have 3 where they count
DETECTION_SIGMA = 6.0
MIN_MM = 0.03  # mm: the least height that counts, however small the deviations
MIN_DENT_SHARE = 0.5  # of the deepest dent that touches the hill: gel beside a contact rises by a fifth and less
PRESSED_SIGMA = 3.0  # deviations of depth, for a dent in what may become the reference: in doubt it does not
# of the hill: 49 of 54 free medians have a dent of .39 of it at most, 46 of 47 pressed ones .42 and more
MAX_RISE_SHARE = 0.4
BORDER = 2  # blocks along the border of the picture, which do not count


def check_reference(
    match: ReferenceMatch, height_map: Callable[[Bytes], HeightMap], *, pictures: Sequence[Bytes]
) -> tuple[str, ...]:
    """A warning where rectified `pictures` (H, W, 3), not shifted, show a contact in the reference; it is noted.

    `height_map` gives the map, in mm, of a rectified picture.
    """
    if match.shift_px is not None or match.contact_px is not None:
        return ()
    match.contact_px = contact_in_reference(match.method, height_map, pictures=pictures)
    if match.contact_px is None:
        return ()
    x, y = match.contact_px
    return (
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
    some = np.unique(np.linspace(0, len(pictures) - 1, min(MAX_FRAMES, len(pictures))).astype(int))
    read = [_in_blocks(method, height_map, pictures[k]) for k in some]
    maps = [one for one in read if one is not None]
    if len(maps) < MIN_FRAMES:
        return None
    depth, std = (np.median([one[k] for one in maps], axis=0) for k in (0, 1))
    often = np.mean([changed for _, _, changed in maps], axis=0) > 0.5
    least = max(MIN_MM, DETECTION_SIGMA * float(np.median(std)))
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
