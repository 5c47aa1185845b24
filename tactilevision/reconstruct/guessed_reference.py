"""Where the frame that was taken for untouched gel shows a contact, the median of the frames may stand for it.

A contact in the reference stands in every frame as a hill; contacts that move leave none in the median.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.quality.contact_in_reference import contact_in_reference, pressed_beside
from tactilevision.quality.reference_match import some_frames
from tactilevision.reconstruct.reconstructor import Reconstructor
from tactilevision.records import Bytes, Pair

if TYPE_CHECKING:
    from tactilevision.recording import Recording

MAX_FRAMES = 25  # frames of which the median is taken: a place may be pressed in twelve of them


def with_free_reference(
    recording: Recording,
    flats: Sequence[Bytes],
    ready: Reconstructor,
    *,
    read: Callable[[Sequence[Bytes]], Reconstructor],
) -> tuple[Sequence[Bytes], Reconstructor, tuple[str, ...]]:
    """Pictures (H, W, 3) of the untouched gel, the reconstructor against them, and what was taken for them.

    The same as before unless the guessed frame shows a contact and the median of the frames shows none, neither
    by the frames nor against the guessed frame. `read` makes a reconstructor against such pictures.
    """
    frames = some_frames(recording, count=MAX_FRAMES)
    at = _contact(ready, frames)
    if at is None:
        return flats, ready, ()
    median: Bytes = np.median(frames, axis=0).round().astype(np.uint8)
    against = read([median])
    if _contact(against, frames) is not None or _pressed(ready, median):
        return flats, ready, ()
    name = recording.frame_names[recording.flat_frames[0]]
    note = (
        f"{name} shows a contact near ({at[0]:.0f}, {at[1]:.0f}) px: in its place the median of {len(frames)} "
        "frames is taken for the untouched gel; --reference states a picture of it"
    )
    return [median], against, (note,)


def _contact(reader: Reconstructor, frames: Sequence[Bytes]) -> Pair | None:
    method = reader.referenced
    return None if method is None else contact_in_reference(method, reader.rectified_map, pictures=frames)


def _pressed(reader: Reconstructor, picture: Bytes) -> bool:
    method = reader.referenced
    return method is None or pressed_beside(method, reader.rectified_map, picture=picture)
