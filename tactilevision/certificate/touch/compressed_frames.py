"""What a strong compression hides of a touch: dents fainter than its steps are rounded away, and come late.

The steps that it leaves between its blocks of 8 pixels tell its strength, b in grey levels. All touches of a
recording are late together, by one sigma of _LATE_MM_PER_GREY (b - USUAL_GREY) beyond what the shape of a growing
dent leaves open. JPEG of quality 80 and above stays below USUAL_GREY.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tactilevision.quality.compression import blocks_grey
from tactilevision.recording import BadFrame
from tactilevision.records import Frame

USUAL_GREY = 1.0  # grey levels between blocks up to which touches are not seen later; docs/how-to/lerobot.md
_LATE_MM_PER_GREY = 0.005  # mm, of touches in two samples packed as JPEG and MJPEG; docs/how-to/lerobot.md


def note_blocks(frames: Iterable[Frame | BadFrame], blocks: list[float]) -> Iterator[Frame | BadFrame]:
    """The frames as they come; `blocks` (grey levels) grows by the steps between blocks in the first sound one."""
    looked = False
    for frame in frames:
        if not looked and not isinstance(frame, BadFrame):
            blocks.append(blocks_grey(frame.rgb))
            looked = True
        yield frame


def late_std_mm(blocks: Sequence[float]) -> float:
    """Std (mm) of what all touches come late by together; 0 for `blocks` (grey levels) of usual pictures."""
    return _LATE_MM_PER_GREY * max(_typical(blocks) - USUAL_GREY, 0.0)


def compression_warnings(blocks: Sequence[float]) -> tuple[str, ...]:
    """A sentence where pictures are compressed so strongly that touches of the bevel are seen late."""
    late = late_std_mm(blocks)
    if not late:
        return ()
    return (
        f"Frames are strongly compressed: blocks of 8 pixels differ by {_typical(blocks):.1f} grey levels. Faint "
        f"dents are lost, so touches of the bevel may be seen {1e3 * late:.0f} um late more than usual, which "
        "widens the interval of c, and less of the presses may be used. Record single pictures (PNG, or JPEG of "
        "quality 90 and more) or a lossless video (FFV1).",
    )


def _typical(blocks: Sequence[float]) -> float:
    return float(np.median(blocks)) if blocks else 0.0
