"""Pictures of models against measurements: presses, residuals on one scale, the error's fall, the modulus.

Orange is the plain law and blue the model with all that was added, on every picture of a page; what stands between
them has colours of its own. Radii have others again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.style import legible
from tactilevision.records.measured import Estimate, Floats
from tactilevision.records.misfit import ErrorFall, ForceCurves, PressCurve, ResidualStrips, Strip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BETWEEN = (style.SKY, style.PURPLE, style.GREEN, style.YELLOW)  # models between the first and the last
RADII = (style.PURPLE, style.GREEN, style.YELLOW, style.SKY, style.GREY)  # radii, the smallest first
CERTAIN = 1e-4  # p below which a pattern is called certain; its digits say nothing more
CHANCE = 0.05  # p above which a pattern may be chance
SHALLOW = 0.05  # of the largest depth: P/w of less is noise over nearly nothing
FINE = 2.0  # decades; over fewer a logarithmic axis has ticks between them
ROW_IN = 1.6  # inches of height for a press
LEFT = "what is left (mN)"  # measured less modelled force, as every page calls it
MARGIN = 1.15  # of a residual's largest value: how far its axis reaches
QUARTERS = (-180, -90, 0, 90, 180)  # degrees: ticks of a direction
BAR = 0.6  # width of a bar; bars stand 1 apart
FACES = "//"  # hatch of what punch faces read


def model_colours(count: int) -> tuple[str, ...]:
    """One colour a model: orange for the first, blue for the last."""
    if count < 2:
        return (style.ORANGE,)[:count]
    between = [BETWEEN[k % len(BETWEEN)] for k in range(count - 2)]
    return (style.ORANGE, *between, style.BLUE)


def radius_colours(radii_mm: Sequence[float]) -> dict[float, str]:
    """One colour a radius (mm)."""
    return {radius: RADII[k % len(RADII)] for k, radius in enumerate(sorted(set(radii_mm)))}


@style.house_look
def draw_presses(curves: ForceCurves, presses: Sequence[PressCurve]) -> Figure:
    """A row a press: force over time, force over depth, and what each model leaves over time."""
    from matplotlib.figure import Figure

    rows = max(len(presses), 1)
    height_in = ROW_IN * rows + 1.15
    figure = Figure(figsize=(style.WIDTH_IN, height_in))  # a fixed layout: sheets of presses are many
    figure.subplots_adjust(
        left=0.1, right=0.985, bottom=0.85 / height_in, top=1 - 0.3 / height_in, wspace=0.55, hspace=0.62
    )
    grid = figure.subplots(rows, 3, squeeze=False)
    reach = 1e3 * MARGIN * max((float(np.max(np.abs(one.residual_N))) for one in presses), default=1.0)
    for row, one in zip(grid, presses, strict=True):
        _press(row, one, curves.models)
        _reach(row[2], reach)
    under, beside = ("time (s)", "depth w (mm)", "time (s)"), (-0.29, -0.29, -0.33)  # clear of the widest number
    for axes, label, aside in zip(grid.ravel(), under * rows, beside * rows, strict=True):
        axes.set_xlabel(label, fontsize=9, labelpad=1)
        axes.yaxis.set_label_coords(aside, 0.5)
    style.legend_below(figure, columns=4)
    return figure


def _reach(axes: Axes, reach: float) -> None:
    """From -reach to reach, unless a law that goes through every sample leaves nothing."""
    if reach > 0:
        axes.set_ylim(-reach, reach)


def _press(row: Sequence[Axes], one: PressCurve, models: Sequence[str]) -> None:
    over_time, over_depth, left = row
    for axes, x in ((over_time, one.time_s), (over_depth, one.depth_mm)):
        axes.plot(x, one.measured_N, ".", ms=3.5, color="black", label="measured")
    for name, colour, force, rest in zip(
        models, model_colours(len(models)), one.modelled_N, one.residual_N, strict=True
    ):
        for axes, x in ((over_time, one.time_s), (over_depth, one.depth_mm)):
            axes.plot(x, force, color=colour, lw=1.2, label=name)
        left.plot(one.time_s, 1e3 * rest, ".-", ms=3, lw=0.9, color=colour, label=name)
    left.axhline(0, color=style.GREY, lw=0.8)
    punch = f"{style.as_label(one.indenter)}, " if one.indenter else ""
    over_time.set_title(f"press {style.as_label(one.label)} ({punch}a = {one.radius_mm:g} mm)", fontsize=9)
    for axes in (over_time, over_depth):
        axes.set_ylabel("force (N)", fontsize=9)
    errors = " → ".join(f"{1e3 * rms:.1f}" for rms in one.rms_N)
    left.set_title(f"rms {errors} mN", fontsize=9)
    left.set_ylabel(LEFT, fontsize=9)


@style.house_look
def draw_overview(curves: ForceCurves, thickness_mm: float) -> Figure:
    """P/w over w/h of all presses under the first and the last model, on one scale; one colour a radius."""
    shown = (0,) if len(curves.models) == 1 else (0, len(curves.models) - 1)
    figure, places = style.new_figure(style.WIDTH_IN, 3.6, columns=len(shown))
    deepest = max(float(one.depth_mm.max()) for one in curves.presses)
    colours = radius_colours(curves.radii_mm)
    bottom, top = _secant_range(curves, SHALLOW * deepest)
    for axes, k in zip(places, shown, strict=True):
        for one in sorted(curves.presses, key=lambda one: one.radius_mm):
            kept = one.depth_mm > SHALLOW * deepest
            depth, colour = one.depth_mm[kept], colours[one.radius_mm]
            mark, size, pale = (".", 2.5, 0.35) if curves.whole else ("o", 4.5, 0.8)
            label = f"measured, a = {one.radius_mm:g} mm"
            measured = one.measured_N[kept] / depth
            axes.plot(depth / thickness_mm, measured, mark, ms=size, alpha=pale, color=colour, label=label)
            line = "-" if curves.whole else "_"
            axes.plot(
                depth / thickness_mm,
                one.modelled_N[k][kept] / depth,
                line,
                ms=9,
                lw=0.5,
                color="black",
            )
        axes.plot([], [], "-", lw=1.2, color="black", label="the model, each press")
        axes.set(xlabel="depth over thickness, w / h", ylim=(bottom, top), title=curves.models[k])
        axes.set_ylabel("force over depth, P / w (N/mm)")
    style.legend_below(figure, columns=2 if len(colours) > 1 else 3)
    return figure


def _secant_range(curves: ForceCurves, shallow_mm: float) -> tuple[float, float]:
    force, depth = (
        np.concatenate([getattr(one, name) for one in curves.presses]) for name in ("measured_N", "depth_mm")
    )
    every = (force / np.maximum(depth, 1e-9))[depth > shallow_mm]
    low, high = np.quantile(every, [0.005, 0.995])
    margin = 0.1 * max(high - low, 0.01 * abs(high), 1e-12)
    return float(low - margin), float(high + margin)


@style.house_look
def draw_strips(shown: ResidualStrips) -> Figure:
    """What each model leaves against everything recorded, the most telling first, all on one scale."""
    count = len(shown.strips)
    columns = min(2, max(count, 1))
    rows = max(1, -(-count // columns))
    figure, places = style.new_figure(style.WIDTH_IN, 0.6 + 2.1 * rows, rows=rows, columns=columns)
    kept = (0,) if len(shown.models) == 1 else (0, len(shown.models) - 1)
    for axes, strip in zip(places, shown.strips, strict=False):
        _strip(axes, strip, shown, kept)
    for axes in places[count:]:
        axes.set_axis_off()
    style.legend_below(figure, columns=2)
    return figure


def _strip(axes: Axes, strip: Strip, shown: ResidualStrips, kept: Sequence[int]) -> None:
    width = float(np.ptp(strip.values)) or 1.0
    size, pale = (2.5, 0.3) if strip.values.size > 200 else (4, 0.5)
    for place, k in enumerate(kept):
        colour = (style.ORANGE, style.BLUE)[place]
        aside = 0.012 * width * (place - 0.5) * (len(kept) - 1)
        axes.plot(strip.values + aside, 1e3 * shown.residual_N[k], ".", ms=size, mew=0, color=colour, alpha=pale)
        axes.errorbar(
            strip.centre + aside,
            1e3 * strip.mean_N[k],
            yerr=1e3 * strip.reach95_N[k],
            fmt="o",
            ms=4.5,
            color=colour,
            elinewidth=1.1,
            label=f"{shown.models[k]} (mean, 95 %)",
        )
    axes.axhline(0, color=style.GREY, lw=0.8)
    _reach(axes, 1.15e3 * shown.reach_N)
    words = [evidence(strip.p_adjusted[k], strip.p_trend[k]) for k in kept]
    title = " → ".join(dict.fromkeys(words))
    axes.set_title(title.replace("no pattern", "none") if "→" in title else title, fontsize=9)
    label_covariate(axes, strip.words, strip.unit, levels=strip.levels, values=strip.values)
    axes.set_ylabel(LEFT, fontsize=9)


def label_covariate(axes: Axes, words: str, unit: str, *, levels: Sequence[str], values: Floats) -> None:
    """Name a covariate of these values (N,) under an axis, in its unit: words for what only counts, and
    logarithms by the numbers that they are of.
    """
    axes.set_xlabel(words)
    if levels:
        at = sorted({round(value) for value in values.tolist()})
        axes.set_xticks(at, [style.as_label(levels[k]) for k in at])
        axes.set_xlim(at[0] - 0.5, at[-1] + 0.5)
        return
    if unit == "rad":
        axes.set_xticks(np.radians(QUARTERS), [f"{angle}" for angle in QUARTERS])
        unit = "°"
    plain = unit.removeprefix("log10 ")
    if plain != unit:
        low, high = float(values.min()), float(values.max())
        decades = [10.0**k for k in range(int(np.floor(low)), int(np.ceil(high)) + 1)]
        steps = (1,) if high - low > FINE else (1, 2, 5)
        ticks = [step * one for one in decades for step in steps if low <= np.log10(step * one) <= high]
        if len(ticks) < 2:  # within less than an octave
            ticks = [float(f"{10**one:.2g}") for one in (low, high)]
        axes.set_xticks(np.log10(ticks), [f"{one:g}" for one in ticks])
    if plain not in ("", "1"):
        axes.set_xlabel(f"{words} ({plain})")


def evidence(p: float, p_trend: float) -> str:
    """How sure a pattern is, in words; where none is, whether the presses' means rise or fall."""
    if not np.isfinite(p):
        return "not looked at"
    if p < CERTAIN:
        return "a pattern for certain"
    if p < CHANCE:
        return f"a pattern (p = {p:.2g})"
    return f"a trend (p = {p_trend:.2g})" if p_trend < CHANCE else f"no pattern (p = {p:.2g})"


@style.house_look
def draw_error_fall(fall: ErrorFall) -> Figure:
    """The error of each model as a bar, and the band in which the presses repeat."""
    count, scale = len(fall.models), 1e3
    unit = "mN" if fall.unit == "N" else "µm"
    figure, (axes,) = style.new_figure(style.WIDTH_IN, 3.2)
    sets = {"the gel beside the faces": fall.error, "the faces": fall.faces} if fall.faces else {"": fall.error}
    width = BAR / len(sets)
    for k, (label, values) in enumerate(sets.items()):
        place = np.arange(count) + width * (k - (len(sets) - 1) / 2)
        bars = axes.bar(place, scale * np.array(values), width=width, color=model_colours(count), hatch=k * FACES)
        axes.bar_label(bars, fmt="%.1f", padding=2, fontsize=9)
        if label:
            axes.bar(0, 0, color=style.GREY, hatch=k * FACES, label=label)
    if np.isfinite(fall.repeatability):
        axes.axhline(scale * fall.repeatability, color=style.GREY, ls="--", lw=1.2, label="repeatability")
    if fall.band is not None:
        low, high = (scale * end for end in fall.band)
        axes.axhspan(low, high, color=style.INVALID, zorder=0, label="its 95 % interval")
    axes.set_xticks(range(count), list(map(legible, fall.models)), rotation=15 if count > 3 else 0)
    what = "left out" if fall.held_out else "fitted"
    middle, reach = (count - 1) / 2, max(count, 3) / 2 + 0.2
    title = "How the error falls" if count > 1 else "The error, and how presses repeat"
    axes.set(ylabel=f"rms error on presses {what} ({unit})", title=title, xlim=(middle - reach, middle + reach))
    axes.margins(y=0.2)
    axes.grid(visible=False, axis="x")
    style.legend_below(figure)
    return figure


@style.house_look
def draw_moduli(names: Sequence[str], moduli: Sequence[Estimate]) -> Figure:
    """Young's modulus under each model, with its 95 % interval."""
    figure, (axes,) = style.new_figure(style.WIDTH_IN, 0.9 + 0.42 * len(names))
    for place, (estimate, colour) in enumerate(zip(moduli, model_colours(len(names)), strict=True)):
        if estimate.interval95 is not None:
            axes.plot(estimate.interval95, [place, place], "|-", ms=9, color=colour)
        if estimate.value is not None:
            axes.plot(estimate.value, place, "o", ms=6, color=colour)
    axes.set_yticks(range(len(names)), list(map(legible, names)))
    for tick, colour in zip(axes.get_yticklabels(), model_colours(len(names)), strict=True):
        tick.set_color(colour)
    axes.invert_yaxis()
    axes.margins(y=0.25)
    axes.set(xlabel="Young's modulus E (MPa)")
    return figure
