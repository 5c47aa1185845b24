"""Set the style of all figures: colours, axes with units, and fonts for users' names."""

from __future__ import annotations

import base64
import unicodedata
from collections.abc import Callable, Iterator
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from tactilevision.errors import InputError
from tactilevision.files.writing import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Letters of the user's names that the figure's font lacks: drawn in an installed font that has them, else written
# as their numbers in Unicode.

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


# One look for all figures: colours that colour-blind readers tell apart, units on every axis, no chart junk.

P = ParamSpec("P")
R = TypeVar("R")

# Okabe & Ito's palette, told apart by all common kinds of colour vision.
BLUE, YELLOW, GREEN, ORANGE, SKY, PURPLE, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
    "#767676",
)
COLOUR_WORDS = {
    BLUE: "blue",
    YELLOW: "dark yellow",
    GREEN: "green",
    ORANGE: "orange",
    SKY: "light blue",
    PURPLE: "pink",
    GREY: "grey",
}
CYCLE = (BLUE, YELLOW, GREEN, PURPLE, SKY, ORANGE, GREY)
DEPTH_MAP = "cividis"
INVALID = "#d9d9d9"

WIDTH_IN = 7.0  # the widest figure of a report: at 500 px its text is still 9 px high; by trial
LOSSLESS = 101  # quality of a WebP picture that keeps every bit, as OpenCV states it
PHOTO_QUALITY = 90  # of a WebP picture that loses some, 0 to 100; by eye on the presses of gelslim3
WORTH_IT = 0.6  # of the lossless size: a smaller lossy picture is taken; parts photographs from drawings
LONGEST_LABEL = 24  # letters of a name in a figure: two of them fit a title over two panels, by eye
FORMS = ("png", "svg", "pdf")  # a figure is always written as the first, which pages embed

RC: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.fontsize": 9,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "figure.dpi": 150,
    "text.parse_math": False,  # labels are the user's: "$x_{$" is text
}


def house_look(draw: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function under the house's settings; the caller's own settings are left as they were."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        import matplotlib as mpl

        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width_in: float, height_in: float, *, rows: int = 1, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    return figure, list(grid.ravel())


def new_quad(width_in: float, height_in: float, *, legend_in: float) -> tuple[Figure, list[Axes]]:
    """Two rows of two axes at fixed places, with room for a legend below: for many figures, quickly."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in))
    figure.subplots_adjust(
        left=0.7 / width_in,
        right=1 - 0.3 / width_in,
        bottom=(legend_in + 0.5) / height_in,
        top=1 - 0.55 / height_in,
        wspace=0.32,
        hspace=0.2,
    )
    return figure, list(figure.subplots(2, 2, squeeze=False).ravel())


def legend_below(figure: Figure, *, columns: int = 3, corner: Axes | None = None) -> None:
    """One legend of all axes, each label once: under them, or in a `corner` that is left empty for it."""
    from matplotlib.lines import Line2D

    entries = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if not entries:
        return
    handles, labels = list(entries.values()), list(entries)
    if corner is not None:
        corner.set_axis_off()
        legend = corner.legend(handles, labels, loc="center left")
    elif figure.get_layout_engine() is None:
        legend = figure.legend(handles, labels, loc="lower center", ncols=columns)
    else:
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set(markersize=max(handle.get_markersize(), 5), alpha=1)  # small dots of a cloud


def as_label(name: str) -> str:
    """A name of the user's as a figure holds it: letters that there is a font for, and no more than fit.

    A long one loses its middle: names differ at their ends (run_001, run_002).
    """
    name = legible(name)
    half = (LONGEST_LABEL - 1) // 2
    return name if len(name) <= LONGEST_LABEL else f"{name[: LONGEST_LABEL - 1 - half]}…{name[-half:]}"


def save_figure(figure: Figure, path: Path | str, *, form: str = "png") -> None:
    """Write the PNG `path`, and the figure in another of FORMS beside it; each whole or not at all."""
    choose_fonts(figure)
    for one in dict.fromkeys((FORMS[0], form)):
        with replacing(Path(path).with_suffix(f".{one}")) as temporary:
            figure.savefig(temporary, format=one)


def data_uri(path: Path | str) -> str:
    """A PNG as a data URI, for a page that needs no second file: as WebP, which all browsers read.

    Not a bit is lost of drawings; of photographs what no eye sees is, since that makes them far smaller.
    """
    import cv2
    import numpy as np

    written = np.frombuffer(Path(path).read_bytes(), np.uint8)  # OpenCV cannot open every name itself
    pixels = cv2.imdecode(written, cv2.IMREAD_COLOR)
    lossless, lossy = (
        cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()
        for quality in (LOSSLESS, PHOTO_QUALITY)
    )
    small = lossy if len(lossy) < WORTH_IT * len(lossless) else lossless
    return "data:image/webp;base64," + base64.b64encode(small).decode()


def check_screen() -> None:
    """Raise InputError where there is no screen to open a window on."""
    import matplotlib.pyplot as plt

    if plt.get_backend().lower() == "agg":
        raise InputError(
            "there is no screen, or no window toolkit, to open a window with",
            where="--window",
            remedy="Leave it out and look at the PNG files.",
        )


def show(figures: list[Figure], *, title: str = "") -> None:
    """Show figures in windows until they are closed. Raises InputError where there is no screen."""
    import matplotlib.pyplot as plt

    check_screen()
    for figure in figures:
        manager = plt.figure(figsize=tuple(figure.get_size_inches()), dpi=figure.dpi).canvas.manager
        assert manager is not None
        manager.canvas.figure = figure
        figure.set_canvas(manager.canvas)
        manager.set_window_title(title or "tactilevision")
    plt.show()
