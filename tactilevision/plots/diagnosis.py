"""Pictures of a diagnosis: presses that stand out, what a candidate would leave, what looks like what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.misfit import LEFT, label_covariate
from tactilevision.records.measured import Bools, Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ASIDE = 0.008  # of an axis: as read lies left and corrected right of its place, so that neither hides the other


@dataclass(frozen=True, slots=True)
class Offsets:
    """Each press's own depth zero in the order of pressing: its label, its offset in um, and whether it is odd;
    `since` the place from which the presses are different, None where there is none.
    """

    labels: tuple[str, ...]
    offset_um: Floats
    odd: tuple[bool, ...]
    since: int | None


@dataclass(frozen=True, slots=True)
class Overlay:
    """What is left of the force against one covariate in k bins, N: without an effect and with it.

    (k,) each, with the 95 % interval's half width, and what the effect alone would leave there; `words` of the
    covariate, `levels` where it only counts.
    """

    words: str
    unit: str
    levels: tuple[str, ...]
    key: str
    values: Floats
    before: Floats
    before_reach: Floats
    after: Floats
    after_reach: Floats
    predicted: Floats


@dataclass(frozen=True, slots=True)
class Sighting:
    """Of each sample (N,): seen over certified depth, as read and corrected by what was found (None: nothing was),
    and whether it is a face (or a slope beside one); `against` what it is drawn, by its label (N,), NaN where a
    sample has none.
    """

    ratio: Floats
    corrected: Floats | None
    face: Bools
    against: tuple[tuple[str, Floats], ...]


@style.house_look
def draw_offsets(shown: Offsets) -> Figure:
    """Each press's own offset in order; what cannot belong to the others in orange, with its name."""
    figure, (axes,) = style.new_figure(style.WIDTH_IN, 3.6)
    labels = [style.as_label(label) for label in shown.labels]
    odd, place = np.array(shown.odd), np.arange(len(shown.labels))
    axes.vlines(place, 0, shown.offset_um, color=np.where(odd, style.ORANGE, style.BLUE), lw=1.2)
    axes.plot(place[~odd], shown.offset_um[~odd], "o", ms=5, color=style.BLUE, label="like the others")
    axes.plot(place[odd], shown.offset_um[odd], "o", ms=8, color=style.ORANGE, label="cannot be one of them")
    for k in place[odd]:
        axes.annotate(
            labels[k],
            (k, shown.offset_um[k]),
            xytext=(7, 0),
            textcoords="offset points",
            color=style.ORANGE,
            weight="bold",
            va="center",
        )
    if shown.since is not None:
        axes.axvline(shown.since - 0.5, color=style.ORANGE, ls="--", lw=1.2)
        axes.text(
            shown.since - 0.4,
            0.97,
            f"since {labels[shown.since]}",
            color=style.ORANGE,
            va="top",
            transform=axes.get_xaxis_transform(),
        )
    axes.axhline(0, color=style.GREY, lw=0.8)
    step = -(-len(place) // 20)
    axes.set_xticks(place[::step], labels[::step], rotation=45, ha="right")
    axes.margins(y=0.15)
    axes.set(xlabel="press, in order", ylabel="own offset of depth (µm)", title="Each press's own offset")
    style.legend_below(figure)
    return figure


@style.house_look
def draw_confusability(keys: Sequence[str], separation: Floats) -> Figure:
    """How many std (effects, effects) part the row's effect from the best the column's can do instead.

    Below 3 they look alike.
    """
    size = min(1.8 + 0.75 * len(keys), style.WIDTH_IN - 1.2)
    figure, (axes,) = style.new_figure(size + 1.2, size)
    image = axes.imshow(np.minimum(separation, 9), cmap="cividis_r", vmin=0, vmax=9)
    for (row, column), value in np.ndenumerate(separation):
        text = "–" if row == column else f"{value:.1f}"
        axes.text(
            column, row, text, ha="center", va="center", fontsize=9, color="white" if value > 4.5 else "black"
        )
    names = [key.replace("_", " ") for key in keys]
    axes.set_xticks(range(len(keys)), names, rotation=35, ha="right")
    axes.set_yticks(range(len(keys)), names)
    axes.grid(False)
    figure.colorbar(image, ax=axes, label="separation (std), capped at 9", shrink=0.8)
    axes.set(
        title="Can these data tell them apart?", ylabel="if this one is there", xlabel="could this one pass for it"
    )
    return figure


@style.house_look
def draw_overlay(overlay: Overlay) -> Figure:
    """What is left without an effect and with it, and what the effect alone would leave, as a line."""
    figure, (axes,) = style.new_figure(5.2, 3.6)
    order, name = np.argsort(overlay.values), overlay.key.replace("_", " ")
    axes.plot(
        overlay.values[order],
        1e3 * overlay.predicted[order],
        "-",
        color="black",
        lw=1.2,
        label=f"what {name} explains",
    )
    for values, reach, colour, label in (
        (overlay.before, overlay.before_reach, style.ORANGE, "left without it, and 95 %"),
        (overlay.after, overlay.after_reach, style.BLUE, f"left with {name}, and 95 %"),
    ):
        axes.errorbar(overlay.values, 1e3 * values, yerr=1e3 * reach, fmt="o", ms=4.5, color=colour, label=label)
    axes.axhline(0, color=style.GREY, lw=0.8)
    label_covariate(axes, overlay.words, overlay.unit, levels=overlay.levels, values=overlay.values)
    axes.set_ylabel(LEFT)
    style.legend_below(figure, columns=1)
    return figure


@style.house_look
def draw_sighting(seen: Sighting) -> Figure:
    """Reconstructed over certified depth, against each thing that may show what is wrong with it."""
    columns = min(2, len(seen.against))
    rows = -(-len(seen.against) // columns)
    figure, places = style.new_figure(style.WIDTH_IN, 0.5 + 2.4 * rows, rows=rows, columns=columns)
    shown = [(seen.ratio, style.ORANGE, "as read")]
    if seen.corrected is not None:
        shown.append((seen.corrected, style.BLUE, "corrected"))
    every = np.concatenate([ratio for ratio, *_ in shown])
    low, high = min(float(np.quantile(every, 0.005)), 1.0), max(float(np.quantile(every, 0.995)), 1.0)
    for axes, (label, values) in zip(places, seen.against, strict=False):
        across = np.ptp(values[np.isfinite(values)]) if np.isfinite(values).any() else 0.0
        for place, (ratio, colour, name) in enumerate(shown):
            aside = ASIDE * across * (2 * place - 1) if len(shown) > 1 else 0.0
            for mine, mark, what in ((seen.face, "s", "punch faces"), (~seen.face, ".", "slopes beside them")):
                if mine.any():
                    axes.plot(
                        values[mine] + aside,
                        ratio[mine],
                        mark,
                        ms=4,
                        color=colour,
                        mfc="none" if mark == "s" else colour,
                        alpha=0.8,
                        label=f"{what}, {name}",
                    )
        axes.axhline(1, color=style.GREY, lw=0.8)
        axes.set(xlabel=label, ylabel="read / certified depth", ylim=(low - 0.05, high + 0.05))
    for axes in places[len(seen.against) :]:
        axes.set_axis_off()
    style.legend_below(figure, columns=2)
    return figure


@style.house_look
def draw_residual_map(residual_mm: Floats, axis: Floats, *, count: int) -> Figure:
    """The mean residual height map (n, n), in mm, about the punch's axis; white where nothing is compared."""
    figure, (axes,) = style.new_figure(5.6, 4.6)
    reach = 1e3 * float(np.nanquantile(np.abs(residual_mm), 0.98))
    image = axes.pcolormesh(
        axis, axis, 1e3 * residual_mm, cmap="RdBu_r", vmin=-reach, vmax=reach, shading="nearest"
    )
    axes.invert_yaxis()
    axes.set_aspect("equal")
    axes.set_facecolor(style.INVALID)
    axes.plot([], [], "s", color=style.INVALID, mec=style.GREY, label="not compared")
    style.legend_below(figure)
    axes.grid(False)
    axes.set(
        xlabel="x (punch radii)",
        ylabel="y (punch radii)",
        title=f"measured − expected, mean of {count} presses",
    )
    figure.colorbar(image, ax=axes, label="depth (µm)", shrink=0.85)
    return figure
