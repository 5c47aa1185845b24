"""Figures of presses, of force against depth, and of Young's modulus with Poisson's ratio."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.height import centre_mm, depth_image, overlay
from tactilevision.plots.misfit import LEFT, SHALLOW, radius_colours
from tactilevision.plots.style import LOOK
from tactilevision.press.certificate import Evidence
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import KILO, Z95
from tactilevision.records.measured import Bools, Bytes, Estimate, Floats, Pair

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Force against depth, and E over nu.


@dataclass(frozen=True, slots=True)
class PointCloud:
    """The points of a fit, (N,) each: `fitted_N` the law's force, `used` whether a point entered the fit.

    `bars` is False for whole curves, whose samples have no intervals; `radius_mm` (N,) of the punch, NaN
    where it is not known, None where there is one.
    """

    depth_mm: Floats
    depth_std_mm: Floats
    force_N: Floats
    force_std_N: Floats
    fitted_N: Floats
    thickness_mm: float
    used: Bools
    bars: bool = True
    radius_mm: Floats | None = None


@dataclass(frozen=True, slots=True)
class FittedLine:
    """A fitted model along one indenter: depth, force and the standard deviation of the force, (M,) each."""

    name: str
    depth_mm: Floats
    force_N: Floats
    force_std_N: Floats
    thickness_mm: float


@style.house_look
def draw_fit(cloud: PointCloud, lines: Sequence[FittedLine]) -> Figure:
    """Draw P against w, P/w against w/h, and the residual of the fit, with 95 % intervals."""
    figure, (force, stiffness, rest, corner) = style.new_figure(rows=2, columns=2)
    strain = cloud.depth_mm / cloud.thickness_mm
    deep_mm = np.where(cloud.depth_mm > SHALLOW * np.max(cloud.depth_mm), cloud.depth_mm, np.nan)
    secant = cloud.force_N / deep_mm
    secant_std = np.hypot(cloud.force_std_N, secant * cloud.depth_std_mm) / deep_mm
    depth_bar, force_bar = Z95 * cloud.depth_std_mm, Z95 * cloud.force_std_N
    scatter(force, cloud, x=cloud.depth_mm, y=cloud.force_N, bars=(depth_bar, force_bar))
    scatter(stiffness, cloud, x=strain, y=secant, bars=(depth_bar / cloud.thickness_mm, Z95 * secant_std))
    scatter(rest, cloud, x=strain, y=KILO * (cloud.force_N - cloud.fitted_N), bars=(None, KILO * force_bar))
    several = list(_radii(cloud).values())
    for line, colour in zip(lines, several or style.CYCLE, strict=False):
        reach = Z95 * line.force_std_N
        for axes, x, scale in (
            (force, line.depth_mm, np.ones_like(line.depth_mm)),
            (stiffness, line.depth_mm / line.thickness_mm, line.depth_mm),
        ):
            axes.plot(x, line.force_N / scale, color=colour, label=line.name)
            low, high = (line.force_N - reach) / scale, (line.force_N + reach) / scale
            axes.fill_between(x, low, high, color=colour, alpha=LOOK.band, lw=0, label=f"95 % of {line.name}")
    style.zero_line(rest)
    force.set(xlabel="depth w (mm)", ylabel="force P (N)", title="Force against certified depth")
    strain_label = "depth over thickness, w / h"
    stiffness.set(
        xlabel=strain_label, ylabel="force over depth, P / w (N/mm)", title="The line that gives c and β"
    )
    rest.set(xlabel=strain_label, ylabel=LEFT, title="Measured less fitted force")
    return style.legend_below(figure, corner=corner)


def scatter(
    axes: Axes, cloud: PointCloud, *, x: Floats, y: Floats, bars: tuple[Floats | None, Floats | None]
) -> None:
    """Draw points x, y (n,), mm or N, with bars, one colour a radius; excluded ones are hollow."""
    what = ", and 95 % interval" if cloud.bars else ""
    parts = [(~cloud.used, style.GREY, "white", "rejected" + what)]
    for radius, colour in _radii(cloud).items():
        parts.append(
            (cloud.used & (cloud.radius_mm == radius), colour, colour, f"accepted, a = {radius:g} mm{what}")
        )
    if len(parts) == 1:
        parts.append((cloud.used, "black", "black", "accepted" + what))
    for mask, colour, face, label in parts:
        kept = mask & np.isfinite(x) & np.isfinite(y)
        if not kept.any():
            continue
        if not cloud.bars:
            axes.plot(x[kept], y[kept], ".", ms=LOOK.dot, color=colour, alpha=LOOK.faint, label=label)
            continue
        x_bar, y_bar = (None if bar is None else np.nan_to_num(bar[kept]) for bar in bars)
        mark: dict[str, Any] = {"fmt": "o", "mfc": face, "elinewidth": LOOK.line}
        axes.errorbar(x[kept], y[kept], xerr=x_bar, yerr=y_bar, color=colour, label=label, **mark)


def _radii(cloud: PointCloud) -> dict[float, str]:
    """Return a colour for each radius where there are several."""
    if cloud.radius_mm is None:
        return {}
    radii = np.unique(cloud.radius_mm[cloud.used]).tolist()
    return radius_colours(radii) if len(radii) > 1 else {}


@style.house_look
def draw_material(modulus_of_nu: Sequence[Pair], modulus: Estimate, poisson: Estimate) -> Figure:
    """Draw E over nu at the fitted stiffness, with the intervals of both."""
    figure, (axes,) = style.new_figure(*style.MAP_IN)
    nu, e = np.array(modulus_of_nu).T
    axes.plot(nu, e, color=style.BLUE, label="E(ν) at the fitted c")
    if poisson.interval95 is not None:
        axes.axvspan(*poisson.interval95, color=style.YELLOW, alpha=LOOK.band, lw=0, label="95 % interval of ν")
    if modulus.interval95 is not None:
        axes.axhspan(*modulus.interval95, color=style.GREEN, alpha=LOOK.band, lw=0, label="95 % interval of E")
    if poisson.value is not None and modulus.value is not None:
        axes.plot(poisson.value, modulus.value, "o", color=style.ORANGE, ms=LOOK.best, label="best E and ν")
    axes.set(xlabel="Poisson's ratio ν", ylabel="Young's modulus E (MPa)", title="E and ν at the fitted c")
    return style.legend_below(figure, columns=2)


@style.house_look
def draw_history(dates: Sequence[str], modulus: Sequence[Estimate], *, moved: Sequence[bool]) -> Figure:
    """Draw Young's modulus of one sensor over time with 95 % intervals; orange: changed significantly."""
    figure, (axes,) = style.new_figure()
    for place, (estimate, has_moved) in enumerate(zip(modulus, moved, strict=True)):
        if estimate.value is None or estimate.interval95 is None:
            continue
        low, high = estimate.interval95
        bar = [[estimate.value - low], [high - estimate.value]]
        colour, label = (
            (style.ORANGE, "changed by more than its interval")
            if has_moved
            else (style.BLUE, "no significant change")
        )
        axes.errorbar([place], [estimate.value], yerr=bar, fmt="o", color=colour, label=label)
    axes.set_xticks(range(len(dates)), dates, rotation=30, ha="right")
    axes.set(ylabel="Young's modulus E (MPa)", title="Ageing of the gel (95 % intervals)")
    return style.legend_below(figure, columns=2)


@style.house_look
def draw_ageing(
    days: Floats,
    change: Floats,
    std: Floats,
    *,
    line: tuple[Floats, Floats, Floats] | None,
    modulus: Sequence[Estimate],
    dates: tuple[str, str],
) -> Figure:
    """Draw the relative change of the stiffness over days (n,) with its own std (n,), and Young's modulus.

    `line` (3, k) is the fitted drift with its 95 % ends at even days; `dates` are those of the first and last day.
    """
    figure, (above, below) = style.new_figure(rows=2)
    if line is not None:
        at = np.linspace(days[0], days[-1], line[0].size)
        above.plot(at, 100 * line[0], color=style.BLUE, label="fitted drift")
        above.fill_between(at, 100 * line[1], 100 * line[2], color=style.SKY, alpha=0.3, label="its 95 % interval")
    bars = Z95 * 100 * std
    above.errorbar(days, 100 * change, yerr=bars, fmt="o", color="black", label="recordings, with their own noise")
    above.axhline(0, color=style.GREY, linewidth=0.8)
    above.set(ylabel="change of stiffness (%)", title=f"Ageing of the gel, {dates[0]} to {dates[1]}")
    for day, one in zip(days, modulus, strict=True):
        if one.interval95 is not None:
            low, high = one.interval95
            below.plot([day, day], [low, high], color=style.GREEN, lw=LOOK.line, label="E, its 95 % interval")
        if one.value is not None:
            below.plot([day], [one.value], "o", color=style.GREEN)
    below.set(ylabel="E (MPa)", xlim=above.get_xlim())
    for axes in (above, below):
        axes.set_xlabel("time since the first recording (days)")
    return style.legend_below(figure, columns=2)


# Young's modulus and Poisson's ratio together.

WORDS = {
    "bulge": "rise outside the punch",
    "radii": "several radii",
    "prior": "stated prior",
    "beta": "law of β (not used)",
}
ROW = 0.055  # of the height of the picture, for each route's bar
MARGIN = (LOOK.band, 0.002)  # next to what is shown: a share of it, and at least this much of nu


@style.house_look
def draw_joint(
    curve: Floats, region: Floats, *, best: Pair | None, routes: Sequence[tuple[str, Pair, bool]]
) -> Figure:
    """Draw `curve` (n, 2) of (nu, E in MPa), the outline of the 95 % `region` (k, 2), and each route to nu.

    `routes` (name, 95 % interval, used) are bars below the curve; arrows stand for intervals off the picture.
    """
    figure, (axes,) = style.new_figure(height_in=5)
    axes.plot(*curve.T, color=style.BLUE, label="E(ν) at the fitted c")
    axes.fill(*region.T, color=style.YELLOW, alpha=LOOK.faint, lw=0, label="95 % of E and ν together")
    if best is not None:
        axes.plot(*best, "o", color=style.ORANGE, ms=LOOK.best, label="best E and ν")
    left, right, bottom, top = _frame(curve, region, routes)
    height = (top - bottom) / (1 - ROW * (len(routes) + 2))
    floor = top + ROW * height - height
    colours = dict(zip(WORDS, (style.GREEN, style.PURPLE, style.GREY, style.SKY), strict=True))
    for place, (name, (low, high), used) in enumerate(routes):
        y, colour = floor + (place + 0.5) * ROW * height, colours.get(name, style.GREY)
        bar, words = np.clip([low, high], left, right), WORDS.get(name, name)
        if used:
            axes.axvspan(low, high, color=colour, alpha=LOOK.room, lw=0, label=f"95 % of ν, {words}")
        if high < left or low > right:
            words += f": {low:.3f} to {high:.3f}, off the picture"
            inwards = (right - left) / 80 * (1 if high < left else -1)
            axes.plot(bar[0] + inwards, y, "<" if high < left else ">", color=colour, label=words)
            continue
        axes.plot(
            bar, [y, y], "|-", ms=9, mew=LOOK.strong, color=colour, lw=4 if used else LOOK.strong, label=words
        )
    axes.set(xlim=(left, right), ylim=(floor, floor + height), xlabel="Poisson's ratio ν")
    axes.set(ylabel="Young's modulus E (MPa)", title="E and ν together, and ν by each route")
    return style.legend_below(figure, columns=2)


def _frame(
    curve: Floats, region: Floats, routes: Sequence[tuple[str, Pair, bool]]
) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of the picture without the bars of the routes."""
    used = [interval for _, interval, is_used in routes if is_used]
    low = min([float(region[:, 0].min()), *(interval[0] for interval in used)])
    high = max([float(region[:, 0].max()), *(interval[1] for interval in used)])
    margin = max(MARGIN[0] * (high - low), MARGIN[1])
    left, right = max(low - margin, float(curve[0, 0])), min(high + margin, 0.5 + MARGIN[1])
    inside = curve[(curve[:, 0] >= left) & (curve[:, 0] <= right), 1]
    shown = np.append(inside, np.interp([left, right], *curve.T))
    bottom = min(float(region[:, 1].min()), float(shown.min()))
    return left, right, bottom, max(float(region[:, 1].max()), float(shown.max()))


# One press.


@style.house_look
def draw_press(evidence: Evidence, point: CertifiedPoint, *, rgb: Bytes | None) -> Figure:
    """Draw the frame at the contact event, its depth, the signal of the bevel, and the force.

    `rgb` is the rectified frame, None where there is none.
    """
    figure, (frame, depth, bevel, force) = style.new_quad(legend_in=1)
    verdict = "accepted" if point.accepted else f"rejected: {point.reason.replace('_', ' ')}"
    height = evidence.height_map
    if height is None:
        for axes in (frame, depth):
            style.note(axes, "no picture at the contact event")
            axes.set_axis_off()
    else:
        if rgb is not None:
            overlay(frame, rgb, height=height, footprint=evidence.footprint)
        figure.colorbar(depth_image(depth, height), ax=depth, label="depth (mm)", shrink=LOOK.bar, pad=1 / 50)
        for axes in (frame, depth):
            _bevel_window(axes, evidence)
            axes.set(xticks=[], yticks=[], xlabel="", ylabel="")
        frame.set_title("Frame of the press" if evidence.touch is None else "Frame at the contact event")
        depth.set_title("Height map of that frame")
    press, punch = style.as_label(point.press), style.as_label(point.indenter)
    figure.suptitle(f"Press {press} ({punch}): {verdict}", x=1 / 50, ha="left", fontsize=11)
    _bevel_signal(bevel, evidence)
    _force(force, evidence, point)
    return style.legend_below(figure)


def _bevel_window(axes: Axes, evidence: Evidence) -> None:
    if evidence.bevel_window_mm is None or evidence.height_map is None:
        return
    (x0, y0), (x1, y1) = evidence.bevel_window_mm
    middle_x, middle_y = centre_mm(evidence.height_map)
    x, y = np.array([x0, x1, x1, x0, x0]) + middle_x, np.array([y0, y0, y1, y1, y0]) + middle_y
    axes.plot(x, y, color=style.SKY, label="window on the bevel")


def _bevel_signal(axes: Axes, evidence: Evidence) -> None:
    axes.set(
        xlabel="depth read by the camera (mm)",
        ylabel="bevel − other side (µm)",
        title="Signal of the bevel",
    )
    if evidence.signal_mm is None:
        style.note(axes, "not looked for")
        return
    signal_um = KILO * evidence.signal_mm
    axes.plot(evidence.depth_mm, signal_um, ".", color=style.BLUE, label="one frame's bevel signal")
    if evidence.touch is not None:
        axes.axvline(evidence.touch.depth_seen_mm, color=style.ORANGE, lw=LOOK.line, label="contact event")


def _force(axes: Axes, evidence: Evidence, point: CertifiedPoint) -> None:
    labels = (
        ("fx, sideways", style.GREEN, 0),
        ("fy, sideways", style.PURPLE, 1),
        ("fz, into the gel", style.BLUE, 2),
    )
    for name, colour, column in labels:
        axes.plot(evidence.force_time_s, evidence.force_N[:, column], color=colour, lw=LOOK.line, label=name)
    if evidence.touch is not None:
        axes.axvline(evidence.touch.time_s, color=style.ORANGE, lw=LOOK.line, label="contact event")
        axes.plot(
            evidence.touch.time_s, point.fz_N, "o", color=style.ORANGE, ms=LOOK.best, label="certified force"
        )
    axes.set(xlabel="camera's clock (s)", ylabel="force (N)", title="Force, less that of the free gel")
