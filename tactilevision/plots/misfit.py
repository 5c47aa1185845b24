"""Figures of models against measurements: presses, residuals, the error of each model, the modulus.

Orange is the base model and blue the full model; models between them and radii have other colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.style import LOOK, legible
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.measured import Estimate, Floats
from tactilevision.records.misfit import ErrorFall, ForceCurves, PressCurve, ResidualStrips, Strip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BETWEEN = (style.SKY, style.PURPLE, style.GREEN, style.YELLOW)  # models between the first and the last
RADII = (style.PURPLE, style.GREEN, style.YELLOW, style.SKY, style.GREY)  # radii, the smallest first
CERTAIN = 1e-4  # p below which only this bound is stated
CHANCE = 0.05  # p above which a pattern may be chance
SHALLOW = 0.05  # of the largest depth: P/w of less is dominated by noise
FINE = 2  # decades; over fewer a logarithmic axis has ticks between them
ROW_IN = 1.6  # inches of height for a press
LEFT = "residual (mN)"  # measured less modelled force, as every page calls it
MANY = 200  # samples that overlap
NAMED = 2  # presses named in a panel, of those that reach beyond it
QUARTERS = (-180, -90, 0, 90, 180)  # degrees: ticks of a direction
FACES = "//"  # hatch of what punch faces read


def model_colours(count: int) -> tuple[str, ...]:
    """Return one colour a model: orange for the first, blue for the last."""
    if count < 2:
        return (style.ORANGE,)[:count]
    between = [BETWEEN[k % len(BETWEEN)] for k in range(count - 2)]
    return (style.ORANGE, *between, style.BLUE)


def radius_colours(radii_mm: Sequence[float]) -> dict[float, str]:
    """Return one colour a radius (mm)."""
    return {radius: RADII[k % len(RADII)] for k, radius in enumerate(sorted(set(radii_mm)))}


@style.house_look
def draw_presses(curves: ForceCurves, presses: Sequence[PressCurve]) -> Figure:
    """Draw a row a press: force over time, force over depth, and the residual of each model over time."""
    rows = max(len(presses), 1)
    height_in = ROW_IN * rows + 1
    figure, grid = style.fixed_figure(rows, 3, height_in=height_in, below_in=LOOK.bar, spaces=(1 / 2, 2 / 3))
    reach = KILO * max((float(np.max(np.abs(one.residual_N))) for one in presses), default=1.0)
    for row, one in zip(grid, presses, strict=True):
        _press(row, one, curves.models)
        _reach(row[2], reach)
    for axes, label in zip(grid.ravel(), ("time (s)", "depth w (mm)", "time (s)") * rows, strict=True):
        axes.set_xlabel(label, fontsize=LOOK.small, labelpad=1)
        axes.yaxis.set_label_coords(-1 / 3, 0.5)  # clear of the widest number
    return style.legend_below(figure, columns=4)


def _reach(axes: Axes, reach: float) -> None:
    """Show residuals from -reach to reach with some room, unless all are zero."""
    if reach > 0:
        reach *= 1 + LOOK.room
        axes.set_ylim(-reach, reach)


def _press(row: Sequence[Axes], one: PressCurve, models: Sequence[str]) -> None:
    over_time, over_depth, left = row
    for axes, x in ((over_time, one.time_s), (over_depth, one.depth_mm)):
        axes.plot(x, one.measured_N, ".", color="black", label="measured")
    for name, colour, force, rest in zip(
        models, model_colours(len(models)), one.modelled_N, one.residual_N, strict=True
    ):
        for axes, x in ((over_time, one.time_s), (over_depth, one.depth_mm)):
            axes.plot(x, force, color=colour, lw=LOOK.line, label=name)
        left.plot(one.time_s, KILO * rest, ".-", ms=3, lw=LOOK.line, color=colour, label=name)
    style.zero_line(left)
    punch = f"{style.as_label(one.indenter)}, " if one.indenter else ""
    over_time.set_title(
        f"press {style.as_label(one.label)} ({punch}a = {one.radius_mm:g} mm)", fontsize=LOOK.small
    )
    for axes in (over_time, over_depth):
        axes.set_ylabel("force (N)", fontsize=LOOK.small)
    errors = " → ".join(f"{KILO * rms:.1f}" for rms in one.rms_N)
    left.set_title(f"rms {errors} mN", fontsize=LOOK.small)
    left.set_ylabel(LEFT, fontsize=LOOK.small)


@style.house_look
def draw_overview(curves: ForceCurves, thickness_mm: float) -> Figure:
    """Draw P/w over w/h of all presses with the first and the last model, on one scale; one colour a radius."""
    shown = (0,) if len(curves.models) == 1 else (0, len(curves.models) - 1)
    figure, places = style.new_figure(columns=len(shown))
    deepest = max(float(one.depth_mm.max()) for one in curves.presses)
    colours = radius_colours(curves.radii_mm)
    bottom, top = _secant_range(curves, SHALLOW * deepest)
    for axes, k in zip(places, shown, strict=True):
        for one in sorted(curves.presses, key=lambda one: one.radius_mm):
            kept = one.depth_mm > SHALLOW * deepest
            depth, colour = one.depth_mm[kept], colours[one.radius_mm]
            mark, size, pale = (".", LOOK.dot, LOOK.faint) if curves.whole else ("o", LOOK.mark, 1)
            label = f"measured, a = {one.radius_mm:g} mm"
            measured = one.measured_N[kept] / depth
            axes.plot(depth / thickness_mm, measured, mark, ms=size, alpha=pale, color=colour, label=label)
            line = "-" if curves.whole else "_"
            modelled = one.modelled_N[k][kept] / depth
            axes.plot(depth / thickness_mm, modelled, line, ms=9, lw=0.5, color="black")
        axes.plot([], [], "-", lw=LOOK.line, color="black", label="the model, each press")
        axes.set(xlabel="depth over thickness, w / h", ylim=(bottom, top), title=curves.models[k])
        axes.set_ylabel("force over depth, P / w (N/mm)")
    return style.legend_below(figure, columns=2 if len(colours) > 1 else 3)


def _secant_range(curves: ForceCurves, shallow_mm: float) -> tuple[float, float]:
    force, depth = (
        np.concatenate([getattr(one, name) for one in curves.presses]) for name in ("measured_N", "depth_mm")
    )
    every = (force / np.maximum(depth, TINY))[depth > shallow_mm]
    low, high = np.percentile(every, style.SPAN)
    margin = LOOK.room * max(high - low, abs(high) / 100, TINY)
    return float(low - margin), float(high + margin)


@style.house_look
def draw_strips(shown: ResidualStrips) -> Figure:
    """Draw each model's residual against everything recorded, the most significant first, all on one scale."""
    count = len(shown.strips)
    columns = min(2, max(count, 1))
    rows = max(1, -(-count // columns))
    figure, places = style.new_figure(rows=rows, columns=columns, height_in=1 + 2 * rows)
    kept = (0,) if len(shown.models) == 1 else (0, len(shown.models) - 1)
    for axes, strip in zip(places, shown.strips, strict=False):
        _strip(axes, strip, shown, kept)
    for axes in places[count:]:
        axes.set_axis_off()
    return style.legend_below(figure, columns=2)


def _strip(axes: Axes, strip: Strip, shown: ResidualStrips, kept: Sequence[int]) -> None:
    width = float(np.ptp(strip.values)) or 1.0
    pale = LOOK.faint if strip.values.size > MANY else 1
    for place, k in enumerate(kept):
        colour = (style.ORANGE, style.BLUE)[place]
        aside = width / 80 * (place - 0.5) * (len(kept) - 1)
        residual_mN = KILO * shown.residual_N[k]
        axes.plot(strip.values + aside, residual_mN, "o", ms=LOOK.dot, mew=0, color=colour, alpha=pale)
        axes.errorbar(strip.centre + aside, KILO * strip.mean_N[k], yerr=KILO * strip.reach95_N[k], fmt="o",
                      color=colour, elinewidth=LOOK.line, label=f"{shown.models[k]} (mean, 95 %)")  # fmt: skip
        _outside(axes, strip.values + aside, shown, model=k, line=place, colour=colour)
    style.zero_line(axes)
    _reach(axes, KILO * shown.reach_N)
    words = [evidence(strip.p_adjusted[k], strip.p_trend[k]) for k in kept]
    title = " → ".join(dict.fromkeys(words))
    axes.set_title(title.replace("no pattern", "none") if "→" in title else title, fontsize=LOOK.small)
    label_covariate(axes, strip.words, strip.unit, levels=strip.levels, values=strip.values)
    axes.set_ylabel(LEFT, fontsize=LOOK.small)


def _outside(axes: Axes, x: Floats, shown: ResidualStrips, *, model: int, line: int, colour: str) -> None:
    """Mark the farthest sample of each press that reaches beyond the panel, and name the first few in a line."""
    named: dict[float, list[str]] = {1.0: [], -1.0: []}
    for press, k in shown.outside(model).items():
        side = float(np.sign(shown.residual_N[model, k]))
        axes.plot(x[k], side * _end(shown), "^" if side > 0 else "v", ms=LOOK.best, mew=0, color=colour)
        named[side].append(press)
    for side, presses in named.items():
        axes.annotate(
            ", ".join(map(style.as_label, presses[:NAMED])),
            (0, (1 + side) / 2),
            xycoords="axes fraction",
            textcoords="offset points",
            xytext=(LOOK.mark, -side * (LOOK.best + line * 1.2 * LOOK.small)),
            va="top" if side > 0 else "bottom",
            color=colour,
            fontsize=LOOK.small,
        )


def _end(shown: ResidualStrips) -> float:
    return KILO * shown.reach_N * (1 + LOOK.room)


def label_covariate(axes: Axes, words: str, unit: str, *, levels: Sequence[str], values: Floats) -> None:
    """Label an axis with a covariate of these values (N,) and its unit.

    Categories are named by `levels`, and logarithms labelled by the numbers that they are of.
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
        if len(ticks) < 2:
            ticks = [float(f"{10**one:.2g}") for one in (low, high)]
        axes.set_xticks(np.log10(ticks), [f"{one:g}" for one in ticks])
    if plain not in ("", "1"):
        axes.set_xlabel(f"{words} ({plain})")


def evidence(p: float, p_trend: float) -> str:
    """Return in words how significant a pattern is, or a trend of the presses' means where that is more so."""
    if not np.isfinite(p):
        return "not examined"
    if p < CERTAIN:
        return f"a pattern (p < {CERTAIN:g})"
    if p_trend < min(p, CHANCE):
        return f"a trend (p = {p_trend:.2g})"
    return f"a pattern (p = {p:.2g})" if p < CHANCE else f"no pattern (p = {p:.2g})"


@style.house_look
def draw_error_fall(fall: ErrorFall) -> Figure:
    """Draw the error of each model as a bar, and the band in which the presses repeat."""
    count, unit = len(fall.models), "mN" if fall.unit == "N" else "µm"
    figure, (axes,) = style.new_figure()
    sets = {"the gel outside the faces": fall.error, "the faces": fall.faces} if fall.faces else {"": fall.error}
    width = 2 / 3 / len(sets)
    for k, (label, values) in enumerate(sets.items()):
        place = np.arange(count) + width * (k - (len(sets) - 1) / 2)
        bars = axes.bar(place, KILO * np.array(values), width=width, color=model_colours(count), hatch=k * FACES)
        axes.bar_label(bars, fmt="%.1f", padding=2, fontsize=LOOK.small)
        if label:
            axes.bar(0, 0, color=style.GREY, hatch=k * FACES, label=label)
    if np.isfinite(fall.repeatability):
        level = KILO * fall.repeatability
        axes.axhline(level, color=style.GREY, ls="--", lw=LOOK.line, label="repeatability")
    if fall.band is not None:
        low, high = (KILO * end for end in fall.band)
        axes.axhspan(low, high, color=style.INVALID, zorder=0, label="its 95 % interval")
    axes.set_xticks(range(count), list(map(legible, fall.models)), rotation=15 if count > 3 else 0)
    what = "held out" if fall.held_out else "fitted"
    middle, reach = (count - 1) / 2, max(count, 3) / 2 + LOOK.band
    title = "Error of each model" if count > 1 else "Error of the model, and repeatability"
    axes.set(ylabel=f"rms error on presses {what} ({unit})", title=title, xlim=(middle - reach, middle + reach))
    axes.margins(y=LOOK.room)
    axes.grid(visible=False, axis="x")
    return style.legend_below(figure)


@style.house_look
def draw_moduli(names: Sequence[str], moduli: Sequence[Estimate], *, models: int | None = None) -> Figure:
    """Draw Young's modulus with its 95 % interval under each model, beyond so many `models` in the last colour."""
    figure, (axes,) = style.new_figure(height_in=1 + LOOK.faint * len(names))
    colours = model_colours(len(names) if models is None else models)
    colours = (*colours, *colours[-1:] * (len(names) - len(colours)))
    for place, (estimate, colour) in enumerate(zip(moduli, colours, strict=True)):
        if estimate.interval95 is not None:
            axes.plot(estimate.interval95, [place, place], "|-", ms=9, color=colour)
        if estimate.value is not None:
            axes.plot(estimate.value, place, "o", ms=LOOK.best, color=colour)
    axes.set_yticks(range(len(names)), list(map(legible, names)))
    for tick, colour in zip(axes.get_yticklabels(), colours, strict=True):
        tick.set_color(colour)
    axes.invert_yaxis()
    axes.margins(y=LOOK.room)
    axes.set(xlabel="Young's modulus E (MPa)")
    return figure
