"""Letters of the user's names that the figure's font lacks: drawn in an installed font that has them, else written
as their numbers in Unicode.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BOXES = "Last Resort"  # Matplotlib's own font of boxes: it claims to have every letter


def legible(name: str) -> str:
    """The name in letters that an installed font has: U+XXXX for one that none has, and a space for a tab."""
    if name.isascii() and name.isprintable():
        return name
    return "".join(letter if _is_drawn(letter) else f"U+{ord(letter):04X}" for letter in name.replace("\t", " "))


def choose_fonts(figure: Figure) -> None:
    """Let each text of a figure have its letters: by further fonts, or numbers in their place."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        said = text.get_text() if isinstance(text, Text) else ""
        if said.isascii() and "\t" not in said:
            continue
        lines = map(legible, said.split("\n"))
        text.set_text("\n".join(lines))
        further = dict.fromkeys(font for font in map(_other_font, text.get_text()) if font)
        if further:
            text.set_fontfamily([*text.get_fontfamily(), *further])


def _is_drawn(letter: str) -> bool:
    invisible = unicodedata.category(letter) in ("Cf", "Mn", "Me")  # joiners and accents: fonts shape by them
    return invisible or ord(letter) in _usual() or _other_font(letter) is not None


@cache
def _usual() -> frozenset[int]:
    from matplotlib.font_manager import FontProperties, findfont, get_font

    return frozenset(get_font(findfont(FontProperties())).get_charmap())


@cache
def _other_font(letter: str) -> str | None:
    """The family of an installed font that has the letter where the usual one lacks it."""
    if ord(letter) in _usual():
        return None
    return next((family for family, letters in _installed() if ord(letter) in letters), None)


def _installed() -> Iterator[tuple[str, frozenset[int]]]:
    """Upright fonts of usual weight, by name; pictures of letters (colour emoji) cannot be drawn."""
    from matplotlib.font_manager import fontManager

    for entry in sorted(fontManager.ttflist, key=lambda entry: (entry.name, entry.fname)):
        if entry.style == "normal" and entry.weight in (400, "normal", "regular") and _BOXES not in entry.name:
            letters = _letters(entry.fname)
            if letters:
                yield entry.name, letters


@cache
def _letters(path: str) -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    try:
        font = FT2Font(path)
        return frozenset(font.get_charmap()) if font.scalable else frozenset()
    except (OSError, RuntimeError, ValueError):  # removed since, or of a kind that cannot be read
        return frozenset()
