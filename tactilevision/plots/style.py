"""Style of all figures: colours, sizes, legends, and fonts for users' names."""

from __future__ import annotations

import base64
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, wraps
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from tactilevision.errors import InputError
from tactilevision.files.writing import replacing
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


# Fonts for letters that Matplotlib's default font lacks.


def legible(name: str) -> str:
    """Return the name with U+XXXX for each letter that no installed font has, and a space for a tab."""
    if name.isascii() and name.isprintable():
        return name
    return "".join(letter if _is_drawn(letter) else f"U+{ord(letter):04X}" for letter in name.replace("\t", " "))


def choose_fonts(figure: Figure) -> None:
    """Add fonts to the texts of a figure for letters outside the default font; replace those that none has."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        said = text.get_text() if isinstance(text, Text) else ""
        if said.isascii() and "\t" not in said:
            continue
        text.set_text("\n".join(map(legible, said.split("\n"))))
        further = dict.fromkeys(font for font in map(font_of, text.get_text()) if font)
        if further:
            text.set_fontfamily([*text.get_fontfamily(), *further])


def _is_drawn(letter: str) -> bool:
    invisible = unicodedata.category(letter) in ("Cf", "Mn", "Me")  # joiners and accents: fonts shape by them
    return invisible or font_of(letter) is not None


@cache
def font_of(letter: str) -> str | None:
    """Return the family of an upright font that has a letter, "" for the default font, None if none has it."""
    from matplotlib.font_manager import FontProperties, findfont, fontManager

    if ord(letter) in _letters(findfont(FontProperties())):
        return ""
    for entry in sorted(fontManager.ttflist, key=lambda entry: (entry.name, entry.fname)):
        upright = entry.style == "normal" and entry.weight in (400, "normal", "regular")
        # "Last Resort" is Matplotlib's own font of boxes, which claims to have every letter
        if upright and "Last Resort" not in entry.name and ord(letter) in _letters(entry.fname):
            return entry.name
    return None


@cache
def _letters(path: str) -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    try:
        font = FT2Font(path)
        return frozenset(font.get_charmap()) if font.scalable else frozenset()
    except (OSError, RuntimeError, ValueError):  # removed since, or of a kind that cannot be read
        return frozenset()


# The style of all figures.

Extent = tuple[float, float, float, float]  # left, right, bottom, top
P = ParamSpec("P")
R = TypeVar("R")

# Okabe and Ito's palette, distinct under all common kinds of colour vision.
COLOUR_WORDS = {
    "#0072B2": "blue",
    "#E69F00": "dark yellow",
    "#009E73": "green",
    "#D55E00": "orange",
    "#56B4E9": "light blue",
    "#CC79A7": "pink",
    "#767676": "grey",
}
BLUE, YELLOW, GREEN, ORANGE, SKY, PURPLE, GREY = COLOUR_WORDS
CYCLE = (BLUE, YELLOW, GREEN, PURPLE, SKY, ORANGE, GREY)
DEPTH_MAP = "cividis"
INVALID = "#d9d9d9"
GRID = "#e6e6e6"


@dataclass(frozen=True, slots=True)
class Look:
    """Sizes of what figures show: widths of lines, marks and text in points, opacities from 0 to 1, inches."""

    line: int = 1  # zero lines, error bars, and one of several courses or limits
    strong: int = 2  # the course that a figure is about
    dot: int = 2  # one of many samples
    mark: int = 4  # one point of a few
    best: int = 6  # the estimate
    band: float = 0.2  # opacity of an interval or region
    faint: float = 0.4  # opacity of samples that overlap, and of the background
    text: int = 10
    small: int = 9  # ticks, legends and crowded titles
    room: float = 0.15  # share of an axis left free around what is shown
    bar: float = 0.8  # length of a colour bar, as a share of its axes


LOOK = Look()
WIDTH_IN = 7  # the widest figure of a report: at 500 px its text is still 9 px high
MAP_IN = (6, 6 * 3 / 4)  # width and height of a figure of one map, in
ARROW = 0.003  # width of arrows on a map, as a share of the map's
SPAN = (0.5, 99.5)  # percentiles of the values between which an axis or a colour scale reaches
PHOTO_QUALITY = 90  # of a lossy WebP picture, 0 to 100
PNG_LEVEL = 3  # effort of compression from 0 to 9: half the time of 6 for a tenth more bytes
LONGEST_LABEL = 24  # letters of a name in a figure: two of them fit a title over two panels
FORMS = ("png", "svg", "pdf")  # a figure is always written as the first, which pages embed

RC: Any = {
    "font.size": LOOK.text,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": LOOK.text,
    "xtick.labelsize": LOOK.small,
    "ytick.labelsize": LOOK.small,
    "legend.fontsize": LOOK.small,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": LOOK.line,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": LOOK.strong,
    "lines.markersize": LOOK.mark,
    "figure.dpi": 150,
    "text.parse_math": False,  # labels are the user's: "$x_{$" is text
}


def house_look(draw: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function under RC, and restore the caller's settings afterwards."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        import matplotlib as mpl

        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return drawn


def new_figure(
    width_in: float = WIDTH_IN, height_in: float | None = None, *, rows: int = 1, columns: int = 1
) -> tuple[Figure, list[Axes]]:
    """Return a figure with its axes row by row; without a height, each row has the same."""
    from matplotlib.figure import Figure

    height_in = 1 + 2.4 * rows if height_in is None else height_in
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def fixed_figure(
    rows: int, columns: int, *, height_in: float, below_in: float, spaces: tuple[float, float]
) -> tuple[Figure, Any]:
    """Return a figure with its axes (rows, columns) at fixed places: faster than a constrained layout.

    `spaces` between them across and down are shares of one's width and height; `below_in` is left for a legend.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, height_in))
    below, above = below_in / height_in, 1 - 0.5 / height_in
    figure.subplots_adjust(left=0.1, right=0.95, bottom=below, top=above, wspace=spaces[0], hspace=spaces[1])
    return figure, figure.subplots(rows, columns, squeeze=False)


def new_quad(*, legend_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of two by two axes at fixed places."""
    spaces = (1 / 3, LOOK.band)
    figure, axes = fixed_figure(2, 2, height_in=legend_in + 5, below_in=legend_in + 0.5, spaces=spaces)
    return figure, list(axes.ravel())


def zero_line(axes: Axes, at: float = 0) -> None:
    """Draw the horizontal line that values are compared with."""
    axes.axhline(at, color=GREY, lw=LOOK.line)


def note(axes: Axes, words: str) -> None:
    """Write in the middle of empty axes why there is nothing."""
    axes.text(0.5, 0.5, words, ha="center", transform=axes.transAxes, color=GREY)


def as_map(axes: Axes, x: str = "x (mm)", y: str = "y (mm)", title: str = "") -> None:
    """Prepare axes for a map: no grid, and grey where nothing is known."""
    axes.set_facecolor(INVALID)
    axes.grid(False)
    axes.set(xlabel=x, ylabel=y)
    if title:
        axes.set_title(title)


def colour_bar(axes: Axes, image: ScalarMappable, label: str) -> None:
    """Draw the scale of a map's colours next to its axes."""
    axes.figure.colorbar(image, ax=axes, label=label, shrink=LOOK.bar)


def show_map(
    axes: Axes, field: Floats, extent: Extent, *, limits: tuple[float, float], cmap: str | Colormap = DEPTH_MAP
) -> AxesImage:
    """Draw a field (H, W), in its unit, over `extent` with colours between `limits`; NaN is grey."""
    low, high = limits
    axes.set_facecolor(INVALID)
    return axes.imshow(field, cmap=cmap, vmin=low, vmax=high, extent=extent, interpolation="none")


def unknown_entry(axes: Axes, label: str = "depth not known") -> None:
    """Add a legend entry for the grey of unknown places."""
    axes.plot([], [], "s", ms=LOOK.best, color=INVALID, mec=GREY, label=label)


def outlined_entry(axes: Axes, label: str, *, colour: str = "white", ls: str = "-") -> None:
    """Add a legend entry for lines or arrows on a map, with an outline that white paper needs."""
    from matplotlib.patheffects import withStroke

    rim = [withStroke(linewidth=3, foreground=GREY)]
    axes.plot([], [], color=colour, lw=LOOK.line, ls=ls, path_effects=rim, label=label)


def arrows(axes: Axes, x: Any, y: Any, u: Any, v: Any, *, colour: str, scale: float) -> None:
    """Draw arrows (u, v) / `scale` at places (x, y) in the units of the axes."""
    axes.quiver(x, y, u, v, color=colour, angles="xy", scale_units="xy", scale=scale, width=ARROW)


def legend_below(figure: Figure, *, columns: int = 3, corner: Axes | None = None) -> Figure:
    """Return the figure with one legend of all axes, each label once, below them or in the empty axes `corner`."""
    from matplotlib.lines import Line2D

    entries = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if not entries:
        return figure
    handles, labels = list(entries.values()), list(entries)
    if corner is not None:
        corner.set_axis_off()
        legend = corner.legend(handles, labels, loc="center left")
    else:
        place: Any = "lower center" if figure.get_layout_engine() is None else "outside lower center"
        legend = figure.legend(handles, labels, loc=place, ncols=columns)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set(markersize=max(handle.get_markersize(), 5), alpha=1)  # small dots of a cloud
    return figure


def as_label(name: str) -> str:
    """Return a user's name in letters that a font has, without its middle where it is long."""
    name = legible(name)
    half = (LONGEST_LABEL - 1) // 2
    return name if len(name) <= LONGEST_LABEL else f"{name[: LONGEST_LABEL - 1 - half]}…{name[-half:]}"


def save_figure(figure: Figure, path: Path | str, *, form: str = "png") -> None:
    """Write the figure as PNG to `path`, and in `form` of FORMS next to it, atomically."""
    import matplotlib as mpl

    choose_fonts(figure)
    layout = figure.get_layout_engine()
    if layout is not None:  # once: Matplotlib draws everything a second time for any engine that is left
        layout.execute(figure)
        with mpl.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)
    for one in dict.fromkeys((FORMS[0], form)):
        with replacing(Path(path).with_suffix(f".{one}")) as temporary:
            packed: dict[str, Any] = {"pil_kwargs": {"compress_level": PNG_LEVEL}} if one == FORMS[0] else {}
            figure.savefig(temporary, format=one, **packed)


def data_uri(path: Path | str, *, photograph: bool) -> str:
    """Return a PNG as a data URI of a WebP picture: of a photograph lossy, of a drawing lossless."""
    from PIL import Image

    packed = BytesIO()
    how: dict[str, Any] = (
        {"quality": PHOTO_QUALITY, "method": 2} if photograph else {"lossless": True, "quality": 0, "method": 1}
    )
    with Image.open(path) as picture:
        picture.convert("RGB").save(packed, "webp", **how)
    return "data:image/webp;base64," + base64.b64encode(packed.getvalue()).decode()


def holds_photographs(figure: Figure) -> bool:
    """Return whether a figure shows pictures or maps, which only a lossy encoding makes small."""
    return any(axes.images for axes in figure.axes)


def check_screen() -> None:
    """Raise InputError where there is no screen to open a window on."""
    import matplotlib.pyplot as plt

    if plt.get_backend().lower() == "agg":
        raise InputError(
            "there is no screen or window toolkit to open a window with",
            where="--window",
            remedy="Omit the option and look at the PNG files.",
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
