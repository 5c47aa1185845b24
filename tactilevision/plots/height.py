"""Figures of height maps: from above, in section, in perspective, and the terms of their deviation."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.plots import style
from tactilevision.plots.style import LOOK
from tactilevision.records.constants import KILO, MICRO, MILLI, TINY
from tactilevision.records.maps import Footprint, HeightMap, add
from tactilevision.records.measured import Bools, Bytes, Floats, Pair

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from mpl_toolkits.mplot3d.axes3d import Axes3D


LINE = 40  # characters of a title next to another picture's
FLAT_MM = 0.02  # no contours are drawn of depths below: they would trace noise
VIEW = {"elev": 48, "azim": -62}  # degrees: from where a surface in perspective is seen
FACETS = 1.5  # of a surface in perspective over which it is smoothed (standard deviation)
RELIEF = 0.25  # height of a surface in perspective, as a share of its width


@style.house_look
def draw_height(height: HeightMap, rgb: Bytes | None = None) -> Figure:
    """Draw the map (H, W), in mm, from above with contours, and two cuts through its deepest place.

    With the rectified frame `rgb` (H, W, 3) also that, with the depth's contours.
    """
    corner = None
    if rgb is None:
        figure, (above, cuts) = style.new_figure(columns=2)
        first, what = above, "depth of the gel's surface"
    else:
        figure, (first, above, cuts, corner) = style.new_figure(rows=2, columns=2)
        overlay(first, rgb, height=height, footprint=None)
        what = "frame"
    style.colour_bar(above, depth_image(above, height), "depth into the gel (mm)")
    above.set_title("Depth of the gel's surface")
    first.set_title(titled(height, what))
    row, column = deepest_place(height)
    cut_lines(cuts, height, row=row, column=column)
    style.outlined_entry(above, "the cuts", ls=":")
    above.axhline(row * height.mm_per_px[1], color="white", lw=LOOK.line, ls=":")
    above.axvline(column * height.mm_per_px[0], color="white", lw=LOOK.line, ls=":")
    return style.legend_below(figure, corner=corner)


@style.house_look
def draw_map(height: HeightMap, *, std: bool = False) -> Figure:
    """Draw the map (H, W), in mm, from above with contours and a scale bar; with `std` also its deviation in um.

    Raises InputError where the deviation is asked for and the map states none.
    """
    if std and height.std_mm is None:
        raise InputError("the map states no standard deviation", where=f"height map {height.name}")
    figure, panels = style.new_figure(style.MAP_IN[0], (1 + std) * style.MAP_IN[1], rows=1 + std)
    style.colour_bar(panels[0], depth_image(panels[0], height), "depth into the gel (mm)")
    panels[0].set_title(titled(height, "depth of the gel's surface"))
    if std:
        std_um = np.where(height.valid, KILO * np.asarray(height.std_mm, dtype=np.float64), np.nan)
        top = float(np.nanpercentile(std_um, style.SPAN[1])) if height.valid.any() else 1.0
        image = style.show_map(panels[1], std_um, extent_mm(height), limits=(0, top))
        style.colour_bar(panels[1], image, "standard deviation (µm)")
        style.as_map(panels[1], title="Standard deviation of the depth")
        scale_bar(panels[1], height)
    return style.legend_below(figure)


@style.house_look
def draw_normals(height: HeightMap) -> Figure:
    """Draw the tilt of the surface (H, W) in degrees with arrows downhill, and the surface lit from above left."""
    figure, (tilt, lit) = style.new_figure(columns=2)
    down_y, down_x = map(np.asarray, np.gradient(known_mm(height), *height.mm_per_px[::-1]))
    degrees = np.degrees(np.arctan(np.hypot(down_x, down_y)))
    top = max(float(np.nanpercentile(degrees, style.SPAN[1])), 1.0) if np.isfinite(degrees).any() else 1.0
    extent = extent_mm(height)
    image = style.show_map(tilt, degrees, extent, limits=(0, top))
    style.colour_bar(tilt, image, "tilt (degrees)")
    _draw_arrows(tilt, height, (down_x, down_y))
    style.show_map(lit, _lit(down_x, down_y), extent, limits=(0, 1), cmap="gray")
    scale_bar(lit, height, colour="black")
    style.as_map(tilt, title=titled(height, "tilt, arrows point deeper"))
    style.as_map(lit, title="Lit from above left")
    _unknown_entry(tilt, height.valid)
    return style.legend_below(figure)


def _draw_arrows(axes: Axes, height: HeightMap, slopes: tuple[Floats, Floats]) -> None:
    """Draw arrows down the `slopes` (H, W) mm/mm along x and y, where they exceed a tenth of the greatest."""
    steep = np.hypot(*slopes)
    step = max(1, max(steep.shape) // 28)
    rows, columns = (np.arange(step // 2, n, step) for n in steep.shape)
    some = np.ix_(rows, columns)
    far = np.maximum(steep[some], TINY)
    strong = steep[some] > np.nanmax(steep, initial=0.0) / 10
    x, y = np.meshgrid(columns * height.mm_per_px[0], rows * height.mm_per_px[1])
    arrow = [np.where(strong, down[some] / far, 0)[strong] for down in slopes]
    style.arrows(axes, x[strong], y[strong], *arrow, colour="white", scale=2 / 3 / step / min(height.mm_per_px))


@style.house_look
def draw_surface(height: HeightMap) -> Figure:
    """Draw the surface (H, W), in mm, in perspective, depth downwards; the title gives the vertical scale."""
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D

    figure = Figure(figsize=(style.WIDTH_IN, style.WIDTH_IN * 3 / 4))
    axes = Axes3D(figure, rect=(0, 0, 1, 1 - LOOK.room / 2))  # above it is room for the title
    figure.add_axes(axes)
    depth = known_mm(height)
    scale = relief(axes, depth, height.mm_per_px, most=240, limits=colour_limits(depth))
    words = titled(height, "surface", between=" · ")
    axes.set_title(f"{words}   vertical scale × {scale:.0f}", loc="left")
    axes.view_init(**VIEW)
    return figure


def relief(
    axes: Axes3D,
    field_mm: Floats,
    mm_per_px: Pair,
    *,
    most: int,
    limits: tuple[float, float],
    cmap: str = style.DEPTH_MAP,
) -> float:
    """Draw a field (H, W) in mm, downwards, with `most` points along a side; return its vertical scale."""
    step = max(1, -(-max(field_mm.shape) // most))
    coarse = _smooth(field_mm, FACETS * step)[::step, ::step]  # or walls show their facets
    x, y = np.meshgrid(*(np.arange(n) * step * s for n, s in zip(coarse.shape[::-1], mm_per_px, strict=True)))
    low, high = limits
    axes.plot_surface(
        x, y, coarse, cmap=cmap, vmin=low, vmax=high, rstride=1, cstride=1, linewidth=0, antialiased=False
    )
    wide, deep = max(float(np.ptp(x)), MICRO), max(float(np.ptp(y)), MICRO)
    axes.set_box_aspect((wide, deep, RELIEF * wide))
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="mm", zlim=(high, low))
    axes.invert_yaxis()
    axes.locator_params(axis="z", nbins=3)  # the box is low: more would overlap
    return RELIEF * wide / (high - low)


def _smooth(field: Floats, std_px: float) -> Floats:
    """Return a field (H, W) smoothed by a Gaussian over its known places; NaN where it is not known."""
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(field)
    total = gaussian_filter(np.where(known, field, 0.0), std_px)
    return np.where(known, total / np.maximum(gaussian_filter(known.astype(float), std_px), TINY), np.nan)


@style.house_look
def draw_overlay(rgb: Bytes, height: HeightMap) -> Figure:
    """Draw the rectified frame (H, W, 3) with the contours of the depth, in mm."""
    figure, (axes,) = style.new_figure(*style.MAP_IN)
    overlay(axes, rgb, height=height, footprint=None)
    axes.set_title(titled(height, "frame and its depth"))
    return style.legend_below(figure)


@style.house_look
def draw_difference(first: HeightMap, second: HeightMap, *, title: str = "second minus first") -> Figure:
    """Draw second map minus first (H, W), in mm, on a scale symmetric about zero.

    Raises InputError for maps of different size or scale.
    """
    change = change_mm(first, second)
    limits = colour_limits(change, differs=True)
    figure, (axes,) = style.new_figure(*style.MAP_IN)
    image = style.show_map(axes, change, extent_mm(first), limits=limits, cmap="PuOr")
    style.colour_bar(axes, image, "change of depth (mm)")
    flagged = replace(second, flags=add(first.flags, second.flags))
    style.as_map(axes, title=titled(replace(flagged, name=""), title))
    _unknown_entry(axes, first.valid & second.valid)
    return style.legend_below(figure)


def change_mm(first: HeightMap, second: HeightMap) -> Floats:
    """Return second depth minus first (H, W), in mm; NaN where either is not known.

    Raises InputError for maps of different size or scale.
    """
    if first.depth_mm.shape != second.depth_mm.shape or not np.allclose(first.mm_per_px, second.mm_per_px):
        raise InputError(
            "a difference needs two maps of one size and scale",
            where=f"{second.name}, {first.name}",
            value=f"{_size_of(second)} and {_size_of(first)}",
        )
    return np.where(first.valid & second.valid, second.depth_mm - first.depth_mm, np.nan)


def _size_of(height: HeightMap) -> str:
    (rows, columns), (x, y) = height.depth_mm.shape, height.mm_per_px
    return f"{columns} x {rows} px of {x:g} x {y:g} mm"


def titled(height: HeightMap, what: str, *, between: str = "\n") -> str:
    """Return the title of a map (H, W), in mm: its name, `what` is shown, and, after `between`, its flags."""
    words = f"{height.name}: {what}" if height.name else what[:1].upper() + what[1:]
    if not height.flags:
        return words
    doubt = f"doubtful: {', '.join(height.flags)}"
    return words + between + (textwrap.fill(doubt, LINE) if "\n" in between else doubt)


def known_mm(height: HeightMap) -> Floats:
    """Return the depth (H, W) in mm, NaN where it is not known."""
    return np.where(height.valid, height.depth_mm, np.nan).astype(np.float64)


def depth_image(axes: Axes, height: HeightMap) -> AxesImage:
    """Draw the depth (H, W) in mm with contours; places of unknown depth are grey."""
    depth = known_mm(height)
    image = style.show_map(axes, depth, extent_mm(height), limits=colour_limits(depth))
    _contours(axes, height, 6, linewidths=0.5, alpha=LOOK.bar)
    _unknown_entry(axes, height.valid)
    scale_bar(axes, height)
    style.as_map(axes)
    return image


def colour_limits(shown_mm: Floats, *, differs: bool = False) -> tuple[float, float]:
    """Return bottom and top of the colours of a depth, or of a change of depth, (H, W) in mm with NaN."""
    known = shown_mm[np.isfinite(shown_mm)]
    if differs:
        limit = max(float(np.percentile(np.abs(known), style.SPAN[1])), MICRO) if known.size else MICRO
        return -limit, limit
    top = max(float(known.max()), MILLI) if known.size else MILLI
    return min(float(np.percentile(known, style.SPAN[0])), 0.0) if known.size else 0.0, top


def cut_lines(axes: Axes, height: HeightMap, *, row: int, column: int) -> None:
    """Draw depth (H, W), in mm, along x and y through one place, with its standard deviation where known."""
    cuts = (
        ("along x", style.BLUE, (row, slice(None)), height.mm_per_px[0]),
        ("along y", style.YELLOW, (slice(None), column), height.mm_per_px[1]),
    )
    for label, colour, where, scale in cuts:
        depth = np.where(height.valid[where], height.depth_mm[where], np.nan)
        place = np.arange(depth.size) * scale
        axes.plot(place, depth, color=colour, label=label)
        if height.std_mm is not None:
            std = height.std_mm[where]
            axes.fill_between(
                place, depth - std, depth + std, color=colour, alpha=LOOK.band, lw=0, label=f"std {label}"
            )
    style.zero_line(axes)
    axes.invert_yaxis()
    axes.set(xlabel="place (mm)", ylabel="depth into the gel (mm)", title="Cuts through the deepest place")


def _contours(axes: Axes, height: HeightMap, count: int, **look: Any) -> None:
    """Draw so many contours of the depth, none at 0, which would trace the noise."""
    top = float(np.max(height.depth_mm, where=height.valid, initial=0.0))
    if top > FLAT_MM:
        levels = np.linspace(0, top, count + 2)[1:-1]
        axes.contour(known_mm(height), levels, colors="white", extent=extent_mm(height), origin="upper", **look)
        style.outlined_entry(axes, "contours of the depth")


def _lit(down_x: Floats, down_y: Floats) -> Floats:
    """Return the brightness (H, W), 0 to 1, of a matt surface under a lamp at 45 degrees above left."""
    lamp = np.array([-0.5, -0.5, np.sqrt(0.5)])
    light = (lamp[0] * down_x + lamp[1] * down_y + lamp[2]) / np.sqrt(1 + down_x**2 + down_y**2)
    return np.asarray(np.clip(light, 0, 1))


def overlay(axes: Axes, rgb: Bytes, *, height: HeightMap, footprint: Footprint | None) -> None:
    """Draw a frame (H, W, 3), the contours of its depth, and the circle of the indenter's face, in mm."""
    axes.imshow(rgb, extent=extent_mm(height))
    _contours(axes, height, 3, linewidths=LOOK.line)
    if footprint is not None:
        (middle_x, middle_y), (x, y), turn = centre_mm(height), footprint.centre_mm, np.linspace(0, 2 * np.pi, 200)
        across, along = footprint.radius_mm * np.cos(turn), footprint.radius_mm * np.sin(turn)
        axes.plot(middle_x + x + across, middle_y + y + along, color=style.YELLOW, label="punch face")
    style.as_map(axes)


def _unknown_entry(axes: Axes, known: Bools) -> None:
    """Add a legend entry for grey pixels (H, W), where there are any."""
    if not known.all():
        style.unknown_entry(axes)


def scale_bar(axes: Axes, height: HeightMap, *, colour: str = "white") -> None:
    """Draw a bar of a round length in mm, in the lower left of a map (H, W)."""
    from matplotlib.patheffects import withStroke

    width = height.depth_mm.shape[1] * height.mm_per_px[0]
    tall = height.depth_mm.shape[0] * height.mm_per_px[1]
    length = max((b for b in (0.5, 1, 2, 5, 10, 20, 50) if b <= width / 4), default=width / 4)
    x, y = width / 25, tall * 24 / 25
    rim = [withStroke(linewidth=2, foreground="black")] if colour == "white" else []  # seen where all is grey
    axes.plot([x, x + length], [y, y], color=colour, lw=3, solid_capstyle="butt")
    words: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": LOOK.small, "path_effects": rim}
    axes.text(x + length / 2, y - tall / 50, f"{length:g} mm", color=colour, **words)


def extent_mm(height: HeightMap) -> style.Extent:
    """Return left, right, bottom, top of the picture (H, W) in mm, with the first pixel's centre at (0, 0)."""
    rows, columns = height.depth_mm.shape
    sx, sy = height.mm_per_px
    return (-0.5 * sx, (columns - 0.5) * sx, (rows - 0.5) * sy, -0.5 * sy)


def centre_mm(height: HeightMap) -> Pair:
    """Return the place (x, y) of the pad's centre in the picture, mm."""
    rows, columns = height.depth_mm.shape
    return (columns - 1) / 2 * height.mm_per_px[0], (rows - 1) / 2 * height.mm_per_px[1]


def deepest_place(height: HeightMap) -> tuple[int, int]:
    """Return row and column, in px, of the middle of the deepest tenth of a map (H, W)."""
    depth: Floats = np.where(height.valid, height.depth_mm, -np.inf).astype(np.float64)
    top = depth.max()
    if not np.isfinite(top):
        return depth.shape[0] // 2, depth.shape[1] // 2
    rows, columns = np.nonzero(10 * depth >= 9 * top) if top > 0 else np.nonzero(depth == top)
    return int(np.median(rows)), int(np.median(columns))


# The terms of a depth's deviation.

Terms = Mapping[str, npt.NDArray[np.floating[Any]]]
COLOURS = (*style.CYCLE, "#F2D54B", "#4B3A1D", "#8C2D5A", "#101010")  # in the order of the terms
DEEP = 0.5  # of the greatest depth: what counts as contact for the bars


@style.house_look
def draw_terms(height: HeightMap, terms: Terms) -> Figure:
    """Draw the term (h, w) that dominates at each place, and the rms of each term in the contact and elsewhere.

    `terms` are deviations in mm by name, on a grid over the map's picture (Reading.terms_mm).
    """
    figure, (above, bars) = style.new_figure(rows=2, height_in=8)
    entries = _draw_largest(above, height, terms)
    above.set_title(titled(height, "largest part of the depth's deviation"))
    _draw_bars(bars, height, terms)
    figure.legend(handles=entries, loc="outside lower center", ncols=2)
    return figure


def _draw_largest(axes: Axes, height: HeightMap, terms: Terms) -> list[Artist]:
    """Colour each place by its largest term, and return the legend's entries."""
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    largest = np.argmax(np.stack(list(terms.values())), axis=0)
    known = _on_grid(height.valid, largest.shape)
    colours, limits = ListedColormap(COLOURS[: len(terms)]), (-0.5, len(terms) - 0.5)
    style.show_map(axes, np.where(known, largest, np.nan), extent_mm(height), limits=limits, cmap=colours)
    shares = np.bincount(largest[known], minlength=len(terms)) / float(max(int(known.sum()), 1))
    entries: list[Artist] = [
        Patch(color=colour, label=f"{name}: {100 * share:.0f} % of the picture")
        for name, colour, share in zip(terms, COLOURS, shares, strict=False)
        if round(100 * share)
    ]
    if not known.all():
        entries.append(Patch(color=style.INVALID, label="depth not known"))
    top = float(np.max(height.depth_mm, where=height.valid, initial=0.0))
    if top > 0:
        depth, extent = known_mm(height), extent_mm(height)
        axes.contour(depth, [DEEP * top], colors="black", linewidths=LOOK.line, extent=extent, origin="upper")
        entries.append(Line2D([], [], color="black", lw=LOOK.line, label="half of the greatest depth"))
    scale_bar(axes, height, colour="black")
    style.as_map(axes)
    return entries


def _draw_bars(axes: Axes, height: HeightMap, terms: Terms) -> None:
    from matplotlib.patches import Patch

    shape = next(iter(terms.values())).shape
    depth, known = _on_grid(height.depth_mm, shape), _on_grid(height.valid, shape)
    contact = known & (depth > DEEP * float(np.max(depth, where=known, initial=0.0)))
    places, colours = np.arange(len(terms)), COLOURS[: len(terms)]
    wide = LOOK.faint
    for offset, where, alpha in ((-wide / 2, contact, 1.0), (wide / 2, known & ~contact, LOOK.faint)):
        rms_um = [KILO * _rms(term, where) for term in terms.values()]
        axes.barh(places + offset, rms_um, height=wide, color=colours, alpha=alpha)
    axes.set_yticks(places, list(terms))
    axes.invert_yaxis()
    axes.set(xlabel="rms deviation of depth (µm)", title="Contribution of each term")
    axes.grid(axis="y", visible=False)
    axes.legend(
        handles=[
            Patch(color=style.GREY, label="deeper than half of the greatest depth"),
            Patch(color=style.GREY, alpha=LOOK.faint, label="elsewhere"),
        ],
        loc="upper right",
        bbox_to_anchor=(1, -LOOK.band),
    )


def _rms(term: npt.NDArray[np.floating[Any]], where: Bools) -> float:
    return float(np.sqrt(np.mean(np.square(term[where])))) if where.any() else 0.0


def _on_grid(field: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return the field (H, W) at the points of a coarser grid (h, w) over the same picture."""
    rows, columns = (
        np.minimum(np.arange(few) * -(-many // few), many - 1)
        for few, many in zip(shape, field.shape, strict=True)
    )
    return np.asarray(field[np.ix_(rows, columns)])
