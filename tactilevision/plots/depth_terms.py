"""Which term of a depth's deviation is the largest, place by place, and how much each of them adds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.plots import style
from tactilevision.plots.height import extent_mm, scale_bar, titled
from tactilevision.records import Bools, HeightMap

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Terms = Mapping[str, npt.NDArray[np.floating[Any]]]
# as the terms are ordered
COLOURS = (
    style.BLUE,
    style.SKY,
    "#F2D54B",
    style.GREY,
    style.GREEN,
    style.YELLOW,
    style.PURPLE,
    style.ORANGE,
    "#4B3A1D",
    "#8C2D5A",
    "#101010",
)
MIN_SHARE = 0.002  # of the picture: a term that is the largest over less has no entry in the legend
DEEP = 0.5  # of the greatest depth: what counts as contact for the bars
PALE = 0.4  # opacity of the bars that stand for all places but the contact


@style.house_look
def draw_terms(height: HeightMap, terms: Terms, *, title: str = "") -> Figure:
    """The term (h, w) mm that dominates at each place, beside the rms of each term in the contact and elsewhere.

    `terms` are deviations in mm by name, on a grid over the map's picture (Reconstructor.depth_terms).
    """
    figure, (above, bars) = style.new_figure(style.WIDTH_IN, 7.6, rows=2)
    entries = _draw_largest(above, height, terms)
    above.set_title(titled(height, title or f"{height.name}: largest part of the depth's deviation", between="\n"))
    _draw_bars(bars, height, terms)
    figure.legend(handles=entries, loc="outside lower center", ncols=2, fontsize=9)
    return figure


def _draw_largest(axes: Axes, height: HeightMap, terms: Terms) -> list[Artist]:
    """Colour each place by its largest term; what belongs into the legend."""
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    largest = np.argmax(np.stack(list(terms.values())), axis=0)
    known = _on_grid(height.valid, largest.shape)
    axes.set_facecolor(style.INVALID)
    axes.imshow(
        np.ma.masked_where(~known, largest),
        cmap=ListedColormap(COLOURS[: len(terms)]),
        vmin=-0.5,
        vmax=len(terms) - 0.5,
        extent=extent_mm(height),
        interpolation="none",
    )
    shares = np.bincount(largest[known], minlength=len(terms)) / float(max(int(known.sum()), 1))
    entries: list[Artist] = [
        Patch(color=colour, label=f"{name}: {100 * share:.0f} % of the picture")
        for name, colour, share in zip(terms, COLOURS, shares, strict=False)
        if share >= MIN_SHARE
    ]
    if not known.all():
        entries.append(Patch(color=style.INVALID, label="depth not known"))
    top = float(np.max(height.depth_mm, where=height.valid, initial=0.0))
    if top > 0:
        depth = np.ma.masked_where(~height.valid, height.depth_mm)
        axes.contour(
            depth, levels=[DEEP * top], colors="black", linewidths=1.0, extent=extent_mm(height), origin="upper"
        )
        entries.append(Line2D([], [], color="black", lw=1.0, label="half of the greatest depth"))
    scale_bar(axes, height, colour="black")
    axes.grid(False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    return entries


def _draw_bars(axes: Axes, height: HeightMap, terms: Terms) -> None:
    from matplotlib.patches import Patch

    shape = next(iter(terms.values())).shape
    depth, known = _on_grid(height.depth_mm, shape), _on_grid(height.valid, shape)
    contact = known & (depth > DEEP * float(np.max(depth, where=known, initial=0.0)))
    places, colours = np.arange(len(terms)), COLOURS[: len(terms)]
    for offset, where, alpha in ((-0.2, contact, 1.0), (0.2, known & ~contact, PALE)):
        rms_um = [1e3 * _rms(term, where) for term in terms.values()]
        axes.barh(places + offset, rms_um, height=0.38, color=colours, alpha=alpha)
    axes.set_yticks(places, list(terms))
    axes.invert_yaxis()
    axes.set(xlabel="rms deviation of depth (µm)", title="What each term adds")
    axes.grid(axis="y", visible=False)
    axes.legend(
        handles=[
            Patch(color=style.GREY, label="deeper than half of the greatest depth"),
            Patch(color=style.GREY, alpha=PALE, label="elsewhere"),
        ],
        loc="lower right",
    )


def _rms(term: npt.NDArray[np.floating[Any]], where: Bools) -> float:
    return float(np.sqrt(np.mean(np.square(term[where])))) if where.any() else 0.0


def _on_grid(field: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """The field (H, W) at the points of a coarser grid (h, w) over the same picture."""
    rows, columns = (
        np.minimum(np.arange(few) * -(-many // few), many - 1)
        for few, many in zip(shape, field.shape, strict=True)
    )
    return np.asarray(field[np.ix_(rows, columns)])
