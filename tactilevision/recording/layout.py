"""Names of the files and table columns of a recording, and suggestions for unknown names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, fields, replace

from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.rig import Press

SETTINGS = "recording.toml"
FRAMES = "frames"
FRAME_TABLE = "frames.csv"
FORCES = "forces.csv"
PRESSES = "presses.csv"
STAGE = "stage.csv"
CURVES = "curves.csv"
POINTS = "points.csv"
FLATS = "reference/flat"
BALLS = "reference/ball"
BALL_TABLE = "reference/ball.csv"
FOUND = "as_found"  # in results of an analysis: those of all steps, while some are taken back

FORMAT = 1  # version of the folder's format
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".npy")
VIDEO_SUFFIXES = (".mp4", ".mkv", ".avi")
PHASES = ("free", "load", "hold", "unload")


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns that one table may have.

    `numbers` and `words` are required and filled; `gap_numbers` are required, but a cell may be empty (NaN);
    `maybe_numbers` and `maybe_words` are optional, and a cell may be empty (NaN, "").
    """

    numbers: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    gap_numbers: tuple[str, ...] = ()
    maybe_numbers: tuple[str, ...] = ()
    maybe_words: tuple[str, ...] = ()

    @property
    def required(self) -> tuple[str, ...]:
        """The required columns."""
        return self.words + self.numbers + self.gap_numbers

    @property
    def known(self) -> tuple[str, ...]:
        """All columns with a meaning."""
        return self.required + self.maybe_words + self.maybe_numbers


def _columns_of(record: type) -> Columns:
    """Return the columns of a record's words and numbers, of which those with a default are optional."""

    def names(kind: str, *, optional: bool) -> tuple[str, ...]:
        return tuple(f.name for f in fields(record) if f.type == kind and (f.default is not MISSING) == optional)

    return Columns(
        numbers=names("float", optional=False),
        words=names("str", optional=False),
        maybe_numbers=names("float", optional=True),
        maybe_words=names("str", optional=True),
    )


FRAME_COLUMNS = Columns(words=("frame",), numbers=("time_s",))
FORCE_COLUMNS = Columns(
    numbers=("time_s", "fx_N", "fy_N", "fz_N"), maybe_numbers=("tx_Nm", "ty_Nm", "tz_Nm", "temperature_C")
)
PRESS_COLUMNS = _columns_of(Press)
STAGE_COLUMNS = Columns(numbers=("time_s", "z_mm"))
CURVE_COLUMNS = Columns(
    words=("press",),
    numbers=("time_s", "depth_mm", "fx_N", "fy_N", "fz_N"),
    maybe_words=("phase",),
    maybe_numbers=("z_mm",),
)
_POINT = _columns_of(CertifiedPoint)
POINT_COLUMNS = replace(_POINT, numbers=(), gap_numbers=_POINT.numbers, maybe_words=("accepted", "reason"))
BALL_COLUMNS = Columns(
    words=("frame",),
    numbers=("ball_radius_mm",),
    maybe_numbers=("centre_x_px", "centre_y_px", "contact_radius_px"),
)


def nearest(name: str, among: Iterable[str]) -> str:
    """Return the name that was probably meant: the same but for brackets, a unit or a slip.

    "" if there is none.
    """
    plain, folded = _folded(name), {_folded(other): other for other in among}
    for other in folded:
        if other.rpartition("_")[0] == plain or plain.rpartition("_")[0] == other:
            return folded[other]
    close = difflib.get_close_matches(plain, list(folded), n=1, cutoff=0.8)
    return folded[close[0]] if close else ""


def _folded(name: str) -> str:
    """Return the name in small letters, `Depth (mm)` as depth_mm."""
    return re.sub(r"[^\w./-]+", "_", name.casefold()).strip("_")


def some(names: Sequence[str]) -> str:
    """Return the first three names, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
