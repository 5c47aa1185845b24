"""Records as terminals, reports and notebooks show them: numbers in words, a short text, a compact table."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.records.constants import KILO
from tactilevision.records.measured import Bytes, Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST = 240  # letters of a value that are shown
MOST_NOTES = 4  # warnings that are shown; the rest are counted
WIDTH_PX = 200  # of a picture in a table
QUALITY = 80  # of this picture, of 100


def number(value: float | None, std: float | None = None) -> str:
    """Return a number to two digits of its std, in full where that is 0, or to four significant digits."""
    if value is None or not math.isfinite(value):
        return "–"
    if std == 0:
        return f"{value:.10g}"
    if std is None or not math.isfinite(std) or std < 0:
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{min(digits, 8)}f}"


def estimate(found: Estimate) -> str:
    """Return a value with its unit and its 95 % interval, or why there is none."""
    unit, span = "" if found.unit in ("", "1") else f" {found.unit}", ""
    if found.interval95 is not None:
        low, high = found.interval95
        fine = found.std or abs(high - low) / 4
        span = f"{number(low, fine)} to {number(high, fine)}{unit}"
    if found.value is None:
        why = found.why or "no reason recorded"
        return f"not determined by these data ({why})" + (f"; 95 %: {span}" if span else "")
    return f"{number(found.value, found.std)}{unit}" + (f" (95 %: {span})" if span else "")


def mN(force_N: float) -> str:
    """Return a force in mN."""
    return f"{KILO * force_N:.1f} mN" if math.isfinite(force_N) else "unknown"


@dataclass(frozen=True, slots=True)
class Summary:
    """What is shown of a record: a title, values by name, `notes`, and a picture (H, W, 3) uint8."""

    title: str
    values: Mapping[str, str | Estimate]
    notes: tuple[str, ...] = ()
    picture: Bytes | None = field(default=None)

    def lines(self) -> list[tuple[str, str]]:
        """Return the names and values as plain text, none longer than LONGEST letters."""
        rows = [(key, estimate(one) if isinstance(one, Estimate) else one) for key, one in self.values.items()]
        rows += [("note", note) for note in self.notes[:MOST_NOTES]]
        more = len(self.notes) - MOST_NOTES
        rows += [("notes", f"{more} more")] if more > 0 else []
        return [(key, text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…") for key, text in rows if text]


class Displayed:
    """A record that states what is shown of it in `summary`; texts of users are escaped here."""

    __slots__ = ()

    def summary(self) -> Summary:
        """Return what a terminal and a notebook show."""
        raise NotImplementedError

    def __repr__(self) -> str:
        found = self.summary()
        return "\n".join([found.title, *(f"  {key}: {text}" for key, text in found.lines())])

    def _repr_html_(self) -> str:
        found, left = self.summary(), ' style="text-align: left"'
        cells = (f"<tr><th{left}>{escape(key)}</th><td{left}>{escape(v)}</td></tr>" for key, v in found.lines())
        title, picture = escape(found.title), ""
        if found.picture is not None:
            picture = f'<img alt="{title}" src="{as_uri(found.picture)}">'
        return f"<div><b>{title}</b><table>{''.join(cells)}</table>{picture}</div>"


def as_uri(rgb: Bytes) -> str:
    """Return a picture (H, W, 3) as a small WebP data URI of at most WIDTH_PX columns."""
    import cv2

    step = max(1, -(-rgb.shape[1] // WIDTH_PX))
    small = np.ascontiguousarray(rgb[::step, ::step, ::-1])
    packed = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1]
    return f"data:image/webp;base64,{b64encode(packed.tobytes()).decode()}"


def figure(name: str, *given: Any, **how: Any) -> Figure:
    """Return a figure by a function of `tactilevision.notebook`, loaded by name, as it is above the records."""
    made: Figure = getattr(import_module("tactilevision.notebook"), name)(*given, **how)
    return made
