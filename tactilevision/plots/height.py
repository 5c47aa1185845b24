"""Plot height maps: from above, in section, in perspective, and the terms of their deviation."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.plots import style
from tactilevision.records.maps import Footprint, HeightMap, add
from tactilevision.records.measured import Bools, Bytes, Floats

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


# Pictures of a height map: from above, cut, in perspective, and laid over the frame it came from.

LINE = 40  # characters of a title beside another picture's


@style.house_look
def draw_height(height: HeightMap, *, title: str = "") -> Figure:
    """The map (H, W), in mm, from above with contours and bars, and two cuts through its deepest place."""
    figure, axes = style.new_figure(style.WIDTH_IN, 3.4, columns=2)
    above, cuts = axes
    image = depth_image(above, height)
    figure.colorbar(image, ax=above, label="depth into the gel (mm)", shrink=0.85)
    above.set_title(titled(height, title or _named(height, "depth of the gel's surface"), between="\n"))
    row, column = deepest_place(height)
    cut_lines(cuts, height, row=row, column=column)
    _mark_cuts(above, height, row, column)
    style.legend_below(figure)
    return figure


@style.house_look
def draw_height_and_frame(rgb: Bytes, height: HeightMap, *, title: str = "") -> Figure:
    """The rectified frame (H, W, 3) with the depth's contours, the depth in mm from above, and two cuts."""
    figure, (frame, above, cuts, corner) = style.new_figure(style.WIDTH_IN, 5.6, rows=2, columns=2)
    overlay(frame, rgb, height=height, footprint=None)
    frame.set_title(titled(height, title or _named(height, "frame"), between="\n"))
    image = depth_image(above, height)
    figure.colorbar(image, ax=above, label="depth into the gel (mm)", shrink=0.85)
    row, column = deepest_place(height)
    cut_lines(cuts, height, row=row, column=column)
    _mark_cuts(above, height, row, column)
    above.set_title("Depth of the gel's surface")
    style.legend_below(figure, corner=corner)
    return figure


@style.house_look
def draw_normals(height: HeightMap, *, title: str = "") -> Figure:
    """Which way the surface (H, W) faces: its tilt in degrees, arrows towards the depth; lit from above left."""
    figure, (tilt, lit) = style.new_figure(style.WIDTH_IN, 3.2, columns=2)
    depth = np.where(height.valid, height.depth_mm, np.nan)
    down_x, down_y = (
        np.gradient(depth, height.mm_per_px[0], axis=1),
        np.gradient(depth, height.mm_per_px[1], axis=0),
    )
    steep = np.hypot(down_x, down_y)
    degrees = np.degrees(np.arctan(steep))
    top = max(float(np.nanpercentile(degrees, 99.8)), 1.0) if np.isfinite(degrees).any() else 1.0
    image = tilt.imshow(
        degrees, cmap=style.DEPTH_MAP, vmin=0, vmax=top, extent=extent_mm(height), interpolation="none"
    )
    figure.colorbar(image, ax=tilt, label="tilt (degrees)", shrink=0.85)
    _draw_arrows(tilt, height, (down_x, down_y))
    lit.imshow(_lit(down_x, down_y), cmap="gray", vmin=0, vmax=1, extent=extent_mm(height), interpolation="none")
    scale_bar(lit, height, colour="black")
    for axes, words in (
        (tilt, titled(height, title or _named(height, "tilt, arrows point deeper"), between="\n")),
        (lit, "Lit from above left"),
    ):
        axes.set_facecolor(style.INVALID)
        axes.grid(False)
        axes.set(xlabel="x (mm)", ylabel="y (mm)", title=words)
    _unknown_entry(tilt, height.valid)
    style.legend_below(figure)
    return figure


def _draw_arrows(axes: Axes, height: HeightMap, slopes: tuple[Floats, Floats]) -> None:
    """Arrows down the `slopes` (H, W) mm/mm along x and y, where they are a tenth of the greatest at least."""
    steep = np.hypot(*slopes)
    step = max(1, max(steep.shape) // 28)
    rows, columns = (np.arange(step // 2, n, step) for n in steep.shape)
    some = np.ix_(rows, columns)
    far = np.maximum(steep[some], 1e-9)
    strong = steep[some] > np.nanmax(steep, initial=0.0) / 10
    x, y = np.meshgrid(columns * height.mm_per_px[0], rows * height.mm_per_px[1])
    arrow = [np.where(strong, down[some] / far, 0)[strong] for down in slopes]  # their colour says how steep
    size = 1.4 * step * min(height.mm_per_px)
    axes.quiver(
        x[strong], y[strong], *arrow, color="white", angles="xy", scale_units="xy", scale=1 / size, width=0.003
    )


@style.house_look
def draw_surface(height: HeightMap, *, title: str = "") -> Figure:
    """The surface (H, W), in mm, in perspective, depth downwards.

    The vertical scale is exaggerated and says by how much.
    """
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D

    figure = Figure(figsize=(7.5, 5.5))
    axes = Axes3D(figure, rect=(0.0, 0.0, 1.0, 0.93))  # above it is room for the title
    figure.add_axes(axes)
    step = max(1, max(height.depth_mm.shape) // 160)
    depth = np.where(height.valid, height.depth_mm, np.nan)[::step, ::step]
    x, y = np.meshgrid(
        *(np.arange(n) * step * s for n, s in zip(depth.shape[::-1], height.mm_per_px, strict=True))
    )
    axes.plot_surface(x, y, depth, cmap=style.DEPTH_MAP, rstride=1, cstride=1, linewidth=0, antialiased=False)
    span = max(float(np.nanmax(depth) - np.nanmin(depth)), 1e-3) if np.isfinite(depth).any() else 1.0
    axes.set_box_aspect((float(np.ptp(x)), float(np.ptp(y)), 0.25 * float(np.ptp(x))))
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="depth (mm)")
    axes.locator_params(axis="z", nbins=3)  # the box is low: more would overlap
    axes.invert_zaxis()
    axes.invert_yaxis()
    words = titled(height, title or _named(height, "surface"))
    axes.set_title(f"{words}   vertical scale × {0.25 * float(np.ptp(x)) / span:.0f}", loc="left", fontsize=10)
    axes.view_init(elev=48, azim=-62)
    return figure


@style.house_look
def draw_overlay(rgb: Bytes, height: HeightMap, *, footprint: Footprint | None, title: str = "") -> Figure:
    """The rectified frame (H, W, 3) with the contours of the depth, in mm, and the indenter's circle on it."""
    figure, (axes,) = style.new_figure(5.6, 4.2)
    overlay(axes, rgb, height=height, footprint=footprint)
    axes.set_title(titled(height, title or _named(height, "frame and its depth"), between="\n"))
    style.legend_below(figure)
    return figure


@style.house_look
def draw_difference(first: HeightMap, second: HeightMap, *, title: str = "second minus first") -> Figure:
    """Second map minus first (H, W), in mm, on a scale that is symmetric about no change.

    Raises InputError for maps of two sizes or two scales.
    """
    change = change_mm(first, second)
    limit = max(float(np.nanpercentile(np.abs(change), 99.5)), 1e-6) if np.isfinite(change).any() else 1e-6
    figure, (axes,) = style.new_figure(6.2, 4.2)
    axes.set_facecolor(style.INVALID)
    image = axes.imshow(
        change, cmap="PuOr", vmin=-limit, vmax=limit, extent=extent_mm(first), interpolation="none"
    )
    figure.colorbar(image, ax=axes, label="change of depth (mm)", shrink=0.85)
    axes.set_title(titled(replace(second, flags=add(first.flags, second.flags)), title, between="\n"))
    axes.grid(False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    _unknown_entry(axes, first.valid & second.valid)
    style.legend_below(figure)
    return figure


def change_mm(first: HeightMap, second: HeightMap) -> Floats:
    """Second depth minus first (H, W), in mm; NaN where either is not known.

    Raises InputError for maps of two sizes or two scales.
    """
    if first.depth_mm.shape != second.depth_mm.shape or not np.allclose(first.mm_per_px, second.mm_per_px):
        raise InputError(
            "only maps of one size and scale have a difference",
            where=f"{second.name}, {first.name}",
            value=f"{_size_of(second)} and {_size_of(first)}",
        )
    return np.where(first.valid & second.valid, second.depth_mm - first.depth_mm, np.nan)


def _named(height: HeightMap, what: str) -> str:
    return f"{height.name}: {what}" if height.name else what[0].upper() + what[1:]


def _size_of(height: HeightMap) -> str:
    (rows, columns), (x, y) = height.depth_mm.shape, height.mm_per_px
    return f"{columns} x {rows} px of {x:g} x {y:g} mm"


def titled(height: HeightMap, words: str, *, between: str = " · ") -> str:
    """A picture's title with what makes its map (H, W) doubtful, so that no picture of it goes without.

    `between` is a line's end where another picture stands beside it.
    """
    if not height.flags:
        return words
    doubt = f"doubtful: {', '.join(height.flags)}"
    return words + between + (textwrap.fill(doubt, LINE) if "\n" in between else doubt)


def depth_image(axes: Axes, height: HeightMap) -> AxesImage:
    """Draw the depth (H, W) in mm with contours; places of unknown depth are grey."""
    import matplotlib as mpl

    depth = np.where(height.valid, height.depth_mm, np.nan)
    axes.set_facecolor(style.INVALID)
    top = max(float(np.nanmax(depth)), 1e-3) if np.isfinite(depth).any() else 1e-3
    bottom = min(float(np.nanpercentile(depth, 0.5)), 0.0) if np.isfinite(depth).any() else 0.0
    image = axes.imshow(
        depth,
        cmap=mpl.colormaps[style.DEPTH_MAP],
        vmin=bottom,
        vmax=top,
        extent=extent_mm(height),
        interpolation="none",
    )
    if top - bottom > 0.02:
        axes.contour(
            np.ma.masked_where(~height.valid, height.depth_mm),
            levels=np.linspace(0, top, 8)[1:-1],  # at 0 it would trace the noise
            colors="white",
            linewidths=0.5,
            alpha=0.6,
            extent=extent_mm(height),
            origin="upper",
        )
        _contour_entry(axes)
    _unknown_entry(axes, height.valid)
    scale_bar(axes, height)
    axes.grid(False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    return image


def cut_lines(axes: Axes, height: HeightMap, *, row: int, column: int) -> None:
    """Depth (H, W), in mm, along x and along y through one place; its standard deviation as a band where known."""
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
            axes.fill_between(place, depth - std, depth + std, color=colour, alpha=0.2, lw=0, label=f"std {label}")
    axes.axhline(0, color=style.GREY, lw=0.8)
    axes.invert_yaxis()
    axes.set(xlabel="place (mm)", ylabel="depth into the gel (mm)", title="Cuts through the deepest place")


def _mark_cuts(axes: Axes, height: HeightMap, row: int, column: int) -> None:
    """Where the cuts run, with an entry for the legend that white paper does not hide."""
    from matplotlib.patheffects import withStroke

    edge = [withStroke(linewidth=3.0, foreground=style.GREY)]
    axes.plot([], [], color="white", lw=1.0, ls=":", path_effects=edge, label="the cuts")
    axes.axhline(row * height.mm_per_px[1], color="white", lw=0.6, ls=":")
    axes.axvline(column * height.mm_per_px[0], color="white", lw=0.6, ls=":")


def _lit(down_x: Floats, down_y: Floats) -> Floats:
    """Brightness (H, W), 0 to 1, of a matt surface under a lamp that stands at 45 degrees above left."""
    lamp = np.array([-0.5, -0.5, np.sqrt(0.5)])
    light = (lamp[0] * down_x + lamp[1] * down_y + lamp[2]) / np.sqrt(1 + down_x**2 + down_y**2)
    return np.asarray(np.clip(light, 0, 1))


def overlay(axes: Axes, rgb: Bytes, *, height: HeightMap, footprint: Footprint | None) -> None:
    """Draw a frame (H, W, 3), the contours of its depth, and the circle of the indenter's face, in mm."""
    extent = extent_mm(height)
    axes.imshow(rgb, extent=extent)
    top = float(np.nanmax(np.where(height.valid, height.depth_mm, np.nan))) if height.valid.any() else 0.0
    if top > 0.02:
        levels = np.array([0.25, 0.5, 0.75]) * top
        depth = np.ma.masked_where(~height.valid, height.depth_mm)
        axes.contour(depth, levels=levels, colors="white", linewidths=0.7, extent=extent, origin="upper")
        _contour_entry(axes)
    if footprint is not None:
        middle = ((height.depth_mm.shape[1] - 1) / 2, (height.depth_mm.shape[0] - 1) / 2)
        turn = np.linspace(0, 2 * np.pi, 200)
        x = footprint.centre_mm[0] + middle[0] * height.mm_per_px[0] + footprint.radius_mm * np.cos(turn)
        y = footprint.centre_mm[1] + middle[1] * height.mm_per_px[1] + footprint.radius_mm * np.sin(turn)
        axes.plot(x, y, color=style.YELLOW, lw=1.8, label="punch face")
    axes.grid(False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")


def _unknown_entry(axes: Axes, known: Bools) -> None:
    """What the legend says of grey pixels (H, W), where there are any."""
    if not known.all():
        axes.plot([], [], "s", color=style.INVALID, mec=style.GREY, label="depth not known")


def _contour_entry(axes: Axes) -> None:
    """What the legend says of white lines, which white paper would hide."""
    from matplotlib.patheffects import withStroke

    edge = [withStroke(linewidth=3.0, foreground=style.GREY)]
    axes.plot([], [], color="white", lw=1.4, path_effects=edge, label="contours of the depth")


def scale_bar(axes: Axes, height: HeightMap, *, colour: str = "white") -> None:
    """A bar of a round length in mm, in the lower left of a map (H, W)."""
    width = height.depth_mm.shape[1] * height.mm_per_px[0]
    tall = height.depth_mm.shape[0] * height.mm_per_px[1]
    length = max((b for b in (0.5, 1, 2, 5, 10, 20, 50) if b <= width / 4), default=width / 4)
    x, y = 0.04 * width, 0.94 * tall
    from matplotlib.patheffects import withStroke

    rim = [withStroke(linewidth=2.0, foreground="black")] if colour == "white" else []  # seen where all is grey
    axes.plot([x, x + length], [y, y], color=colour, lw=3, solid_capstyle="butt")
    axes.text(
        x + length / 2,
        y - 0.02 * tall,
        f"{length:g} mm",
        color=colour,
        ha="center",
        va="bottom",
        fontsize=9,
        path_effects=rim,
    )


def extent_mm(height: HeightMap) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the picture (H, W) in mm, pixel centres at whole steps from the first."""
    rows, columns = height.depth_mm.shape
    sx, sy = height.mm_per_px
    return (-0.5 * sx, (columns - 0.5) * sx, (rows - 0.5) * sy, -0.5 * sy)


def deepest_place(height: HeightMap) -> tuple[int, int]:
    """Row and column, in px, of the middle of the deepest tenth of a map (H, W).

    Steadier than the single deepest pixel.
    """
    depth: Floats = np.where(height.valid, height.depth_mm, -np.inf).astype(np.float64)
    top = depth.max()
    if not np.isfinite(top):
        return depth.shape[0] // 2, depth.shape[1] // 2
    rows, columns = np.nonzero(depth >= 0.9 * top) if top > 0 else np.nonzero(depth == top)
    return int(np.median(rows)), int(np.median(columns))


# Which term of a depth's deviation is the largest, place by place, and how much each of them adds.

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

    `terms` are deviations in mm by name, on a grid over the map's picture (Reading.terms_mm).
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
