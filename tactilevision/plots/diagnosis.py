"""Figures of a diagnosis: offsets of presses, residuals with and without an effect, confusable effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.misfit import LEFT, label_covariate
from tactilevision.plots.style import LOOK
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.misfit import Strip

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Offsets:
    """Each press's own depth zero in the order of pressing: label, offset in um, and whether it is an outlier.

    `since` is the place from which the presses are different, None where there is none.
    """

    labels: tuple[str, ...]
    offset_um: Floats
    odd: tuple[bool, ...]
    since: int | None


@dataclass(frozen=True, slots=True)
class Sighting:
    """Samples (N,): reconstructed over certified depth, also `corrected` (None: no correction was found).

    `face` is True for punch faces and False for the slopes outside them; `against` holds the abscissae by label,
    (N,) each, NaN where a sample has none.
    """

    ratio: Floats
    corrected: Floats | None
    face: Bools
    against: tuple[tuple[str, Floats], ...]


@style.house_look
def draw_offsets(shown: Offsets) -> Figure:
    """Draw each press's own offset in order; outliers are orange and named."""
    figure, (axes,) = style.new_figure()
    labels = [style.as_label(label) for label in shown.labels]
    odd, place = np.array(shown.odd), np.arange(len(shown.labels))
    axes.vlines(place, 0, shown.offset_um, color=np.where(odd, style.ORANGE, style.BLUE), lw=LOOK.line)
    axes.plot(place[~odd], shown.offset_um[~odd], "o", color=style.BLUE, label="like the others")
    axes.plot(place[odd], shown.offset_um[odd], "o", ms=8, color=style.ORANGE, label="unlike the others")
    bold: dict[str, Any] = {"color": style.ORANGE, "weight": "bold", "va": "center"}
    for k in place[odd]:
        axes.annotate(labels[k], (k, shown.offset_um[k]), xytext=(7, 0), textcoords="offset points", **bold)
    if shown.since is not None:
        axes.axvline(shown.since - 0.5, color=style.ORANGE, ls="--", lw=LOOK.line)
        words, above = f" since {labels[shown.since]}", axes.get_xaxis_transform()
        axes.text(shown.since - 0.5, 1, words, color=style.ORANGE, va="top", transform=above)
    style.zero_line(axes)
    step = -(-len(place) // 20)
    axes.set_xticks(place[::step], labels[::step], rotation=45, ha="right")
    axes.margins(y=LOOK.room)
    axes.set(xlabel="press, in order", ylabel="own offset of depth (µm)", title="Each press's own offset")
    return style.legend_below(figure)


@style.house_look
def draw_pad(place_mm: Floats, stiffer: Floats, labels: Sequence[str], named: Bools) -> Figure:
    """Draw the presses (M,) at their places (M, 2), coloured by relative stiffness; `named` ones by label."""
    figure, (axes,) = style.new_figure()
    most = 100 * float(np.max(np.abs(stiffer)))
    ring = [style.ORANGE if one else style.GREY for one in named]
    colours: dict[str, Any] = {"c": 100 * stiffer, "cmap": "RdBu_r", "vmin": -most, "vmax": most}
    dots = axes.scatter(place_mm[:, 0], place_mm[:, 1], s=160, edgecolors=ring, linewidths=2, **colours)
    beyond: dict[str, Any] = {"xytext": (9, 9), "textcoords": "offset points", "color": style.ORANGE}
    for x, y in np.unique(place_mm[named], axis=0).tolist():
        here = np.flatnonzero(named & (place_mm == (x, y)).all(axis=1)).tolist()
        axes.annotate(", ".join(style.as_label(labels[k]) for k in here), (x, y), **beyond)
    style.colour_bar(axes, dots, "stiffness over the mean (%)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(LOOK.room)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", title="Stiffness over the pad")
    return figure


@style.house_look
def draw_confusability(keys: Sequence[str], separation: Floats) -> Figure:
    """Draw the separation (effects, effects), in std, of the row's effect from the best fit of the column's.

    Below 3 they cannot be distinguished.
    """
    side_in = min(2 + 0.75 * len(keys), style.WIDTH_IN - 1)  # of the matrix with its labels
    figure, (axes,) = style.new_figure(width_in=side_in + 1, height_in=side_in)
    image = axes.imshow(np.minimum(separation, 9), cmap="cividis_r", vmin=0, vmax=9)
    for (row, column), value in np.ndenumerate(separation):
        text = "–" if row == column else f"{value:.1f}"
        ink = "white" if 2 * value > 9 else "black"
        axes.text(column, row, text, ha="center", va="center", fontsize=LOOK.small, color=ink)
    names = [key.replace("_", " ") for key in keys]
    axes.set_xticks(range(len(keys)), names, rotation=35, ha="right")
    axes.set_yticks(range(len(keys)), names)
    style.as_map(axes, "fitted effect", "true effect", "Can these data distinguish them?")
    style.colour_bar(axes, image, "separation (std), capped at 9")
    return figure


@style.house_look
def draw_overlay(strip: Strip, name: str) -> Figure:
    """Draw the residual without the effect of this name and with it, and what it alone explains as a line.

    These three are the rows (3, k) of the strip's means, N.
    """
    figure, (axes,) = style.new_figure(width_in=style.MAP_IN[0])
    order = np.argsort(strip.centre)
    explained_mN = KILO * strip.mean_N[2][order]
    axes.plot(strip.centre[order], explained_mN, color="black", lw=LOOK.line, label=f"what {name} explains")
    rows = ((style.ORANGE, "residual without it, and 95 %"), (style.BLUE, f"residual with {name}, and 95 %"))
    for mean, reach, (colour, label) in zip(strip.mean_N, strip.reach95_N, rows, strict=False):
        axes.errorbar(strip.centre, KILO * mean, yerr=KILO * reach, fmt="o", color=colour, label=label)
    style.zero_line(axes)
    label_covariate(axes, strip.words, strip.unit, levels=strip.levels, values=strip.centre)
    axes.set_ylabel(LEFT)
    return style.legend_below(figure, columns=1)


@style.house_look
def draw_sighting(seen: Sighting) -> Figure:
    """Draw reconstructed over certified depth against each quantity that it may depend on."""
    columns = min(2, len(seen.against))
    figure, places = style.new_figure(rows=-(-len(seen.against) // columns), columns=columns)
    shown = [(seen.ratio, style.ORANGE, "as read")]
    if seen.corrected is not None:
        shown.append((seen.corrected, style.BLUE, "corrected"))
    low, high = np.percentile(np.concatenate([ratio for ratio, *_ in shown]), style.SPAN)
    limits = (min(low, 1) - LOOK.room / 3, max(high, 1) + LOOK.room / 3)
    for axes, (label, values) in zip(places, seen.against, strict=False):
        across = np.ptp(values[np.isfinite(values)]) if np.isfinite(values).any() else 0.0
        for place, (ratio, colour, name) in enumerate(shown):  # side by side, so that neither hides the other
            aside = across / 120 * (2 * place - 1) if len(shown) > 1 else 0.0
            for mine, mark, what in ((seen.face, "s", "punch faces"), (~seen.face, ".", "slopes outside them")):
                if mine.any():
                    face, words = "none" if mark == "s" else colour, f"{what}, {name}"
                    axes.plot(values[mine] + aside, ratio[mine], mark, color=colour, mfc=face, label=words)
        style.zero_line(axes, 1)
        axes.set(xlabel=label, ylabel="read / certified depth", ylim=limits)
    for axes in places[len(seen.against) :]:
        axes.set_axis_off()
    return style.legend_below(figure, columns=2)


@style.house_look
def draw_residual_map(residual_mm: Floats, axis: Floats, *, count: int) -> Figure:
    """Draw the mean residual height map (n, n), in mm, about the punch's axis; grey where nothing is compared."""
    figure, (axes,) = style.new_figure(*style.MAP_IN)
    residual_um = KILO * residual_mm
    reach = float(np.nanpercentile(np.abs(residual_um), 98))
    image = axes.pcolormesh(axis, axis, residual_um, cmap="RdBu_r", vmin=-reach, vmax=reach, shading="nearest")
    axes.invert_yaxis()
    axes.set_aspect("equal")
    style.unknown_entry(axes, "not compared")
    style.legend_below(figure)
    title = f"measured − expected, mean of {count} presses"
    style.as_map(axes, "x (punch radii)", "y (punch radii)", title)
    style.colour_bar(axes, image, "depth (µm)")
    return figure
