"""Pictures of force against depth: certified points, the straight line through P/w, what it leaves, E over nu."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.misfit import LEFT, radius_colours
from tactilevision.records import Bools, Estimate, Floats, Pair

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHALLOW = 0.05  # of the largest depth: P/w of less is noise over nearly nothing, and would hide the line


@dataclass(frozen=True, slots=True)
class PointCloud:
    """What is drawn of the points, (N,) each: `fitted_N` the law's force there, `used` those that entered the fit.

    `bars` is False for whole curves, whose samples would hide behind them; `radius_mm` (N,) of the punch, NaN
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
def draw_fit(cloud: PointCloud, lines: Sequence[FittedLine], *, title: str = "") -> Figure:
    """P against w, P/w against w/h, and what the fit leaves; bars and bands are 95 % intervals."""
    figure, (force, stiffness, rest, corner) = style.new_figure(style.WIDTH_IN, 5.4, rows=2, columns=2)
    strain = cloud.depth_mm / cloud.thickness_mm
    deep_mm = np.where(cloud.depth_mm > SHALLOW * np.max(cloud.depth_mm), cloud.depth_mm, np.nan)
    secant = cloud.force_N / deep_mm
    secant_std = np.hypot(cloud.force_std_N, secant * cloud.depth_std_mm) / deep_mm
    depth_bar, force_bar = 1.96 * cloud.depth_std_mm, 1.96 * cloud.force_std_N
    scatter(force, cloud, x=cloud.depth_mm, y=cloud.force_N, bars=(depth_bar, force_bar))
    scatter(stiffness, cloud, x=strain, y=secant, bars=(depth_bar / cloud.thickness_mm, 1.96 * secant_std))
    left = cloud.force_N - cloud.fitted_N
    scatter(rest, cloud, x=strain, y=1e3 * left, bars=(None, 1e3 * force_bar))
    several = list(_radii(cloud).values())
    for line, colour in zip(lines, several or style.CYCLE, strict=False):
        low, high = line.force_N - 1.96 * line.force_std_N, line.force_N + 1.96 * line.force_std_N
        for axes, x, scale in (
            (force, line.depth_mm, np.ones_like(line.depth_mm)),
            (stiffness, line.depth_mm / line.thickness_mm, line.depth_mm),
        ):
            axes.plot(x, line.force_N / scale, color=colour, label=line.name)
            axes.fill_between(
                x, low / scale, high / scale, color=colour, alpha=0.18, lw=0, label=f"95 % of {line.name}"
            )
    rest.axhline(0, color=style.GREY, lw=0.8)
    force.set(xlabel="depth w (mm)", ylabel="force P (N)", title=title or "Force against certified depth")
    strain_label = "depth over thickness, w / h"
    stiffness.set(
        xlabel=strain_label, ylabel="force over depth, P / w (N/mm)", title="The line that gives c and β"
    )
    rest.set(xlabel=strain_label, ylabel=LEFT, title="Measured less fitted force")
    style.legend_below(figure, corner=corner)
    return figure


def scatter(
    axes: Axes, cloud: PointCloud, *, x: Floats, y: Floats, bars: tuple[Floats | None, Floats | None]
) -> None:
    """Points x, y (n,), mm or N, with bars, one colour a radius; those left out of the fit are hollow."""
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
            axes.plot(x[kept], y[kept], ".", ms=2.5, color=colour, alpha=0.5, label=label)
            continue
        x_bar, y_bar = (None if bar is None else np.nan_to_num(bar[kept]) for bar in bars)
        axes.errorbar(
            x[kept],
            y[kept],
            xerr=x_bar,
            yerr=y_bar,
            fmt="o",
            ms=4.5,
            color=colour,
            mfc=face,
            elinewidth=0.8,
            label=label,
        )


def _radii(cloud: PointCloud) -> dict[float, str]:
    """A colour for each radius where there are several."""
    if cloud.radius_mm is None:
        return {}
    radii = np.unique(cloud.radius_mm[cloud.used]).tolist()
    return radius_colours(radii) if len(radii) > 1 else {}


@style.house_look
def draw_material(modulus_of_nu: Sequence[Pair], modulus: Estimate, poisson: Estimate) -> Figure:
    """E over nu at the fitted stiffness: the curve that one punch fixes, and the part of it that remains."""
    figure, (axes,) = style.new_figure(6.0, 4.4)
    nu, e = np.array(modulus_of_nu).T
    axes.plot(nu, e, color=style.BLUE, label="E(ν) at the fitted c")
    if poisson.interval95 is not None:
        axes.axvspan(*poisson.interval95, color=style.YELLOW, alpha=0.2, lw=0, label="95 % interval of ν")
    if modulus.interval95 is not None:
        axes.axhspan(*modulus.interval95, color=style.GREEN, alpha=0.15, lw=0, label="95 % interval of E")
    if poisson.value is not None and modulus.value is not None:
        axes.plot(poisson.value, modulus.value, "o", color=style.ORANGE, ms=6, label="best E and ν")
    axes.set(xlabel="Poisson's ratio ν", ylabel="Young's modulus E (MPa)", title="What is fixed, and what is not")
    style.legend_below(figure, columns=2)
    return figure


@style.house_look
def draw_history(dates: Sequence[str], modulus: Sequence[Estimate], *, moved: Sequence[bool]) -> Figure:
    """Young's modulus of one sensor over time with 95 % intervals; orange: beyond its interval."""
    figure, (axes,) = style.new_figure(6.4, 3.6)
    for place, (estimate, has_moved) in enumerate(zip(modulus, moved, strict=True)):
        if estimate.value is None or estimate.interval95 is None:
            continue
        low, high = estimate.interval95
        bar = [[estimate.value - low], [high - estimate.value]]
        colour, label = (
            (style.ORANGE, "changed by more than its interval")
            if has_moved
            else (style.BLUE, "no change that can be told")
        )
        axes.errorbar([place], [estimate.value], yerr=bar, fmt="o", color=colour, label=label)
    axes.set_xticks(range(len(dates)), dates, rotation=30, ha="right")
    axes.set(ylabel="Young's modulus E (MPa)", title="Ageing of the gel (95 % intervals)")
    style.legend_below(figure, columns=2)
    return figure
